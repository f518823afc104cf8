//! Events of one part on a track of several tones: impacts, rests and lift-offs.

use super::events::{OrbitEvent, Stage};
use super::release::Release;
use crate::impact::contact_time::ContactTime;
use crate::impact::kernel::{Impact, PartState};
use crate::impact::scatter::Scatter;
use crate::impact::wave::in_turn;
use crate::impact::wave_map::{ChatterLimits, Hop, WaveMap};

/// The orbit of one part on a track of several tones: an iterator that ends when the part rests for
/// ever.
#[derive(Clone, Copy, Debug)]
pub struct WaveOrbit<'a> {
    map: &'a WaveMap,
    /// Mean restitution, and that of each impact; none where it is the mean.
    restitution: f64,
    scatter: Option<Scatter>,
    chatter: ChatterLimits,
    contact: ContactTime,
    state: PartState,
    stage: Stage,
    /// The last release, of an elastic part: a part is thrown at few phases.
    release: Option<Release<PartState>>,
}

impl<'a> WaveOrbit<'a> {
    /// The orbit that begins just after an impact with `start`.
    pub fn new(map: &'a WaveMap, start: PartState) -> Self {
        Self {
            map,
            restitution: map.restitution(),
            scatter: None,
            chatter: ChatterLimits::EXACT,
            contact: ContactTime::INSTANT,
            state: start,
            stage: Stage::Hopping,
            release: None,
        }
    }

    /// The orbit that begins at rest, phase 0; the first lift-off is where the push first rises
    /// through k.
    pub(crate) fn from_rest(map: &'a WaveMap) -> Self {
        Self {
            stage: Stage::Resting,
            ..Self::new(map, PartState::new(0.0, 0.0))
        }
    }

    /// This orbit with a restitution drawn by `scatter` at each impact; a chatter's closed form
    /// uses its mean.
    pub fn scattering(self, scatter: Scatter) -> Self {
        Self {
            restitution: scatter.mean().max(0.0),
            scatter: Some(scatter),
            ..self
        }
    }

    /// This orbit with chatters summed within other limits.
    pub(crate) fn with_chatter(self, chatter: ChatterLimits) -> Self {
        Self { chatter, ..self }
    }

    /// This orbit with impacts that take time.
    ///
    /// The flight of an impact then includes its contact, and its next state is the launch after
    /// that. A chatter's closed form neglects the contacts.
    pub fn with_contact(self, contact: ContactTime) -> Self {
        Self { contact, ..self }
    }

    /// `impact` with its contact.
    fn hold(&self, impact: Impact<PartState>, restitution: f64) -> Impact<PartState> {
        let (k, wave) = (self.map.k(), self.map.wave());
        Impact {
            flight: impact.flight + self.contact.radians(),
            next: (self.contact).launch(restitution, impact.next, k, Some(wave)),
            ..impact
        }
    }

    /// Starts again from rest, phase 0, with a restitution drawn by `scatter` at each impact.
    ///
    /// A chatter's closed form uses its mean.
    pub(crate) fn restart(&mut self, scatter: Scatter) {
        self.restitution = scatter.mean().max(0.0);
        self.scatter = Some(scatter);
        (self.state, self.stage) = (PartState::new(0.0, 0.0), Stage::Resting);
    }

    /// The state after the last event.
    pub(crate) fn state(&self) -> PartState {
        self.state
    }

    fn begin_rest(&mut self, chatter: f64) -> OrbitEvent {
        let phase = in_turn(self.state.phase + chatter);
        self.state = PartState::new(phase, 0.0);
        self.stage = Stage::Resting;
        OrbitEvent::Rest { chatter, phase }
    }

    fn lift_off(&mut self) -> Option<OrbitEvent> {
        let (wait, phase) = self.map.throw(self.state.phase)?;
        let thrown_there = |release: &Release<PartState>| release.launch.phase == phase;
        if !self.release.as_ref().is_some_and(thrown_there) {
            self.release = Some(self.map.release(phase)?);
        }
        self.state = self.release?.launch;
        self.stage = Stage::Released;
        Some(OrbitEvent::LiftOff {
            wait,
            phase: self.state.phase,
        })
    }
}

impl Iterator for WaveOrbit<'_> {
    type Item = OrbitEvent;

    fn next(&mut self) -> Option<OrbitEvent> {
        let mut impact = match self.stage {
            Stage::Resting => return self.lift_off(),
            Stage::Released => self.release?.impact,
            Stage::Hopping => match self
                .map
                .hop_within(self.chatter, self.restitution, self.state)
            {
                Hop::Rest(chatter) => return Some(self.begin_rest(chatter)),
                Hop::Impact(impact) => impact,
            },
        };
        let drawn = self.scatter.as_mut().map(Scatter::draw);
        if impact.flight <= 0.0 {
            // Within rounding of a window's edge: the part rests.
            return Some(self.begin_rest(0.0));
        }
        let restitution = drawn.unwrap_or(self.restitution);
        impact.next.velocity *= restitution;
        if !self.contact.is_instant() {
            impact = self.hold(impact, restitution);
        }
        self.stage = Stage::Hopping;
        self.state = impact.next;
        Some(OrbitEvent::Impact(impact))
    }
}

impl WaveMap {
    /// The release of an elastic part that the track throws at `phase`, see [`WaveMap::throw`].
    ///
    /// `None` where the map finds no flight there.
    pub fn release(&self, phase: f64) -> Option<Release<PartState>> {
        // Rounding may put the edge before the crossing that the map finds, where the part still
        // rests. On the flat top of a very short window the difference exceeds an ulp.
        let mut late = 0.0;
        for _ in 0..40 {
            let launch = PartState::new(in_turn(phase + late), 0.0);
            let impact = self.elastic_impact(launch);
            if impact.flight > 0.0 {
                return Some(Release { launch, impact });
            }
            late = if late == 0.0 {
                f64::EPSILON * phase.max(1.0)
            } else {
                2.0 * late
            };
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::double::Map;
    use crate::impact::kernel::Kernel;
    use crate::impact::orbit::Orbit;
    use crate::impact::wave::{Tone, Wave};

    #[test]
    fn one_tone_orbit_matches_the_sine() {
        for (k, restitution) in [(0.9, 0.5), (0.43, 0.2), (0.2, 0.8), (0.7, 0.0), (1.5, 0.5)] {
            let one = Map::build(k, restitution).unwrap();
            let same = WaveMap::build(k, restitution).unwrap();
            let start = Map::state(2.0, 0.5).unwrap();
            // Compares until rounding, which an orbit amplifies, separates them.
            for (a, b) in Orbit::new(&one, start)
                .zip(WaveOrbit::new(&same, start))
                .take(12)
            {
                let difference = match (a, b) {
                    (OrbitEvent::Impact(a), OrbitEvent::Impact(b)) => (a.flight - b.flight).abs(),
                    (OrbitEvent::Rest { phase: a, .. }, OrbitEvent::Rest { phase: b, .. })
                    | (
                        OrbitEvent::LiftOff { phase: a, .. },
                        OrbitEvent::LiftOff { phase: b, .. },
                    ) => (a - b).abs(),
                    other => panic!("{k} {restitution}: {other:?}"),
                };
                assert!(difference < 1e-6, "{k} {restitution}: {a:?} {b:?}");
            }
            let ended = WaveOrbit::from_rest(&same).next().is_none();
            assert_eq!(ended, k >= 1.0);
        }
    }

    #[test]
    fn every_restitution_keeps_hopping() {
        for n in 0..200 {
            let spread = |factor: f64| (f64::from(n) * factor).rem_euclid(1.0);
            let tone = |a: f64, b: f64| Tone::new(0.5 * spread(a), 6.0 * spread(b));
            let wave = Wave::build(tone(0.618, 0.414), tone(0.732, 0.236)).unwrap();
            for restitution in [0.0, 0.3, 0.9, 1.0] {
                let k = 0.05 + 1.1 * spread(0.303) * wave.highest_throw();
                let map = WaveMap::on(wave, k, restitution).unwrap();
                let mut idle = 0;
                for event in WaveOrbit::from_rest(&map).take(300) {
                    let passed = match event {
                        OrbitEvent::Impact(impact) => impact.flight,
                        OrbitEvent::Rest { chatter, .. } => chatter,
                        OrbitEvent::LiftOff { wait, .. } => wait,
                    };
                    assert!(passed >= 0.0 && passed.is_finite());
                    // A rest and a lift-off may take no time, but never without a flight after.
                    idle = if passed > 0.0 { 0 } else { idle + 1 };
                    assert!(idle < 3, "{map:?}");
                }
            }
        }
    }
}
