//! States that certainly chatter to rest, by a bound on the hops, long before the closed form
//! applies.

use std::f64::consts::TAU;

use kband::impact::PartState;

/// Number of phase stretches, each 1.4 degrees wide.
const PHASE_STRETCHES: usize = 256;

/// Durations of a chatter, in stretches.
const LASTS: [usize; 12] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64];

/// Margin above any rounding here.
const ROUNDING_MARGIN: f64 = 1e-9;

/// Velocities up to which a launched part rests before it is thrown again, by phase.
///
/// While the track's push stays below k by `a` to `A`, a part launched at psi falls back to it. It
/// rises for at most psi/a, to at most psi^2/(2a), and falls for at most psi/a, to at most psi
/// sqrt(A/a). So each hop begins with at most q = R sqrt(A/a) times the velocity of the one before.
/// All hops together last at most 2 psi / (a (1 - q)).
#[derive(Clone, Debug)]
pub(super) struct ToRest([f64; PHASE_STRETCHES]);

impl ToRest {
    /// The table for a track of `k` and a restitution below 1.
    pub(super) fn new(k: f64, restitution: f64) -> Self {
        let sines: [f64; PHASE_STRETCHES] =
            std::array::from_fn(|n| (TAU * n as f64 / PHASE_STRETCHES as f64).sin());
        // Smallest and largest push between two ends of stretches.
        let push = |from: usize, to: usize| {
            let passes = |at: usize| {
                (from..=to).contains(&at) || (from..=to).contains(&(at + PHASE_STRETCHES))
            };
            let [one, other] = [from, to].map(|n| sines[n % PHASE_STRETCHES]);
            let least = if passes(3 * PHASE_STRETCHES / 4) {
                -1.0
            } else {
                one.min(other)
            };
            let most = if passes(PHASE_STRETCHES / 4) {
                1.0
            } else {
                one.max(other)
            };
            (least, most)
        };
        let velocity = |stretch: usize, lasts: usize| {
            let (least, most) = push(stretch, stretch + 1 + lasts);
            let (low, high) = (k - most - ROUNDING_MARGIN, k - least + ROUNDING_MARGIN);
            let kept = restitution * (high / low).sqrt();
            if low > 0.0 && kept < 1.0 {
                TAU * lasts as f64 / PHASE_STRETCHES as f64
                    * (0.5 - ROUNDING_MARGIN)
                    * low
                    * (1.0 - kept)
            } else {
                0.0
            }
        };
        Self(std::array::from_fn(|stretch| {
            LASTS
                .into_iter()
                .fold(0.0, |most: f64, lasts| most.max(velocity(stretch, lasts)))
        }))
    }

    /// Whether a launched part certainly rests before it is thrown again; false leaves it open.
    #[inline]
    pub(super) fn is_certain(&self, state: PartState) -> bool {
        let stretch = (state.phase * (PHASE_STRETCHES as f64 / TAU)) as usize;
        self.0
            .get(stretch)
            .is_some_and(|most| state.velocity < *most)
    }
}

#[cfg(test)]
mod tests {
    use kband::impact::{Kernel, Map, Orbit, OrbitEvent};

    use super::*;

    #[test]
    fn what_is_certain_to_rest_rests_before_it_is_thrown_off() {
        let (mut certain, mut rests) = (0, 0);
        for (k, restitution) in [(0.43, 0.2), (0.1, 0.5), (0.8, 0.7), (1.3, 0.9), (0.97, 0.0)] {
            let map = Map::build(k, restitution).unwrap();
            let to_rest = ToRest::new(k, restitution);
            for n in 0..4000 {
                let spread = |factor: f64| (f64::from(n) * factor).fract();
                let phase = TAU * spread(0.618_034);
                // Up to the edge, and beyond it.
                let most = to_rest.0[(phase * (PHASE_STRETCHES as f64 / TAU)) as usize];
                let velocity = (most + 1e-3) * 1.5 * spread(0.414_214);
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
