//! The tangent map of an impact (variational equation) and the largest Lyapunov exponent of an
//! orbit (Benettin et al. 1980).

use super::observe::Observer;
use super::orbit_map::OrbitMap;
use crate::arithmetic::vector::sine_cosine;
use crate::impact::double::Map;
use crate::impact::kernel::{Impact, PartState};
use crate::impact::wave::Tone;

/// Partial derivatives of one impact; `det J = R^2 psi / psi'` (docs/theory-impacts.md#t2.4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tangent {
    /// The Jacobian, rows (phase', velocity'), columns (phase, velocity).
    pub jacobian: [[f64; 2]; 2],
    /// Derivatives of (phase', velocity') by k.
    pub(crate) by_k: [f64; 2],
}

impl Tangent {
    /// The tangent of the impact that `map` computed from `state`; `None` at arrival speed 0, where
    /// no derivative exists.
    pub fn build<M: OrbitMap>(map: &M, state: PartState, impact: &Impact) -> Option<Self> {
        let [k, r] = map.parameters();
        let push = map.push(state.phase);
        let d = impact.flight;
        // S'(t) - S'(t+d) and A(t) - A(t+d), without cancellation.
        let (mut fall, mut rise) = (0.0, 0.0);
        for (q, Tone { amplitude, angle }) in map.tones() {
            let (sine, cosine) = sine_cosine(q * (state.phase + 0.5 * d) + angle);
            let twice = 2.0 * amplitude * sine_cosine(0.5 * q * d).0;
            fall += q * twice * sine;
            rise -= q * q * twice * cosine;
        }
        let arrival = k * d - state.velocity - fall;
        if arrival <= 0.0 {
            return None;
        }
        let by_phase = (fall - d * push) / arrival;
        let by_velocity = d / arrival;
        let by_k = -0.5 * d * d / arrival;
        let pull = k - push + rise;
        Some(Self {
            jacobian: [
                [1.0 + by_phase, by_velocity],
                [r * (pull * by_phase + rise), r * (pull * by_velocity - 1.0)],
            ],
            by_k: [by_k, r * (d + pull * by_k)],
        })
    }
}

/// Largest Lyapunov exponent: mean growth rate of a tangent vector, which restarts at lift-off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Growth<'a> {
    map: &'a Map,
    /// The vector, of length 1.
    direction: [f64; 2],
    sum: f64,
    impacts: u64,
    /// Number of impacts that align the vector before the sum begins.
    settle: u64,
    /// Remaining impacts of those.
    settling: u64,
}

impl<'a> Growth<'a> {
    /// An observer of an orbit on `map`; `settle` impacts align the vector before the sum begins.
    ///
    /// Without them the first direction biases a periodic orbit's exponent: 1e-3 in 3000 impacts.
    pub fn new(map: &'a Map, settle: u64) -> Self {
        Self {
            map,
            direction: [0.8, 0.6],
            sum: 0.0,
            impacts: 0,
            settle,
            settling: settle,
        }
    }

    /// The exponent per impact; `None` before the first impact.
    pub fn exponent(&self) -> Option<f64> {
        (self.impacts > 0).then(|| self.sum / self.impacts as f64)
    }
}

impl Observer for Growth<'_> {
    fn impact(&mut self, launch: PartState, impact: &Impact) {
        let Some(tangent) = Tangent::build(self.map, launch, impact) else {
            return;
        };
        let [[a, b], [c, d]] = tangent.jacobian;
        let [x, y] = self.direction;
        let vector = [a * x + b * y, c * x + d * y];
        let length = libm::hypot(vector[0], vector[1]);
        // The determinant, R^2 psi/psi', vanishes at a launch or an arrival without velocity.
        let regular = self.map.restitution() * launch.velocity * impact.next.velocity > 0.0;
        if length > 0.0 && regular {
            self.direction = vector.map(|component| component / length);
            if self.settling > 0 {
                self.settling -= 1;
                return;
            }
            self.sum += libm::log(length);
            self.impacts += 1;
        }
    }

    fn lift_off(&mut self, _: f64, _: f64) {
        *self = Self::new(self.map, self.settle);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::kernel::Kernel;
    use crate::impact::orbit::Orbit;

    #[test]
    fn settled_vector_grows_by_the_multiplier_of_the_lock() {
        let map = Map::build(0.43, 0.2).unwrap();
        let lock = crate::regime::Lock::build(0.43, 0.2, 1).unwrap().unwrap();
        let exact = libm::log(lock.multipliers().modulus());
        let of = |settle| {
            let mut growth = Growth::new(&map, settle);
            Orbit::new(&map, lock.state()).watch(3000, &mut growth);
            growth.exponent().unwrap()
        };
        assert!((of(64) - exact).abs() < 1e-9);
        // Without alignment the first direction biases the mean for ever.
        assert!((of(0) - exact).abs() > 1e-4);
    }

    #[test]
    fn derivatives_match_differences() {
        for (k, restitution, phase, velocity) in [
            (0.43, 0.2, 0.4, 0.5),
            (0.3, 0.6, 2.0, 1.5),
            (0.9, 0.5, 1.0, 0.8),
        ] {
            let at = |k: f64, phase: f64, velocity: f64| {
                let map = Map::build(k, restitution).unwrap();
                let impact = map.impact(Map::state(phase, velocity).unwrap());
                [phase + impact.flight, impact.next.velocity]
            };
            let map = Map::build(k, restitution).unwrap();
            let state = Map::state(phase, velocity).unwrap();
            let tangent = Tangent::build(&map, state, &map.impact(state)).unwrap();
            let h = 1e-5;
            for row in 0..2 {
                let [by_phase, by_velocity] = tangent.jacobian[row];
                for (derivative, [dk, dt, dv]) in [
                    (tangent.by_k[row], [h, 0.0, 0.0]),
                    (by_phase, [0.0, h, 0.0]),
                    (by_velocity, [0.0, 0.0, h]),
                ] {
                    let more = at(k + dk, phase + dt, velocity + dv)[row];
                    let less = at(k - dk, phase - dt, velocity - dv)[row];
                    // h^2 times third derivatives, which grow like powers of d/s < 10.
                    assert!(((more - less) / (2.0 * h) - derivative).abs() < 1e-5);
                }
            }
        }
    }
}
