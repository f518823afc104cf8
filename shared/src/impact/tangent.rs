//! The tangent map of an impact.

use super::{Impact, Map, State};

/// Partial derivatives of one impact; `det J = R^2 psi / psi'`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tangent {
    /// The Jacobian, rows (phase', velocity'), columns (phase, velocity).
    pub jacobian: [[f64; 2]; 2],
    /// Derivatives of (phase', velocity') by k.
    pub by_k: [f64; 2],
}

impl Tangent {
    /// The tangent of the impact that `map` took from `state`; `None` where it grazes (arrival speed 0).
    #[must_use]
    pub fn of(map: &Map, state: State, impact: &Impact<State>) -> Option<Self> {
        let State {
            phase: t,
            velocity: psi,
        } = state;
        let d = impact.flight;
        let half = libm::sin(0.5 * d);
        // cos t - cos(t+d), without cancellation.
        let fall = 2.0 * libm::sin(t + 0.5 * d) * half;
        let arrival = map.k() * d - psi - fall;
        if arrival <= 0.0 {
            return None;
        }
        let (s, s_next) = (libm::sin(t), libm::sin(t + d));
        let by_phase = (fall - d * s) / arrival;
        let by_velocity = d / arrival;
        let by_k = -0.5 * d * d / arrival;
        let pull = map.k() - s_next;
        let r = map.restitution();
        Some(Self {
            jacobian: [
                [1.0 + by_phase, by_velocity],
                [
                    r * (pull * by_phase + s - s_next),
                    r * (pull * by_velocity - 1.0),
                ],
            ],
            by_k: [by_k, r * (d + pull * by_k)],
        })
    }

    /// Determinant of the Jacobian.
    #[must_use]
    pub fn determinant(&self) -> f64 {
        let [[a, b], [c, d]] = self.jacobian;
        a * d - b * c
    }
}
