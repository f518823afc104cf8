//! Contact of the part with the track: chatter, rest and lift-off (docs/theory-impacts.md#t4).

use core::f64::consts::{PI, TAU};

use crate::impact::double::Map;
use crate::impact::double::launch::Launch;
use crate::impact::kernel::PartState;
use crate::impact::wave::in_turn;

impl Map {
    /// Duration in rad of the infinitely many hops that end at rest. `None` if its closed form is
    /// not exact to f64, and the part continues to hop.
    ///
    /// Let `A = k - sin t`, `c = cos t` and `z = psi / (A (1 - R))`. The duration is
    /// `2 z + (4/3) (c/A) z^2`. The third order is `(2/9) z^3 (8 (c/A)^2 (1 + 3R/2 + R^2) - 3 (s/A)
    /// (1 + R)^2) / (1 + R + R^2)`, at most `z^3 (2.1 (c/A)^2 + 0.9 |s|/A)`.
    ///
    /// The closed form is used if that is below 2e-16 rad and the pull A changes by less than
    /// 1e-3 of itself. So the track still pulls the part down when it comes to rest. A velocity
    /// of 0 rests at once if the track does not throw it. A lane of `batch::Block` waits on the
    /// same decision.
    #[inline]
    pub fn time_to_rest(&self, state: PartState) -> Option<f64> {
        let PartState { phase, velocity } = state;
        if !self.track().may_chatter_out(velocity) {
            return None;
        }
        let launch = Launch::new(phase, velocity);
        if !launch.chatters_out(self.track(), self.restitution()) {
            return None;
        }
        if velocity <= 0.0 {
            return Some(0.0);
        }
        let pull = self.k() - launch.sine;
        let z = velocity / (pull * (1.0 - self.restitution()));
        let slope = launch.cosine / pull;
        Some(2.0 * z + 4.0 / 3.0 * slope * z * z)
    }

    /// Time in rad from rest at `phase` to lift-off, 0 if at once; `None` if it rests for ever.
    pub fn wait(&self, phase: f64) -> Option<f64> {
        let lift_off = self.lift_off()?;
        let elapsed = in_turn(phase - lift_off);
        // Within rounding of a hump's end a resting part stays: all others are already thrown.
        let thrown = elapsed == 0.0 || elapsed < (PI - 2.0 * lift_off) * (1.0 - 1e-9);
        Some(if thrown { 0.0 } else { TAU - elapsed })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::double::launch::MAX_CHATTER_REMAINDER;
    use crate::impact::kernel::Kernel;
    use crate::impact::orbit::{Orbit, OrbitEvent};

    /// docs/theory-reference.md#t11.2: (k, R, phase, velocity), time of rest, time of lift-off.
    #[expect(
        clippy::excessive_precision,
        reason = "as many digits as the reference has"
    )]
    const CHATTER_REFERENCES: [([f64; 4], f64, Option<f64>); 4] = [
        (
            [0.9, 0.5, 2.0, 0.5],
            5.278_033_763_750_945_676_93,
            Some(7.402_954_822_178_220_714_55),
        ),
        (
            [0.43, 0.2, 0.1571, 0.75],
            37.933_388_819_591_763_287_81,
            Some(38.143_604_620_013_337_892_93),
        ),
        (
            [0.2, 0.8, 4.0, 0.02],
            4.200_702_100_138_276_800_38,
            Some(6.484_543_227_967_919_727_97),
        ),
        ([1.5, 0.5, 2.0, 1.0], 5.211_091_306_569_549_524_19, None),
    ];

    #[test]
    fn chatter_times_match_the_references() {
        for ([k, restitution, phase, velocity], rest, lift_off) in CHATTER_REFERENCES {
            let map = Map::build(k, restitution).unwrap();
            let mut time = phase;
            let mut ended = None;
            let mut actual = None;
            for event in Orbit::new(&map, PartState { phase, velocity }).take(3000) {
                time += event.duration();
                match event {
                    OrbitEvent::Impact(_) => {}
                    OrbitEvent::Rest { .. } => ended = Some(time),
                    OrbitEvent::LiftOff { .. } => {
                        actual = Some(time);
                        break;
                    }
                }
            }
            // Each of up to 60 hops rounds a phase of up to 6.3 by half an ulp (4e-16). The hops
            // between the chatters amplify that, the second case by about 1e3.
            assert!((ended.unwrap() - rest).abs() < 1e-11, "{k}: {ended:?}");
            assert_eq!(actual.is_some(), lift_off.is_some());
            if let (Some(actual), Some(lift_off)) = (actual, lift_off) {
                assert!((actual - lift_off).abs() < 1e-11, "{k}: {actual}");
            }
        }
    }

    /// The closed form against the hops that it sums. It hops on until the closed form is 100 times
    /// shorter, with a remainder of 1e-6 of the tested one.
    #[test]
    fn chatter_time_is_the_sum_of_its_hops() {
        for k in [0.05, 0.43, 0.9, 1.0, 1.5] {
            for restitution in [0.0, 0.2, 0.5, 0.8, 0.95] {
                let map = Map::build(k, restitution).unwrap();
                for step in 0..32 {
                    let phase = f64::from(step) * TAU / 32.0;
                    let mut state = PartState::new(phase, 1e-4);
                    while map.time_to_rest(state).is_none() && state.velocity > 1e-9 {
                        state.velocity *= 0.9;
                    }
                    let Some(closed) = map.time_to_rest(state) else {
                        assert!(libm::sin(phase) > k - 0.03, "{k} {restitution} {phase}");
                        continue;
                    };
                    let mut summed = 0.0;
                    let mut hop = state;
                    for _ in 0..200 {
                        if hop.velocity <= 0.01 * state.velocity {
                            break;
                        }
                        let impact = map.impact(hop);
                        summed += impact.flight;
                        hop = impact.next;
                    }
                    summed += map.time_to_rest(hop).expect("a shorter chatter closes");
                    // The remainder, and the rounding of phases to which tiny hops are added.
                    let bound = MAX_CHATTER_REMAINDER + 1e-9 * closed;
                    assert!((summed - closed).abs() < bound, "{map:?} {phase}");
                    assert!(libm::sin(phase + closed) < k);
                }
            }
        }
    }

    #[test]
    fn open_chatter_has_no_time_to_rest() {
        // Just before lift-off the pull vanishes: no closure, however slow the part.
        let map = Map::build(0.5, 0.5).unwrap();
        let lift_off = map.lift_off().unwrap();
        for velocity in [1e-6, 1e-9, 1e-12, 1e-30] {
            let phase = lift_off - 1e-9;
            let closed = map.time_to_rest(PartState { phase, velocity });
            assert_eq!(closed.is_some(), velocity < 1e-13, "{velocity}");
            let thrown = PartState::new(lift_off + 1e-9, velocity);
            assert_eq!(map.time_to_rest(thrown), None);
        }
        let elastic = Map::build(0.5, 1.0).unwrap();
        let falling = PartState::new(4.0, 1e-9);
        assert_eq!(elastic.time_to_rest(falling), None);
        let still = PartState::new(4.0, 0.0);
        assert_eq!(elastic.time_to_rest(still), Some(0.0));
    }

    #[test]
    fn wait_ends_where_the_track_throws() {
        for k in [0.01, 0.43, 0.9, 0.999_999] {
            let map = Map::build(k, 0.5).unwrap();
            for step in 0..512 {
                let phase = f64::from(step) * TAU / 512.0;
                let wait = map.wait(phase).unwrap();
                assert!((0.0..TAU).contains(&wait));
                if wait == 0.0 {
                    assert!(libm::sin(phase) > k - 1e-15);
                } else {
                    assert!((libm::sin(phase + wait) - k).abs() < 1e-14);
                    assert!(libm::cos(phase + wait) > 0.0 && libm::sin(phase) < k);
                }
            }
        }
        let resting_map = Map::build(1.0, 0.5).unwrap();
        assert_eq!(resting_map.wait(1.0), None);
    }
}
