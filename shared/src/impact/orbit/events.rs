//! Events of one part on one track: impacts, rests and lift-offs (event-driven simulation).

use super::observe::Observer;
use super::orbit_map::{OrbitMap, Release};
use crate::feeder::{OutOfRange, accept_in};
use crate::impact::contact_time::ContactTime;
use crate::impact::double::Map;
use crate::impact::kernel::{Impact, PartState};
use crate::impact::scatter::Scatter;
use crate::impact::wave::in_turn;
use crate::impact::wave_map::{Hop, WaveMap};

const MIN_SCATTERED_RESTITUTION: f64 = 1e-6;

/// The next event of a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OrbitEvent {
    /// The part flew and struck the track.
    Impact(Impact),
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

impl OrbitEvent {
    /// Time that it takes, in rad.
    pub(crate) fn duration(&self) -> f64 {
        match self {
            Self::Impact(impact) => impact.flight,
            Self::Rest { chatter, .. } => *chatter,
            Self::LiftOff { wait, .. } => *wait,
        }
    }
}

/// Why a watched orbit stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StopReason {
    /// The requested number of impacts was reached.
    Counted,
    /// The part was thrown once more, and the orbit repeats from here for ever.
    Repeats,
    /// The part rests for ever (k >= 1).
    RestsForEver,
}

/// The orbit of one part on a track of one tone ([`Map`]) or of several ([`WaveMap`]). It is an
/// iterator of events that ends only if the part rests for ever.
///
/// ```
/// use core::f64::consts::TAU;
/// use kband::impact::{OrbitEvent, Kernel, Map, Orbit};
/// let map = Map::build(0.405, 0.2)?;
/// // From rest this part reaches one flight in every cycle.
/// let Some(OrbitEvent::Impact(impact)) = Orbit::from_rest(&map).nth(200) else {
///     panic!("it hops");
/// };
/// assert!((impact.flight - TAU).abs() < 1e-9);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Orbit<'a, M = Map> {
    pub(crate) map: &'a M,
    state: PartState,
    stage: Stage,
    /// The last release, kept because a part is thrown at few phases.
    release: Option<Release<PartState>>,
    /// Mean restitution, and that of each impact; `None` if it is the mean.
    pub(crate) restitution: f64,
    scatter: Option<Scatter>,
    /// The last factor of [`OrbitMap::restitution_factor`]; 1 without scatter.
    pub(crate) drawn: f64,
    pub(crate) contact: ContactTime,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    Hopping,
    Resting,
    Released,
}

impl Orbit<'_> {
    /// This orbit with a restitution drawn by `scatter` at each impact; a chatter's closed form
    /// uses the map's. Errors: `OutOfRange` for a mean restitution below 1e-6.
    pub fn scattering(self, scatter: Scatter) -> Result<Self, OutOfRange> {
        let mean = scatter.mean();
        let accepted = "0.000001..1 where it scatters: what is left of no speed cannot be drawn";
        accept_in("restitution", mean, MIN_SCATTERED_RESTITUTION.., accepted)?;
        Ok(self.drawing(scatter))
    }
}

impl Orbit<'_, WaveMap> {
    /// This orbit with a restitution drawn at each impact; a chatter's closed form uses its mean.
    pub fn scattering(self, scatter: Scatter) -> Self {
        self.drawing(scatter)
    }

    /// Starts again from rest, phase 0, with a restitution drawn by `scatter` at each impact.
    pub(crate) fn restart(&mut self, scatter: Scatter) {
        *self = Self {
            contact: self.contact,
            ..Self::from_rest(self.map).drawing(scatter)
        };
    }
}

impl<'a, M: OrbitMap> Orbit<'a, M> {
    /// The orbit that begins just after an impact with `start`.
    pub fn new(map: &'a M, start: PartState) -> Self {
        let [_, restitution] = map.parameters();
        Self {
            map,
            state: start,
            stage: Stage::Hopping,
            release: None,
            restitution,
            scatter: None,
            drawn: 1.0,
            contact: ContactTime::INSTANT,
        }
    }

    /// The orbit that begins at rest, phase 0. The first lift-off is at the phase where the track's
    /// push first rises through k (on one tone at `arcsin k`).
    pub fn from_rest(map: &'a M) -> Self {
        Self {
            stage: Stage::Resting,
            ..Self::new(map, PartState::new(0.0, 0.0))
        }
    }

    fn drawing(self, scatter: Scatter) -> Self {
        Self {
            restitution: scatter.mean().max(0.0),
            scatter: Some(scatter),
            ..self
        }
    }

    /// This orbit with impacts that take time, see [`ContactTime::hold`]; a chatter's closed form
    /// neglects them.
    pub fn with_contact(self, contact: ContactTime) -> Self {
        Self { contact, ..self }
    }

    /// The state after the last event.
    pub fn state(&self) -> PartState {
        self.state
    }

    /// Runs the orbit for `impacts` impacts and passes every event to `observer`.
    ///
    /// It ends at the second lift-off, from which it repeats for ever, and returns whether it ended
    /// there. An observer of means that restarts at the first ([`Observer::lift_off`]) then holds
    /// the exact mean of the endless orbit.
    pub fn watch(&mut self, impacts: u64, observer: &mut impl Observer) -> bool {
        self.watch_period(impacts, observer) == StopReason::Repeats
    }

    /// [`Orbit::watch`] with the reason of its end.
    pub(crate) fn watch_period(
        &mut self,
        impacts: u64,
        observer: &mut impl Observer,
    ) -> StopReason {
        let repeats = self.scatter.is_none();
        let mut lift_offs = 0;
        self.watch_until(impacts, observer, |_| {
            lift_offs += 1;
            lift_offs == 2 && repeats
        })
    }

    /// The same up to a lift-off at a phase that `ends` accepts.
    pub(crate) fn watch_until(
        &mut self,
        impacts: u64,
        observer: &mut impl Observer,
        mut ends: impl FnMut(f64) -> bool,
    ) -> StopReason {
        let mut impacts_seen = 0;
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
                    if ends(phase) {
                        return StopReason::Repeats;
                    }
                }
            }
        }
        StopReason::Counted
    }

    fn begin_rest(&mut self, chatter: f64) -> OrbitEvent {
        let phase = in_turn(self.state.phase + chatter);
        self.state = PartState::new(phase, 0.0);
        self.stage = Stage::Resting;
        OrbitEvent::Rest { chatter, phase }
    }

    fn lift_off(&mut self) -> Option<OrbitEvent> {
        let (wait, phase) = self.map.throw(self.state.phase)?;
        let is_at_phase = |release: &Release<PartState>| release.launch.phase == phase;
        if !self.release.as_ref().is_some_and(is_at_phase) {
            self.release = Some(self.map.release(phase)?);
        }
        self.state = self.release?.launch;
        self.stage = Stage::Released;
        let phase = self.state.phase;
        Some(OrbitEvent::LiftOff { wait, phase })
    }
}

impl<M: OrbitMap> Iterator for Orbit<'_, M> {
    type Item = OrbitEvent;

    #[inline]
    fn next(&mut self) -> Option<OrbitEvent> {
        let mut impact = match self.stage {
            Stage::Resting => return self.lift_off(),
            Stage::Released => self.release?.impact,
            Stage::Hopping => match self.map.hop(self.restitution, self.state) {
                Hop::Rest(chatter) => return Some(self.begin_rest(chatter)),
                Hop::Impact(impact) => impact,
            },
        };
        if impact.flight <= 0.0 {
            // Within rounding of lift-off or of the end of a hump: the part rests.
            return Some(self.begin_rest(0.0));
        }
        let drawn = self.scatter.as_mut().map(Scatter::draw);
        let [factor, restitution] = self.map.restitution_factor(self.restitution, drawn);
        self.drawn = factor;
        impact.next.velocity *= factor;
        let [k, _] = self.map.parameters();
        let impact = self.contact.hold(restitution, impact, k, self.map.wave());
        self.stage = Stage::Hopping;
        self.state = impact.next;
        Some(OrbitEvent::Impact(impact))
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;
    use crate::impact::kernel::Kernel;

    #[derive(Default)]
    struct Count([u64; 3]);

    impl Observer for Count {
        fn impact(&mut self, _: PartState, _: &Impact) {
            self.0[0] += 1;
        }

        fn rest(&mut self, _: PartState, _: f64, _: f64) {
            self.0[1] += 1;
        }

        fn lift_off(&mut self, _: f64, _: f64) {
            self.0[2] += 1;
        }
    }

    #[test]
    fn orbit_repeats_after_its_second_lift_off() {
        for (k, restitution) in [(0.9, 0.5), (0.43, 0.2), (0.6, 0.1), (0.7, 0.0)] {
            let map = Map::build(k, restitution).unwrap();
            let all: Vec<OrbitEvent> = Orbit::from_rest(&map).skip(1).take(4000).collect();
            let is_lift_off = |event: &OrbitEvent| matches!(event, OrbitEvent::LiftOff { .. });
            let cycle = all.iter().position(is_lift_off).expect("it comes to rest") + 1;
            for (n, event) in all.iter().enumerate() {
                assert_eq!(*event, all[n % cycle], "k {k} R {restitution} event {n}");
            }
            let mut count = Count::default();
            let ended = Orbit::from_rest(&map).watch_period(4000, &mut count);
            let [impacts, _, lift_offs] = count.0;
            assert_eq!((ended, lift_offs), (StopReason::Repeats, 2));
            assert!(impacts < 100);
        }
    }

    #[test]
    fn above_k_1_only_high_restitutions_hop() {
        let map = Map::build(1.5, 0.5).unwrap();
        let mut count = Count::default();
        let mut orbit = Orbit::new(&map, Map::state(2.0, 1.0).unwrap());
        let ended = orbit.watch_period(u64::MAX, &mut count);
        assert_eq!(ended, StopReason::RestsForEver);
        assert_eq!(count.0[1..], [1, 0]);
        assert_eq!(Orbit::from_rest(&map).next(), None);

        // docs/theory-reference.md#t11.4: hopping above k = 1.
        let map = Map::build(1.2, 0.8).unwrap();
        let mut orbit = Orbit::new(&map, Map::state(1.0, 3.3).unwrap());
        assert_eq!(orbit.watch_period(2000, &mut ()), StopReason::Counted);
        let PartState { phase, velocity } = orbit.state();
        // The reference is printed to 15 digits; the orbit contracts its own rounding.
        let errors = [
            phase - 1.138_585_860_520_52,
            velocity - 3.351_032_163_829_11,
        ];
        assert!(errors.iter().all(|error| error.abs() < 1e-13), "{errors:?}");
    }
}
