//! Events of one part on a track of several tones: impacts, rests and lift-offs.

use super::events::OrbitEvent;
use super::wave_contact::time_to_rest;
use crate::impact::kernel::{Impact, Kernel, PartState};
use crate::impact::wave::in_turn;
use crate::impact::wave_map::WaveMap;

/// The orbit of one part on a track of several tones: an iterator that ends when the part rests for
/// ever.
#[derive(Clone, Copy, Debug)]
pub struct WaveOrbit {
    map: WaveMap,
    part: WavePart,
}

impl WaveOrbit {
    /// The orbit that begins just after an impact with `start`.
    pub fn new(map: &WaveMap, start: PartState) -> Self {
        Self {
            map: *map,
            part: WavePart::new(map.restitution(), start),
        }
    }

    /// The orbit that begins at rest, phase 0; the first lift-off is where the push first rises
    /// through k.
    pub(crate) fn from_rest(map: &WaveMap) -> Self {
        Self {
            map: *map,
            part: WavePart::at_rest(map.restitution(), 0.0),
        }
    }

    /// The state after the last event.
    pub(crate) fn state(&self) -> PartState {
        self.part.state
    }
}

impl Iterator for WaveOrbit {
    type Item = OrbitEvent;

    fn next(&mut self) -> Option<OrbitEvent> {
        Some(match self.part.next(&self.map)? {
            PartStep::Contact(event) => event,
            PartStep::Flight(launch) => {
                let impact = self.map.elastic_impact(launch);
                self.part.land(impact, self.part.restitution)
            }
        })
    }
}

/// A part on a track of several tones, between two events. Its owner computes the flights.
#[derive(Clone, Copy, Debug)]
pub struct WavePart {
    /// Restitution for the closed form of a chatter.
    restitution: f64,
    state: PartState,
    stage: Stage,
}

#[derive(Clone, Copy, Debug)]
enum Stage {
    /// Just after an impact.
    Hopping,
    /// At rest.
    Resting,
    /// Just thrown off.
    Released,
}

/// The next step of a part.
#[derive(Clone, Copy, Debug)]
pub enum PartStep {
    /// The part came to rest or was thrown.
    Contact(OrbitEvent),
    /// The part flies from this state; [`WavePart::land`] takes the impact.
    Flight(PartState),
}

impl WavePart {
    /// A part just after an impact, in `state`.
    pub fn new(restitution: f64, state: PartState) -> Self {
        Self {
            restitution,
            state,
            stage: Stage::Hopping,
        }
    }

    /// A part that rests at a phase in rad.
    pub fn at_rest(restitution: f64, phase: f64) -> Self {
        let state = PartState::new(in_turn(phase), 0.0);
        Self {
            stage: Stage::Resting,
            ..Self::new(restitution, state)
        }
    }

    /// The next step on the track of `map`; `None` at rest for ever.
    pub fn next(&mut self, map: &WaveMap) -> Option<PartStep> {
        Some(match self.stage {
            Stage::Resting => PartStep::Contact(self.lift_off(map)?),
            Stage::Released => PartStep::Flight(self.state),
            Stage::Hopping => match time_to_rest(map.track(), self.restitution, self.state) {
                Some(chatter) => PartStep::Contact(self.begin_rest(chatter)),
                None => PartStep::Flight(self.state),
            },
        })
    }

    /// Ends the flight: takes the impact of an elastic part and its restitution.
    pub fn land(&mut self, mut impact: Impact<PartState>, restitution: f64) -> OrbitEvent {
        if impact.flight <= 0.0 {
            // Within rounding of a window's edge: the part rests.
            return self.begin_rest(0.0);
        }
        impact.next.velocity *= restitution;
        self.stage = Stage::Hopping;
        self.state = impact.next;
        OrbitEvent::Impact(impact)
    }

    fn begin_rest(&mut self, chatter: f64) -> OrbitEvent {
        let phase = in_turn(self.state.phase + chatter);
        self.state = PartState::new(phase, 0.0);
        self.stage = Stage::Resting;
        OrbitEvent::Rest { chatter, phase }
    }

    fn lift_off(&mut self, map: &WaveMap) -> Option<OrbitEvent> {
        let (wait, phase) = map.track().throw(self.state.phase)?;
        // Rounding may put the edge before the crossing that the map finds, where the part still
        // rests. On the flat top of a very short window the difference exceeds an ulp.
        let mut late = 0.0;
        for _ in 0..40 {
            let start = PartState::new(in_turn(phase + late), 0.0);
            if map.impact(start).flight > 0.0 {
                self.state = start;
                self.stage = Stage::Released;
                return Some(OrbitEvent::LiftOff {
                    wait,
                    phase: start.phase,
                });
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
