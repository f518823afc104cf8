//! Spread of a locked part under scattered restitution, and the estimate of the tangent map from
//! its phases (docs/theory-real-parts.md#t10.2).
//!
//! Near a lock the deviation x = (phase, velocity) is linear: `x' = J x + q`. The noise q has the
//! velocity `s` times the arrival speed. Its stationary covariance solves a discrete Lyapunov
//! equation. The phases alone follow the second-order autoregression
//! `t'' = tr J t' - R^2 t + 2 pi r dR`.

use core::f64::consts::TAU;

use super::lock::Lock;
use super::wave_band::WaveLock;

/// Linear model of a part about its lock.
///
/// ```
/// use kband::regime::{Lock, spread::Spread};
/// let lock = Lock::build(0.43, 0.2, 1)?.expect("0.43 is in the first band");
/// // Restitution scattered by 0.004, 2 % of it.
/// let deviation = Spread::from_lock(&lock).phase_deviation(0.004).expect("it attracts");
/// assert!((deviation - 0.0274).abs() < 1e-4);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    jacobian: [[f64; 2]; 2],
    turns: f64,
    /// Arrival speed in `b w`.
    arrival: f64,
}

impl Spread {
    /// Model about a lock on a sine.
    pub fn from_lock(lock: &Lock) -> Self {
        let push = libm::sin(lock.state().phase);
        Self::from_acceleration(push, lock.k(), lock.restitution(), lock.order())
    }

    /// Model about a lock on several tones.
    pub fn on_tones(lock: &WaveLock) -> Self {
        let [_, _, push, _] = lock.wave().motion(lock.state().phase);
        Self::from_acceleration(push, lock.k(), lock.restitution(), lock.order())
    }

    /// Model about a lock at whose phase the track's acceleration is `push`.
    fn from_acceleration(push: f64, k: f64, r: f64, order: u32) -> Self {
        let turns = f64::from(order);
        // Flight over arrival speed: d = 2 pi r, v = 2 pi r k/(1 + R).
        let (ratio, pull) = ((1.0 + r) / k, k - push);
        Self {
            jacobian: [
                [1.0 - push * ratio, ratio],
                [-r * push * pull * ratio, r * (pull * ratio - 1.0)],
            ],
            turns,
            arrival: TAU * turns / ratio,
        }
    }

    /// Tangent map J of the lock: rows (phase', velocity'), columns (phase, velocity).
    pub fn jacobian(&self) -> [[f64; 2]; 2] {
        self.jacobian
    }

    /// Coefficients tr J and det J = R^2 of the autoregression
    /// `t'' = tr J t' - det J t + 2 pi r dR`.
    pub fn recursion(&self) -> [f64; 2] {
        let [[a, b], [c, d]] = self.jacobian;
        [a + d, a * d - b * c]
    }

    /// Standard deviation of the impact phase in rad, for restitution with standard deviation
    /// `scatter`; `None` if the lock does not attract.
    ///
    /// With T = tr J and D = R^2 it is `2 pi r s sqrt((1 + D) / ((1 - D) ((1 + D)^2 - T^2)))`.
    pub fn phase_deviation(&self, scatter: f64) -> Option<f64> {
        let [trace, determinant] = self.recursion();
        let (sum, rest) = (1.0 + determinant, 1.0 - determinant);
        let margin = sum * sum - trace * trace;
        (margin > 0.0 && rest > 0.0)
            .then(|| TAU * self.turns * scatter * libm::sqrt(sum / (rest * margin)))
    }

    /// Covariance S of phase and velocity, from `S = J S J^T + Q` with
    /// `Q = diag(0, (s arrival)^2)`. `None` if the lock does not attract.
    pub fn covariance(&self, scatter: f64) -> Option<[[f64; 2]; 2]> {
        self.phase_deviation(scatter)?;
        let kick = scatter * self.arrival;
        Some(solve_lyapunov(
            self.jacobian,
            [[0.0, 0.0], [0.0, kick * kick]],
        ))
    }
}

/// `J S J^T`.
pub(super) fn propagate_covariance(
    jacobian: [[f64; 2]; 2],
    covariance: [[f64; 2]; 2],
) -> [[f64; 2]; 2] {
    product(product(jacobian, covariance), transposed(jacobian))
}

/// Solves the discrete Lyapunov equation `S = J S J^T + Q` for a contracting J by doubling (R. A.
/// Smith, SIAM J. Appl. Math. 16 (1968) 198).
pub(super) fn solve_lyapunov(jacobian: [[f64; 2]; 2], added: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let (mut sum, mut power) = (added, jacobian);
    // Each round doubles the number of summed terms; at most 2^40.
    for _ in 0..40 {
        let added = propagate_covariance(power, sum);
        if added[0][0] <= 1e-17 * sum[0][0] && added[1][1] <= 1e-17 * sum[1][1] {
            break;
        }
        for (row, added) in sum.iter_mut().zip(added) {
            row[0] += added[0];
            row[1] += added[1];
        }
        power = product(power, power);
    }
    sum
}

fn product([[a, b], [c, d]]: [[f64; 2]; 2], [[e, f], [g, h]]: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    [
        [a * e + b * g, a * f + b * h],
        [c * e + d * g, c * f + d * h],
    ]
}

fn transposed([[a, b], [c, d]]: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    [[a, c], [b, d]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{Kernel, Map, PartState, Scatter, Tone, Wave, WaveMap};
    use crate::regime::lock::wrap_phase;

    /// Deviations of 40 000 impacts of a part with scattered restitution from its lock.
    fn simulate_deviations<K: Kernel<State = PartState>>(
        build: impl Fn(f64) -> K,
        lock: PartState,
        restitution: f64,
        scatter: f64,
        mut record: impl FnMut(f64, f64),
    ) {
        let elastic = build(1.0);
        let mut draws = Scatter::build(restitution, scatter, 7).unwrap();
        let mut state = lock;
        for _ in 0..40_000 {
            let mut next = elastic.impact(state).next;
            next.velocity *= draws.draw();
            record(
                wrap_phase(next.phase - lock.phase),
                next.velocity - lock.velocity,
            );
            state = next;
        }
    }

    #[test]
    fn closed_form_matches_the_sum_and_the_tangent_map() {
        for (k, r, order) in [(0.43, 0.2, 1), (0.23, 0.2, 2), (0.75, 0.5, 1)] {
            let lock = Lock::build(k, r, order).unwrap().unwrap();
            let spread = Spread::from_lock(&lock);
            let map = Map::build(k, r).unwrap();
            let impact = map.impact(lock.state());
            let tangent = crate::impact::Tangent::build(&map, lock.state(), &impact).unwrap();
            for (row, expected) in spread.jacobian().iter().zip(tangent.jacobian) {
                assert!((row[0] - expected[0]).abs() < 1e-10);
                assert!((row[1] - expected[1]).abs() < 1e-10);
            }
            let deviation = spread.phase_deviation(0.01).unwrap();
            let covariance = spread.covariance(0.01).unwrap();
            assert!((covariance[0][0] / (deviation * deviation) - 1.0).abs() < 1e-12);
        }
        // Beyond its flip a lock has no stationary covariance.
        let lock = Lock::build(0.38, 0.2, 1).unwrap().unwrap();
        assert_eq!(Spread::from_lock(&lock).covariance(0.01), None);
    }

    #[test]
    fn simulated_spread_matches_the_covariance() {
        let wave = Wave::build(Tone::new(0.15, 2.356), Tone::default()).unwrap();
        let one = Lock::build(0.43, 0.2, 1).unwrap().unwrap();
        let two = WaveLock::find_attracting(&wave, 0.35, 0.2, 1)
            .unwrap()
            .unwrap();
        for (spread, state, waved) in [
            (Spread::from_lock(&one), one.state(), false),
            (Spread::on_tones(&two), two.state(), true),
        ] {
            let mut sums = [0.0; 3];
            let count = |t: f64, v: f64| {
                sums[0] += t * t;
                sums[1] += t * v;
                sums[2] += v * v;
            };
            if waved {
                simulate_deviations(
                    |r| WaveMap::on(wave, 0.35, r).unwrap(),
                    state,
                    0.2,
                    0.004,
                    count,
                );
            } else {
                simulate_deviations(|r| Map::build(0.43, r).unwrap(), state, 0.2, 0.004, count);
            }
            let [[tt, tv], [_, vv]] = spread.covariance(0.004).unwrap();
            // 40 000 correlated draws give a variance within 2 %; nonlinearity adds the same.
            let scale = libm::sqrt(tt * vv);
            for (sum, expected, scale) in
                [(sums[0], tt, tt), (sums[1], tv, scale), (sums[2], vv, vv)]
            {
                let error = sum / 40_000.0 - expected;
                assert!(error.abs() < 0.04 * scale, "{waved} {sums:?} {expected}");
            }
        }
    }
}
