//! Lock: the period-1 orbit with one impact every r drive cycles, in closed form
//! (docs/theory-bands.md#t5.1).
//!
//! Its stability follows from the Floquet multipliers, the eigenvalues of the tangent map.

use core::f64::consts::{PI, TAU};

use crate::arithmetic::sine_cosine;
use crate::feeder::{OutOfRange, accept, accept_in};
use crate::impact::{ContactTime, Kernel, Map, PartState};

/// Highest lock order computed; up to R = 0.2 the band of order 100 is narrower than 1e-5 in k.
pub const MAX_ORDER: u32 = 100;

pub(super) fn accept_order(order: u32) -> Result<f64, OutOfRange> {
    let (range, accepted) = (1..=MAX_ORDER, "1..100 drive cycles per impact");
    accept("order", order.into(), range.contains(&order), accepted)
}

pub(super) fn accept_restitution(restitution: f64) -> Result<f64, OutOfRange> {
    let accepted = "0..1, 1 itself excluded: without loss no orbit attracts";
    accept_in("restitution", restitution, 0.0..1.0, accepted)
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
            let smaller = match larger {
                0.0 => 0.0,
                _ => determinant / larger,
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
    pub(super) order: u32,
    pub(super) k: f64,
    pub(super) restitution: f64,
    pub(crate) contact: ContactTime,
    pub(super) state: PartState,
}

impl Lock {
    /// Orbit of `order` with `0 <= t0 <= pi/2`: `cos t0 = pi r k (1-R)/(1+R)`,
    /// `psi = 2 pi r k R/(1+R)` (docs/theory-bands.md#t5.1).
    ///
    /// `None` above `k1`, where no such orbit exists. [`Lock::attracts`] and
    /// [`Lock::is_first_return`] decide whether a part can follow it.
    pub fn build(k: f64, restitution: f64, order: u32) -> Result<Option<Self>, OutOfRange> {
        Self::with_contact(k, restitution, order, ContactTime::INSTANT)
    }

    /// [`Lock::build`] with impacts that take time (docs/theory-real-parts.md#t10.6).
    pub fn with_contact(
        k: f64,
        restitution: f64,
        order: u32,
        contact: ContactTime,
    ) -> Result<Option<Self>, OutOfRange> {
        Map::accepts(k, restitution)?;
        let r = accept_order(order)?;
        accept_restitution(restitution)?;
        let (cosine, velocity) = if contact.is_instant() {
            (
                PI * r * k * (1.0 - restitution) / (1.0 + restitution),
                TAU * r * k * restitution / (1.0 + restitution),
            )
        } else {
            match ContactTerms::new(restitution, r, contact).state_at(k) {
                Some(state) => state,
                None => return Ok(None),
            }
        };
        if cosine > 1.0 {
            return Ok(None);
        }
        Ok(Some(Self {
            order,
            k,
            restitution,
            contact,
            state: PartState::new(libm::acos(cosine), velocity),
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

    /// Phase in rad at which the part touches the track; `t0 - c` with a contact time.
    pub fn strike_phase(&self) -> f64 {
        self.state.phase - self.contact.radians()
    }

    fn contact_terms(&self) -> ContactTerms {
        ContactTerms::new(self.restitution, f64::from(self.order), self.contact)
    }

    /// Trace `1 + R^2 - A(t0) (1+R)^2 / k` and determinant of the tangent without a contact time.
    pub(super) fn tangent_without_contact(&self, push: f64) -> [f64; 2] {
        let r = self.restitution;
        [1.0 + r * r - push * (1.0 + r) * (1.0 + r) / self.k, r * r]
    }

    fn tangent(&self) -> [f64; 2] {
        let motion = |phase: f64| {
            let (sine, cosine) = sine_cosine(phase);
            [cosine, sine]
        };
        let [c0, a0] = motion(self.state.phase);
        if self.contact.is_instant() {
            return self.tangent_without_contact(a0);
        }
        let (terms, velocity) = (self.contact_terms(), self.state.velocity);
        terms.tangent(self.k, velocity, [c0, a0, c0], motion(self.strike_phase()))
    }

    /// Trace of the tangent map, `1 + R^2 - sin(t0) (1+R)^2 / k`.
    pub fn trace(&self) -> f64 {
        self.tangent()[0]
    }

    /// Floquet multipliers: growth of a perturbation per impact.
    pub fn multipliers(&self) -> Multipliers {
        let [trace, determinant] = self.tangent();
        Multipliers::from_trace(trace, determinant)
    }

    /// Whether the orbit is asymptotically stable: both multipliers are inside the unit circle.
    pub fn attracts(&self) -> bool {
        if !self.contact.is_instant() {
            // Up to the birth of the lock, the flip alone ends its stability.
            return self.k > self.contact_terms().flip();
        }
        is_stable(self.tangent())
    }

    /// Whether the flight takes r cycles without an earlier contact with the track.
    pub fn is_first_return(&self) -> bool {
        self.returns_first(Map::build(self.k, self.restitution))
    }

    pub(super) fn returns_first<K: Kernel<State = PartState>>(
        &self,
        map: Result<K, OutOfRange>,
    ) -> bool {
        let period = TAU * f64::from(self.order);
        // At k1 the error of the root is the square root of the rounding of t0.
        map.is_ok_and(|map| map.impact(self.state).flight > period - self.contact.radians() - 1e-3)
    }

    /// Distance of `state` to the orbit: the larger difference, in phase (rad) or velocity (`b w`).
    pub fn distance(&self, state: PartState) -> f64 {
        let difference = wrap_phase(state.phase - self.state.phase);
        libm::fabs(difference).max(libm::fabs(state.velocity - self.state.velocity))
    }
}

pub(super) fn is_stable([trace, determinant]: [f64; 2]) -> bool {
    libm::fabs(trace) < 1.0 + determinant
}

/// Terms of the lock with a contact time c (docs/theory-real-parts.md#t10.6). The flight lasts `d =
/// 2 pi r - c`. With the launch at t0 and the strike at `t0 - c` the height vanishes at both, and
/// `psi = R s + rho c (A(t0) - k)`.
#[derive(Clone, Copy)]
pub(super) struct ContactTerms {
    restitution: f64,
    /// Cosine and sine of the contact time.
    turn: [f64; 2],
    flight: f64,
    /// `rho c`.
    gain: f64,
}

impl ContactTerms {
    pub(super) fn new(restitution: f64, order: f64, contact: ContactTime) -> Self {
        let (sine, cosine) = sine_cosine(contact.radians());
        Self {
            restitution,
            turn: [cosine, sine],
            flight: TAU * order - contact.radians(),
            gain: contact.gain(restitution),
        }
    }

    /// k of the lock, for S, its derivative C and the push A at launch, S and C at the strike.
    fn k(&self, [s0, c0, a0]: [f64; 3], [s1, c1]: [f64; 2]) -> f64 {
        let r = self.restitution;
        let chord_height = (1.0 + r) * (s1 - s0) / self.flight;
        (c0 + r * c1 - chord_height + self.gain * a0) / (0.5 * (1.0 - r) * self.flight + self.gain)
    }

    /// Launch velocity psi of the lock at k, for S and C at launch and S at the strike.
    fn velocity(&self, k: f64, [s0, c0]: [f64; 2], s1: f64) -> f64 {
        0.5 * k * self.flight + (s1 - s0) / self.flight - c0
    }

    /// Trace and determinant of the tangent, for C, A and A' at launch, C and A at the strike.
    fn tangent(
        &self,
        k: f64,
        velocity: f64,
        [c0, a0, jerk]: [f64; 3],
        [c1, a1]: [f64; 2],
    ) -> [f64; 2] {
        let (r, d) = (self.restitution, self.flight);
        let arrival = k * d - velocity + c1 - c0;
        let trace =
            1.0 - r + (c0 - c1 - d * a0 + r * d * (k - a1) + self.gain * jerk * d) / arrival;
        [trace, r * velocity / arrival]
    }

    /// Coefficients of `cos t0` and `sin t0` in the k of a lock on a sine.
    #[inline(never)]
    fn k_on_sine(&self) -> [f64; 2] {
        let [cosine, sine] = self.turn;
        [
            self.k([0.0, 1.0, 0.0], [-sine, cosine]),
            self.k([1.0, 0.0, 1.0], [cosine, sine]),
        ]
    }

    /// Cosine of t0 and velocity on a sine at k, on the branch that can attract; `None` above k1.
    fn state_at(&self, k: f64) -> Option<(f64, f64)> {
        let ([p, q], [cosine, sine]) = (self.k_on_sine(), self.turn);
        let birth = libm::sqrt(p * p + q * q);
        let ratio = k / birth;
        if ratio > 1.0 {
            return None;
        }
        // t0 is the phase of the birth plus the arc cosine of k/k1.
        let root = libm::sqrt((1.0 - ratio) * (1.0 + ratio));
        let c0 = (ratio * p - root * q) / birth;
        let s0 = (ratio * q + root * p) / birth;
        let velocity = self.velocity(k, [s0, c0], s0 * cosine - c0 * sine);
        (velocity >= 0.0).then_some((c0, velocity))
    }

    /// k1: the saddle-node on a sine.
    pub(super) fn birth(&self) -> f64 {
        let [p, q] = self.k_on_sine();
        libm::sqrt(p * p + q * q)
    }

    /// k2: the flip on a sine, where trace = -(1 + determinant). Times the arrival speed that is a
    /// sum of a cosine and a sine of t0.
    #[inline(never)]
    pub(super) fn flip(&self) -> f64 {
        let (r, d) = (self.restitution, self.flight);
        let ([p, q], [cosine, sine]) = (self.k_on_sine(), self.turn);
        let sum = |k: f64, [s0, c0]: [f64; 2], [s1, c1]: [f64; 2]| {
            let velocity = self.velocity(k, [s0, c0], s1);
            let arrival = k * d - velocity + c1 - c0;
            (2.0 - r) * arrival + r * velocity + c0 - c1 - d * s0
                + r * d * (k - s1)
                + self.gain * d * c0
        };
        let of_cosine = sum(p, [0.0, 1.0], [-sine, cosine]);
        let of_sine = sum(q, [1.0, 0.0], [cosine, sine]);
        // of_cosine cos t0 + of_sine sin t0 = 0, with cos t0 > 0.
        (p * -of_sine + q * of_cosine) / libm::sqrt(of_cosine * of_cosine + of_sine * of_sine)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{Orbit, OrbitEvent, Tangent, WaveMap};
    use crate::regime::band;

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
            let [[a, b], [c, d]] = tangent.jacobian;
            assert!((a + d - lock.trace()).abs() < 1e-11, "{k} {restitution}");
            assert!((a * d - b * c - restitution * restitution).abs() < 1e-11);
        }
    }

    /// Contacts of 0.25 to 7 % of a cycle, with k in the band of each restitution.
    fn contacts() -> impl Iterator<Item = (f64, f64, ContactTime)> {
        let percents = [0.25, 0.5, 1.0, 2.0, 4.0, 7.0];
        percents.into_iter().flat_map(|percent| {
            let contact = ContactTime::build(percent * 0.01 * TAU).unwrap();
            (1..=6).flat_map(move |tenth| {
                let restitution = 0.1 * f64::from(tenth);
                let terms = ContactTerms::new(restitution, 1.0, contact);
                let (low, high) = (terms.flip(), terms.birth());
                [0.1, 0.5, 0.9].map(|part| (low + (high - low) * part, restitution, contact))
            })
        })
    }

    /// The orbit of the map with contact closes, and its tangent is that of finite differences. It
    /// flips and ends at the edges in closed form.
    #[test]
    fn lock_with_contact_is_that_of_the_map() {
        for (k, restitution, contact) in contacts() {
            let lock = Lock::with_contact(k, restitution, 1, contact);
            let lock = lock.unwrap().unwrap();
            let map = WaveMap::build(k, restitution).unwrap();
            let next = |state| match Orbit::new(&map, state).with_contact(contact).next() {
                Some(OrbitEvent::Impact(impact)) => impact,
                other => panic!("{k} {restitution}: {other:?}"),
            };
            let impact = next(lock.state());
            assert!(lock.distance(impact.next) < 1e-12, "{k} {restitution}");
            assert!((impact.flight - TAU).abs() < 1e-12 && lock.is_first_return());
            assert!(lock.attracts() && is_stable(lock.tangent()));
            let step = 1e-6;
            let PartState { phase, velocity } = lock.state();
            let derivative = |dt: f64, dv: f64| {
                let [up, down] = [1.0, -1.0]
                    .map(|sign| next(PartState::new(phase + sign * dt, velocity + sign * dv)).next);
                let scale = 0.5 / (dt + dv);
                [
                    wrap_phase(up.phase - down.phase) * scale,
                    (up.velocity - down.velocity) * scale,
                ]
            };
            let ([a, b], [c, d]) = (derivative(step, 0.0), derivative(0.0, step));
            // Rounding over the step, and its square times the third derivatives.
            let [trace, determinant] = lock.tangent();
            assert!((a + d - trace).abs() < 1e-6, "{k} {restitution}");
            assert!((a * d - b * c - determinant).abs() < 1e-6);
        }
    }

    #[test]
    fn edges_with_contact_are_flip_and_birth() {
        for (_, restitution, contact) in contacts() {
            let terms = ContactTerms::new(restitution, 1.0, contact);
            let at = |k| Lock::with_contact(k, restitution, 1, contact).unwrap();
            let [trace, determinant] = at(terms.flip()).unwrap().tangent();
            let excess = trace + 1.0 + determinant;
            assert!(excess.abs() < 1e-11, "{restitution} {excess}");
            let [trace, determinant] = at(terms.birth() * (1.0 - 1e-12)).unwrap().tangent();
            assert!((trace - 1.0 - determinant).abs() < 1e-4);
            assert_eq!(at(terms.birth() * (1.0 + 1e-12)), None);
        }
        // Without a contact time the terms are the closed forms of the paper.
        for restitution in [0.1, 0.3, 0.6] {
            let terms = ContactTerms::new(restitution, 2.0, ContactTime::INSTANT);
            let edges = band::edges_with_contact(restitution, 2, ContactTime::INSTANT);
            let [k1, k2] = edges.unwrap();
            assert!((terms.birth() / k1 - 1.0).abs() < 1e-14);
            assert!((terms.flip() / k2 - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn refusals_name_the_parameter() {
        for (k, restitution, order, parameter) in [
            (0.4, 1.0, 1, "restitution"),
            (0.4, 0.2, 0, "order"),
            (f64::NAN, 0.2, 1, "k"),
        ] {
            let refused = Lock::build(k, restitution, order).unwrap_err();
            assert_eq!(refused.parameter, parameter);
        }
        assert_eq!(Lock::build(0.6, 0.2, 1).unwrap(), None);
    }
}
