//! Time in gear and conveying speed of parts whose restitution scatters, on any wave.

use core::f64::consts::TAU;

use crate::feeder::{OutOfRange, accept};
use crate::impact::{Along, Friction, Orbit, OrbitEvent, PartState, Scatter, Tangential, WaveMap};
use crate::regime::gear::{Share, watch_from_rest};

const MAX_LAWS: usize = 64;

/// A law of the motion along a track of several tones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WaveLaw {
    /// Restitution along the track.
    Tangential(Tangential),
    /// Coulomb friction.
    Friction(Friction),
}

impl WaveLaw {
    /// Distance in b and velocity in `b w` after an event; `rested` is the phase of the last rest.
    fn follow(
        &self,
        event: &OrbitEvent,
        before: PartState,
        rested: f64,
        velocity: f64,
    ) -> (f64, f64) {
        let motion = match (self, event) {
            (Self::Tangential(law), OrbitEvent::Impact(impact)) => {
                return law.move_in_flight(before, impact, velocity);
            }
            // A chatter leaves no velocity, and its distance is below 1e-4 of the one before.
            (Self::Tangential(_), _) => return (0.0, 0.0),
            (Self::Friction(law), OrbitEvent::Impact(impact)) => {
                return law.move_in_flight(before, impact, velocity);
            }
            (Self::Friction(law), OrbitEvent::Rest { chatter, .. }) => {
                law.move_in_chatter([0.0; 2], before, *chatter, velocity)
            }
            (Self::Friction(law), OrbitEvent::LiftOff { wait, .. }) => {
                law.move_in_contact(rested, *wait, velocity)
            }
        };
        (motion.distance, motion.velocity)
    }
}

/// Motion of a part along the track by each law: distance in b, velocity in `b w`.
type LawStates = [(f64, f64); MAX_LAWS];

#[derive(Clone, Copy)]
struct Paths {
    states: LawStates,
    rested: f64,
    /// Time and motion where the measurement began.
    begun: Option<(f64, LawStates)>,
}

impl Paths {
    const NONE: Self = Self {
        states: [(0.0, 0.0); MAX_LAWS],
        rested: 0.0,
        begun: None,
    };

    fn advance(&mut self, laws: &[WaveLaw], before: PartState, event: &OrbitEvent) {
        let rested = self.rested;
        if let OrbitEvent::Rest { phase, .. } = event {
            self.rested = *phase;
        }
        for (law, (distance, velocity)) in laws.iter().zip(&mut self.states) {
            let (further, after) = law.follow(event, before, rested, *velocity);
            *distance += further;
            *velocity = after;
        }
    }
}

/// Simulates parts from rest as [`shares_from_rest`](crate::regime::gear::shares_from_rest), with
/// their motion along the track by each of up to 64 `laws` of the same wave and k.
///
/// `each` receives the index of a part, its time in gear, and for each law its time mean velocity
/// along the track in `b w`. Both are over the last three quarters of the time.
pub fn convey_from_rest(
    map: &WaveMap,
    laws: &[WaveLaw],
    scatters: &[Scatter],
    order: u32,
    periods: f64,
    mut each: impl FnMut(usize, Share, &[f64]),
) -> Result<(), OutOfRange> {
    let count = laws.len();
    accept("number of laws", count as f64, count <= MAX_LAWS, "0..64")?;
    let (begin, end) = (0.25 * periods * TAU, periods * TAU);
    let watch = |paths: &mut Paths, time: f64, before: PartState, event: &OrbitEvent| {
        if paths.begun.is_none() && time >= begin {
            paths.begun = Some((time, paths.states));
        }
        paths.advance(laws, before, event);
    };
    let each = |n, share, time: f64, paths: Paths| {
        let mut speeds = [0.0; MAX_LAWS];
        if let Some((from, at)) = paths.begun {
            let states = paths.states.iter().zip(&at);
            for (speed, ((now, _), (then, _))) in speeds.iter_mut().zip(states) {
                *speed = (now - then) / (time.max(end) - from);
            }
        }
        each(n, share, &speeds[..laws.len()]);
    };
    let map = map.with_coarse_chatter();
    let (orbit, record) = (Orbit::from_rest(&map), Paths::NONE);
    watch_from_rest(orbit, scatters, order, periods, record, watch, each)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{FrictionSettings, TangentialSettings, Tone, Wave};
    use crate::transport::{Effort, Motion, measure_on_tones};

    fn waves() -> [Wave; 2] {
        let second = Tone::new(0.15, 2.5);
        let of_two = Wave::build(second, Tone::default());
        [Wave::sine(), of_two.expect("in range")]
    }

    /// Without scatter the speed is that of an independent measurement, also with rests.
    #[test]
    fn speed_without_scatter_is_that_of_the_survey() {
        for (wave, ks) in waves().into_iter().zip([[0.41, 0.9], [0.33, 0.8]]) {
            for (k, motion) in ks.into_iter().zip([Motion::Hopping, Motion::HopAndRest]) {
                let settings = FrictionSettings {
                    sticking: 0.3,
                    sliding: 0.3,
                    amplitude_ratio: 1.5,
                    phase_lead: 0.2,
                    incline_tangent: 0.05,
                };
                let map = WaveMap::on(wave, k, 0.2).unwrap();
                let law = Friction::on(&wave, k, settings).unwrap();
                let (settle, impacts) = (1000, 3000);
                let effort = Effort { settle, impacts };
                let survey = measure_on_tones(Orbit::from_rest(&map), law, effort);
                assert_eq!(survey.motion, motion, "{k}");
                let expected = survey.conveyed.time_mean().unwrap();
                let scatter = [Scatter::build(0.2, 0.0, 1).unwrap()];
                let laws = [WaveLaw::Friction(law)];
                convey_from_rest(&map, &laws, &scatter, 1, 4000.0, |_, _, speeds| {
                    let error = speeds[0] / expected - 1.0;
                    assert!(error.abs() < 2e-3, "{k}: {} {expected}", speeds[0]);
                })
                .unwrap();
            }
        }
    }

    /// Restitution along the track is linear: two tracks give the speed on a third.
    #[test]
    fn tangential_speeds_add_up() {
        for (wave, k) in waves().into_iter().zip([0.44, 0.42]) {
            let law = |amplitude_ratio, incline_tangent| {
                let settings = TangentialSettings {
                    restitution: 0.2,
                    amplitude_ratio,
                    phase_lead: 0.4,
                    incline_tangent,
                };
                WaveLaw::Tangential(Tangential::on(&wave, k, settings).unwrap())
            };
            let laws = [law(1.0, 0.0), law(0.0, 1.0), law(1.7, 0.06)];
            let map = WaveMap::on(wave, k, 0.3).unwrap();
            let scatter = [Scatter::build(0.3, 0.08, 1).unwrap()];
            convey_from_rest(&map, &laws, &scatter, 1, 300.0, |_, _, speeds| {
                let [shaken, fallen, both] = [speeds[0], speeds[1], speeds[2]];
                assert!(shaken > 0.1 && fallen < -0.1, "{speeds:?}");
                assert!((1.7 * shaken + 0.06 * fallen - both).abs() < 1e-12);
            })
            .unwrap();
        }
    }
}
