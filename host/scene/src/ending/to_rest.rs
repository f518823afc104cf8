//! States that certainly chatter to rest, by a bound on the hops, long before the closed form.

use std::f64::consts::TAU;

use kband::impact::PartState;

/// Number of phase stretches, each 1.4 degrees wide.
const PHASE_STRETCHES: usize = 256;
/// Tried durations of the chatter, in stretches of phase.
const DURATIONS: [usize; 12] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64];
const ROUNDING_MARGIN: f64 = 1e-9;

/// Velocities below which a launched part rests before it is thrown again, by phase. While the
/// pull, `k - sin t`, is within `a` to `A`, a part launched at psi falls back to the track. It
/// rises for at most psi/a, to at most psi^2/(2a), and falls for at most psi/a, to at most psi
/// sqrt(A/a). So each hop starts with at most q = R sqrt(A/a) times the previous velocity. All hops
/// together last at most 2 psi / (a (1 - q)).
#[derive(Clone, Debug)]
pub(super) struct ToRest([f64; PHASE_STRETCHES]);

impl ToRest {
    /// The table for a track of `k` and a restitution below 1.
    pub(super) fn new(k: f64, restitution: f64) -> Self {
        let sines: [f64; PHASE_STRETCHES] =
            std::array::from_fn(|n| (TAU * n as f64 / PHASE_STRETCHES as f64).sin());
        // Smallest and largest sin t between two ends of stretches.
        let push = |from: usize, to: usize| {
            let passes = |at: usize| {
                (from..=to).contains(&at) || (from..=to).contains(&(at + PHASE_STRETCHES))
            };
            let [one, other] = [from, to].map(|n| sines[n % PHASE_STRETCHES]);
            let [least, most] = [3, 1].map(|quarters| passes(quarters * PHASE_STRETCHES / 4));
            let lower = if least { -1.0 } else { one.min(other) };
            let upper = if most { 1.0 } else { one.max(other) };
            (lower, upper)
        };
        let velocity = |stretch: usize, lasts: usize| {
            let (lower, upper) = push(stretch, stretch + 1 + lasts);
            let (low, high) = (k - upper - ROUNDING_MARGIN, k - lower + ROUNDING_MARGIN);
            let effective_restitution = restitution * (high / low).sqrt();
            if low <= 0.0 || effective_restitution >= 1.0 {
                return 0.0;
            }
            let duration = TAU * lasts as f64 / PHASE_STRETCHES as f64;
            duration * (0.5 - ROUNDING_MARGIN) * low * (1.0 - effective_restitution)
        };
        Self(std::array::from_fn(|stretch| {
            let velocities = DURATIONS.map(|lasts| velocity(stretch, lasts));
            velocities.into_iter().fold(0.0, f64::max)
        }))
    }

    /// Whether a launched part certainly rests before it is thrown again; false means unknown.
    #[inline]
    pub(super) fn is_certain(&self, state: PartState) -> bool {
        let stretch = (state.phase * (PHASE_STRETCHES as f64 / TAU)) as usize;
        let upper = self.0.get(stretch);
        upper.is_some_and(|upper| state.velocity < *upper)
    }
}

#[cfg(test)]
mod tests {
    use kband::impact::{Kernel, Map, Orbit, OrbitEvent};

    use super::*;

    #[test]
    fn certain_rest_comes_before_the_next_throw() {
        let (mut certain, mut rests) = (0, 0);
        for (k, restitution) in [(0.43, 0.2), (0.1, 0.5), (0.8, 0.7), (1.3, 0.9), (0.97, 0.0)] {
            let map = Map::build(k, restitution).unwrap();
            let to_rest = ToRest::new(k, restitution);
            for n in 0..4000 {
                let spread = |factor: f64| (f64::from(n) * factor).fract();
                let phase = TAU * spread(0.618_034);
                // Velocities below and above the bound.
                let upper = to_rest.0[(phase * (PHASE_STRETCHES as f64 / TAU)) as usize];
                let velocity = (upper + 1e-3) * 1.5 * spread(0.414_214);
                let start = PartState { phase, velocity };
                let mut time = 0.0;
                let rested = Orbit::new(&map, start)
                    .take(2000)
                    .find_map(|event| match event {
                        OrbitEvent::Impact(impact) => {
                            time += impact.flight;
                            (time > TAU).then_some(false)
                        }
                        OrbitEvent::Rest { .. } => Some(true),
                        OrbitEvent::LiftOff { .. } => Some(false),
                    });
                rests += u32::from(rested == Some(true));
                if to_rest.is_certain(start) {
                    certain += 1;
                    assert_eq!(rested, Some(true), "{k} {restitution} {start:?}");
                }
            }
        }
        assert!(certain > 3000 && rests > certain, "{certain} {rests}");
    }
}
