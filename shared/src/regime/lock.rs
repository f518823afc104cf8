//! Lock: the period-1 orbit with one impact every r drive cycles, in closed form
//! (docs/theory-bands.md#t5.1).
//!
//! Its stability follows from the Floquet multipliers, the eigenvalues of the tangent map.

use core::f64::consts::{PI, TAU};

use crate::feeder::{OutOfRange, accept};
use crate::impact::{Kernel, Map, PartState};

/// Highest lock order computed; up to R = 0.2 the band of order 100 is narrower than 1e-5 in k.
pub const MAX_ORDER: u32 = 100;

pub(super) fn accept_order(order: u32) -> Result<f64, OutOfRange> {
    accept(
        "order",
        f64::from(order),
        (1..=MAX_ORDER).contains(&order),
        "1..100 drive cycles per impact",
    )
}

pub(super) fn accept_restitution(restitution: f64) -> Result<f64, OutOfRange> {
    accept(
        "restitution",
        restitution,
        (0.0..1.0).contains(&restitution),
        "0..1, 1 itself excluded: without loss no orbit attracts",
    )
}

/// A phase difference in rad without whole turns, in -pi..=pi.
pub(super) fn wrap_phase(difference: f64) -> f64 {
    difference - TAU * libm::round(difference / TAU)
}

/// Floquet multipliers: the eigenvalues of the tangent map of an orbit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Multipliers {
    /// Two real multipliers, the larger in size first.
    Real(f64, f64),
    /// A conjugate pair `modulus exp(+-i angle)`: perturbations rotate and decay.
    Pair {
        /// Modulus; R^n for an orbit of n impacts.
        modulus: f64,
        /// Angle in rad, 0..pi.
        angle: f64,
    },
}

impl Multipliers {
    /// Multipliers of a 2x2 matrix from its trace and determinant.
    pub fn from_trace(trace: f64, determinant: f64) -> Self {
        let half = 0.5 * trace;
        let discriminant = half * half - determinant;
        if discriminant < 0.0 {
            let modulus = libm::sqrt(determinant);
            Self::Pair {
                modulus,
                angle: libm::acos((half / modulus).clamp(-1.0, 1.0)),
            }
        } else {
            let root = libm::sqrt(discriminant);
            let larger = if half < 0.0 { half - root } else { half + root };
            let smaller = if larger == 0.0 {
                0.0
            } else {
                determinant / larger
            };
            Self::Real(larger, smaller)
        }
    }

    /// Spectral radius: the size of the larger multiplier. Below 1 the orbit attracts.
    pub fn modulus(self) -> f64 {
        match self {
            Self::Real(larger, _) => libm::fabs(larger),
            Self::Pair { modulus, .. } => modulus,
        }
    }
}

/// The period-1 orbit of one order at one k: one impact every r drive cycles, at one phase.
///
/// ```
/// use kband::regime::Lock;
/// let lock = Lock::build(0.43, 0.2, 1)?.expect("0.43 is in the first band");
/// assert!(lock.attracts());
/// assert!((lock.state().phase - 0.449_671_605_6).abs() < 1e-9);
/// assert!(Lock::build(0.48, 0.2, 1)?.is_none(), "0.48 is above k1");
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lock {
    order: u32,
    k: f64,
    restitution: f64,
    state: PartState,
}

impl Lock {
    /// Orbit of `order` with `0 <= t0 <= pi/2`: `cos t0 = pi r k (1-R)/(1+R)`,
    /// `psi = 2 pi r k R/(1+R)` (docs/theory-bands.md#t5.1).
    ///
    /// `None` above `k1`, where no such orbit exists. [`Lock::attracts`] and
    /// [`Lock::is_first_return`] decide whether a part can follow it.
    pub fn build(k: f64, restitution: f64, order: u32) -> Result<Option<Self>, OutOfRange> {
        Map::accepts(k, restitution)?;
        let r = accept_order(order)?;
        accept_restitution(restitution)?;
        let cosine = PI * r * k * (1.0 - restitution) / (1.0 + restitution);
        if cosine > 1.0 {
            return Ok(None);
        }
        Ok(Some(Self {
            order,
            k,
            restitution,
            state: PartState::new(
                libm::acos(cosine),
                TAU * r * k * restitution / (1.0 + restitution),
            ),
        }))
    }

    /// Drive cycles per impact (symbol r).
    pub fn order(&self) -> u32 {
        self.order
    }

    /// k of the orbit.
    pub fn k(&self) -> f64 {
        self.k
    }

    /// Restitution of the part (symbol R).
    pub fn restitution(&self) -> f64 {
        self.restitution
    }

    /// State just after each impact: phase t0 in rad, 0..pi/2, and velocity psi in `b w`.
    pub fn state(&self) -> PartState {
        self.state
    }

    /// Trace of the tangent map, `1 + R^2 - sin(t0) (1+R)^2 / k`; its determinant is R^2.
    pub fn trace(&self) -> f64 {
        let r = self.restitution;
        1.0 + r * r - libm::sin(self.state.phase) * (1.0 + r) * (1.0 + r) / self.k
    }

    /// Floquet multipliers: growth of a perturbation per impact.
    pub fn multipliers(&self) -> Multipliers {
        Multipliers::from_trace(self.trace(), self.restitution * self.restitution)
    }

    /// Whether the orbit is asymptotically stable: both multipliers are inside the unit circle.
    pub fn attracts(&self) -> bool {
        let square = self.restitution * self.restitution;
        libm::fabs(self.trace()) < 1.0 + square
    }

    /// Whether the flight takes r cycles without an earlier contact with the track.
    pub fn is_first_return(&self) -> bool {
        let period = TAU * f64::from(self.order);
        // At k1 the error of the root is the square root of the rounding of t0.
        Map::build(self.k, self.restitution)
            .is_ok_and(|map| map.impact(self.state).flight > period - 1e-3)
    }

    /// Distance of `state` to the orbit: the larger of the differences in phase (rad) and velocity
    /// (`b w`).
    pub fn distance(&self, state: PartState) -> f64 {
        let difference = wrap_phase(state.phase - self.state.phase);
        libm::fabs(difference).max(libm::fabs(state.velocity - self.state.velocity))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::Tangent;

    #[test]
    fn orbit_closes_with_the_stated_tangent() {
        for (k, restitution, order) in [
            (0.43, 0.2, 1),
            (0.23, 0.2, 2),
            (0.55, 0.3, 1),
            (0.75, 0.5, 1),
            (0.45, 0.5, 2),
            (1.2, 0.8, 1),
            (0.157, 0.2, 3),
        ] {
            let lock = Lock::build(k, restitution, order).unwrap().unwrap();
            let map = Map::build(k, restitution).unwrap();
            let impact = map.impact(lock.state());
            // Error of one impact in f64: a few ulp of the flight, times |dd/dt| < 10.
            assert!(lock.distance(impact.next) < 1e-13 * f64::from(order) * 10.0);
            assert!(lock.attracts() && lock.is_first_return());
            let tangent = Tangent::build(&map, lock.state(), &impact).unwrap();
            let [[a, _], [_, d]] = tangent.jacobian;
            assert!((a + d - lock.trace()).abs() < 1e-11, "{k} {restitution}");
            assert!((tangent.determinant() - restitution * restitution).abs() < 1e-11);
        }
    }

    #[test]
    fn lock_above_k_1_matches_the_reference() {
        let lock = Lock::build(1.2, 0.8, 1).unwrap().unwrap();
        // The reference has 15 significant digits.
        assert!((lock.state().phase - 1.138_585_860_520_52).abs() < 1e-14);
        assert!((lock.state().velocity - 3.351_032_163_829_11).abs() < 1e-14);
    }

    #[test]
    fn multipliers_reproduce_trace_and_determinant() {
        for (trace, determinant) in [
            (-1.3, 0.04),
            (0.1, 0.04),
            (1.9, 0.9),
            (0.0, 0.0),
            (-0.5, 0.0),
        ] {
            let (sum, product) = match Multipliers::from_trace(trace, determinant) {
                Multipliers::Real(a, b) => (a + b, a * b),
                Multipliers::Pair { modulus, angle } => {
                    (2.0 * modulus * libm::cos(angle), modulus * modulus)
                }
            };
            assert!((sum - trace).abs() < 1e-15 && (product - determinant).abs() < 1e-15);
        }
    }

    #[test]
    fn refusals_name_the_parameter() {
        assert_eq!(
            Lock::build(0.4, 1.0, 1).unwrap_err().parameter,
            "restitution"
        );
        assert_eq!(Lock::build(0.4, 0.2, 0).unwrap_err().parameter, "order");
        assert_eq!(Lock::build(f64::NAN, 0.2, 1).unwrap_err().parameter, "k");
        assert_eq!(Lock::build(0.6, 0.2, 1).unwrap(), None);
    }
}
