//! Events of one part on one track: impacts, rests and lift-offs (event-driven simulation).

use super::contact::Contact;
use super::observe::Observer;
use super::release::Release;
use crate::feeder::{OutOfRange, accept};
use crate::impact::double::Map;
use crate::impact::kernel::{Impact, Kernel, PartState};
use crate::impact::scatter::Scatter;
use crate::impact::wave::in_turn;

/// Smallest mean restitution that can scatter.
const MIN_SCATTERED_RESTITUTION: f64 = 1e-6;

/// The next event of a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OrbitEvent {
    /// The part flew and struck the track.
    Impact(Impact<PartState>),
    /// The part chattered to rest.
    Rest {
        /// Duration of the chatter in rad, from its closed form.
        chatter: f64,
        /// Phase at rest, in rad, 0..2 pi.
        phase: f64,
    },
    /// The part rested and was thrown off with velocity 0.
    LiftOff {
        /// Time at rest, in rad.
        wait: f64,
        /// Phase of lift-off in rad, `arcsin k` to rounding.
        phase: f64,
    },
}

/// Why [`Orbit::watch`] stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// The requested number of impacts was reached.
    Counted,
    /// The part was thrown a second time. The orbit repeats from here for ever.
    ///
    /// Velocity and motion along the track restart at each lift-off.
    Repeats,
    /// The part rests for ever (k >= 1).
    RestsForEver,
}

/// The orbit of one part: an iterator of events that ends only when the part rests for ever
/// (k >= 1).
///
/// ```
/// use core::f64::consts::TAU;
/// use kband::impact::{OrbitEvent, Kernel, Map, Orbit};
/// let map = Map::build(0.405, 0.2)?;
/// // From rest this part comes to fly once in every cycle.
/// let Some(OrbitEvent::Impact(impact)) = Orbit::from_rest(&map).nth(200) else {
///     panic!("it hops");
/// };
/// assert!((impact.flight - TAU).abs() < 1e-9);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Orbit<'a> {
    map: &'a Map,
    contact: Contact,
    state: PartState,
    stage: Stage,
    /// The release of the part, once computed.
    release: Option<Release<PartState>>,
    scatter: Option<Scatter>,
    /// The last drawn restitution over that of the map.
    drawn: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Stage {
    /// Just after an impact.
    Hopping,
    /// At rest.
    Resting,
    /// Just thrown off.
    Released,
}

impl<'a> Orbit<'a> {
    /// The orbit that begins just after an impact with `start`.
    pub fn new(map: &'a Map, start: PartState) -> Self {
        Self {
            map,
            contact: Contact::new(map),
            state: start,
            stage: Stage::Hopping,
            release: None,
            scatter: None,
            drawn: 1.0,
        }
    }

    /// The orbit that begins at rest; the first lift-off is at `arcsin k`.
    pub fn from_rest(map: &'a Map) -> Self {
        let origin = PartState::new(0.0, 0.0);
        let mut orbit = Self::new(map, origin);
        orbit.stage = Stage::Resting;
        orbit
    }

    /// This orbit with a restitution drawn by `scatter` at each impact, about that of the map.
    ///
    /// A chatter's closed form uses the map's restitution. Errors: `OutOfRange` for a mean
    /// restitution below 1e-6.
    pub fn scattering(mut self, scatter: Scatter) -> Result<Self, OutOfRange> {
        let mean = scatter.mean();
        accept(
            "restitution",
            mean,
            mean >= MIN_SCATTERED_RESTITUTION,
            "0.000001..1 where it scatters: what is left of no speed cannot be drawn",
        )?;
        self.scatter = Some(scatter);
        Ok(self)
    }

    /// The last drawn restitution over that of the map; 1 without scatter.
    pub(crate) fn drawn(&self) -> f64 {
        self.drawn
    }

    /// `impact` with its velocity scaled to a drawn restitution.
    fn scatter_impact(&mut self, mut impact: Impact<PartState>) -> Impact<PartState> {
        if let Some(scatter) = &mut self.scatter {
            self.drawn = scatter.draw() / scatter.mean();
            impact.next.velocity *= self.drawn;
        }
        impact
    }

    /// The state after the last event.
    pub fn state(&self) -> PartState {
        self.state
    }

    /// Runs the orbit for `impacts` impacts and passes every event to `observer`.
    ///
    /// It ends at the second lift-off. An observer of means that restarts at the first
    /// ([`Observer::lift_off`]) then holds the exact mean of the endless orbit.
    pub fn watch(&mut self, impacts: u64, observer: &mut impl Observer) -> StopReason {
        let mut impacts_seen = 0;
        let mut lift_offs = 0;
        while impacts_seen < impacts {
            let before = self.state;
            match self.next() {
                None => return StopReason::RestsForEver,
                Some(OrbitEvent::Impact(impact)) => {
                    observer.impact(before, &impact);
                    impacts_seen += 1;
                }
                Some(OrbitEvent::Rest { chatter, phase }) => observer.rest(before, chatter, phase),
                Some(OrbitEvent::LiftOff { wait, phase }) => {
                    observer.lift_off(wait, phase);
                    lift_offs += 1;
                    if lift_offs == 2 && self.scatter.is_none() {
                        return StopReason::Repeats;
                    }
                }
            }
        }
        StopReason::Counted
    }

    /// The release of the part; `None` where the map finds no flight, for k within rounding
    /// of 1.
    fn find_release(&mut self) -> Option<Release<PartState>> {
        if self.release.is_none() {
            self.release = Release::build(self.map, self.contact.lift_off()?, 0.0);
        }
        self.release
    }

    fn begin_rest(&mut self, chatter: f64) -> OrbitEvent {
        let phase = in_turn(self.state.phase + chatter);
        self.state = PartState::new(phase, 0.0);
        self.stage = Stage::Resting;
        OrbitEvent::Rest { chatter, phase }
    }

    fn lift_off(&mut self) -> Option<OrbitEvent> {
        let wait = self.contact.wait(self.state.phase)?;
        self.state = self.find_release()?.launch;
        self.stage = Stage::Released;
        Some(OrbitEvent::LiftOff {
            wait,
            phase: self.state.phase,
        })
    }
}

impl Iterator for Orbit<'_> {
    type Item = OrbitEvent;

    fn next(&mut self) -> Option<OrbitEvent> {
        let impact = match self.stage {
            Stage::Resting => return self.lift_off(),
            Stage::Released => self.find_release()?.impact,
            Stage::Hopping => {
                if let Some(chatter) = self.contact.time_to_rest(self.state) {
                    return Some(self.begin_rest(chatter));
                }
                let impact = self.map.impact(self.state);
                if impact.flight <= 0.0 {
                    // The sines of map and contact differ by an ulp at sin t = k: the part
                    // rests.
                    return Some(self.begin_rest(0.0));
                }
                impact
            }
        };
        let impact = self.scatter_impact(impact);
        self.stage = Stage::Hopping;
        self.state = impact.next;
        Some(OrbitEvent::Impact(impact))
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::super::observe::Count;
    use super::*;

    #[test]
    #[expect(
        clippy::excessive_precision,
        reason = "as many digits as the reference has"
    )]
    fn release_flight_matches_the_reference() {
        // docs/theory-reference.md#t11.2
        for (k, restitution, flight, velocity) in [
            (
                0.9,
                0.5,
                1.830_107_180_055_871_980_839,
                0.114_763_926_107_405_765_918,
            ),
            (
                0.43,
                0.2,
                5.156_113_809_800_277_891_936,
                0.418_049_740_908_896_266_3,
            ),
        ] {
            let map = Map::build(k, restitution).unwrap();
            let mut orbit = Orbit::from_rest(&map);
            let Some(OrbitEvent::LiftOff { wait, phase }) = orbit.next() else {
                panic!("a resting part lifts off");
            };
            assert!((wait - libm::asin(k)).abs() < 1e-15 && (phase - libm::asin(k)).abs() < 1e-15);
            let Some(OrbitEvent::Impact(impact)) = orbit.next() else {
                panic!("then it flies");
            };
            // Rounding of arcsin k (1e-16) times the flight's sensitivity (below 10), plus the
            // kernel's rounding.
            assert!((impact.flight - flight).abs() < 2e-14, "{}", impact.flight);
            assert!((impact.next.velocity - velocity).abs() < 2e-14);
        }
    }

    #[test]
    fn orbit_repeats_after_its_second_lift_off() {
        for (k, restitution) in [(0.9, 0.5), (0.43, 0.2), (0.6, 0.1), (0.7, 0.0)] {
            let map = Map::build(k, restitution).unwrap();
            let all: Vec<OrbitEvent> = Orbit::from_rest(&map).skip(1).take(4000).collect();
            let cycle = all
                .iter()
                .position(|event| matches!(event, OrbitEvent::LiftOff { .. }))
                .unwrap_or_else(|| panic!("k {k} R {restitution} comes to rest"))
                + 1;
            for (n, event) in all.iter().enumerate() {
                assert_eq!(*event, all[n % cycle], "k {k} R {restitution} event {n}");
            }
            let mut count = Count::default();
            let ended = Orbit::from_rest(&map).watch(4000, &mut count);
            assert_eq!((ended, count.lift_offs), (StopReason::Repeats, 2));
            assert!(count.impacts < 100);
        }
    }

    #[test]
    fn above_k_1_only_high_restitutions_hop() {
        let map = Map::build(1.5, 0.5).unwrap();
        let mut count = Count::default();
        let mut orbit = Orbit::new(&map, Map::state(2.0, 1.0).unwrap());
        assert_eq!(orbit.watch(u64::MAX, &mut count), StopReason::RestsForEver);
        assert_eq!((count.rests, count.lift_offs), (1, 0));
        assert_eq!(Orbit::from_rest(&map).next(), None);

        // docs/theory-reference.md#t11.4: hopping above k = 1.
        let map = Map::build(1.2, 0.8).unwrap();
        let mut orbit = Orbit::new(&map, Map::state(1.0, 3.3).unwrap());
        assert_eq!(orbit.watch(2000, &mut ()), StopReason::Counted);
        let PartState { phase, velocity } = orbit.state();
        // The reference is printed to 15 digits; the orbit contracts its own rounding.
        assert!((phase - 1.138_585_860_520_52).abs() < 1e-13, "{phase}");
        assert!(
            (velocity - 3.351_032_163_829_11).abs() < 1e-13,
            "{velocity}"
        );
    }
}
