//! Short hops: the root of the gap divided by the flight time (deflation of the root at launch).
//!
//! `w(d) = u/d = psi - d [(k - s)/2 - c d (1/6 - d^2/120 + ...) + s d^2 (1/24 - d^2/720 + ...)]`
//! has no cancellation, even at psi = 1e-30 (docs/theory-impacts.md#t2.3). So d and the arrival
//! speed keep their relative accuracy throughout a chatter.

use core::f64::consts::TAU;

use super::launch::{Launch, Track};
use super::step::{Landing, householder};
use crate::arithmetic::vector::Vector;

/// Flight time in rad, approximate: longest short hop.
pub(crate) const MAX_SHORT_HOP: f64 = 0.5;

impl<V: Vector> Launch<V> {
    #[inline(always)]
    pub fn is_short(&self, track: &Track<V>) -> V::Mask {
        self.is_over_within(track, MAX_SHORT_HOP)
    }

    /// Whether a flight that is not tall [ends within](ends_within) about `longest` rad.
    #[inline(always)]
    pub(super) fn is_over_within(&self, track: &Track<V>, longest: f64) -> V::Mask {
        ends_within(self.velocity, track.k - self.sine, self.cosine, longest)
    }
}

/// Whether a flight that is not tall ends within about `longest` rad. It is decided by the
/// quadratic of `u/d`, from the launch velocity, the pull and the slope of the track's push. Either
/// the quadratic crosses zero before half of `longest` and its roots are well apart, or it bends
/// down and is below zero at `longest`.
#[inline(always)]
pub(in crate::impact) fn ends_within<V: Vector>(psi: V, pull: V, c: V, longest: f64) -> V::Mask {
    let is_certain = (psi * V::splat(2.75 / longest)).below(pull)
        & (c * psi).below(V::splat(0.3) * (pull * pull));
    let falling = c.below(V::splat(0.0))
        & (psi + c * V::splat(longest * longest / 6.0)).below(pull * V::splat(longest / 2.0));
    is_certain | falling
}

/// `u/d`, `u'` and `u''` at some flight time.
pub(in crate::impact) struct Deflated<V> {
    pub value: V,
    pub slope: V,
    pub curvature: V,
}

/// `(d - sin d)/d^3` and `(d^2/2 - 1 + cos d)/d^4` from `d^2`, `d` <= 0.55 rad.
#[inline(always)]
pub(in crate::impact) fn remainders<V: Vector>(z: V) -> [V; 2] {
    let third = V::splat(1.0 / 6.0)
        - z * (V::splat(1.0 / 120.0)
            - z * (V::splat(1.0 / 5040.0)
                - z * (V::splat(1.0 / 362_880.0)
                    - z * (V::splat(1.0 / 39_916_800.0)
                        - z * (V::splat(1.0 / 6_227_020_800.0)
                            - z * V::splat(1.0 / 1_307_674_368_000.0))))));
    let fourth = V::splat(1.0 / 24.0)
        - z * (V::splat(1.0 / 720.0)
            - z * (V::splat(1.0 / 40_320.0)
                - z * (V::splat(1.0 / 3_628_800.0)
                    - z * (V::splat(1.0 / 479_001_600.0) - z * V::splat(1.0 / 87_178_291_200.0)))));
    [third, fourth]
}

/// `u/d` and `u'` after `d` <= 0.55 rad, each exact relative to its terms.
#[inline(always)]
pub(super) fn deflated<V: Vector>(pull: V, launch: &Launch<V>, d: V) -> Deflated<V> {
    let z = d * d;
    let [third, fourth] = remainders(z);
    let versine = z * (V::splat(0.5) - z * fourth);
    let sagitta = d * z * third;
    let (s, c) = (launch.sine, launch.cosine);
    Deflated {
        value: launch.velocity - d * (pull * V::splat(0.5) - d * (c * third - (s * d) * fourth)),
        slope: (launch.velocity - pull * d) + (c * versine - s * sagitta),
        curvature: (c * (d - sagitta) - s * versine) - pull,
    }
}

/// First guess of a short hop in rad.
#[inline(always)]
pub(crate) fn guess<V: Vector>(track: &Track<V>, launch: &Launch<V>) -> V {
    quadratic_root(launch.velocity, track.k - launch.sine, launch.cosine)
}

/// The root of the quadratic of `u/d`, for a flight that [ends soon](ends_within).
#[inline(always)]
pub(in crate::impact) fn quadratic_root<V: Vector>(psi: V, pull: V, c: V) -> V {
    let a1 = pull * V::splat(0.5);
    let a2 = c * V::splat(1.0 / 6.0);
    let zero = V::splat(0.0);
    let root = (a1 * a1 - V::splat(4.0) * (a2 * psi)).max(zero).sqrt();
    let pulled = zero.below(a1);
    V::select(pulled, psi + psi, a1 - root) / V::select(pulled, a1 + root, a2 + a2)
}

/// Landing of a short hop from a guess; the mask marks certified first impacts. Lanes whose last
/// step is too long repeat it.
#[inline(always)]
pub(crate) fn landing<V: Vector>(
    track: &Track<V>,
    launch: &Launch<V>,
    guess: V,
) -> (Landing<V>, V::Mask) {
    let d = take_householder_step(track, launch, guess);
    let (mut landing, mut settled) = take_chebyshev_step(track, launch, d);
    if V::any(!settled) {
        let (repeated, is_settled) = take_chebyshev_step(track, launch, landing.flight);
        landing = landing.or(settled, repeated);
        settled = settled | is_settled;
    }
    (landing, settled & is_first_impact(track, launch, &landing))
}

/// [`landing`] with up to four steps; `None` if the first impact stays uncertain.
#[cold]
pub(crate) fn land_by_iteration(track: &Track<f64>, launch: &Launch<f64>) -> Option<Landing<f64>> {
    let mut d = guess(track, launch);
    for _ in 0..4 {
        d = take_householder_step(track, launch, d);
        let (landing, settled) = take_chebyshev_step(track, launch, d);
        if f64::any(settled) {
            return f64::any(is_first_impact(track, launch, &landing)).then_some(landing);
        }
    }
    None
}

/// Whether a landing is the first. Up to the next hump u is concave, or convex and then concave, so
/// it has one root there.
#[inline(always)]
fn is_first_impact<V: Vector>(
    track: &Track<V>,
    launch: &Launch<V>,
    landing: &Landing<V>,
) -> V::Mask {
    let (d, zero) = (landing.flight, V::splat(0.0));
    zero.below(d)
        & d.below(V::splat(1.1 * MAX_SHORT_HOP))
        & d.below(launch.time_to_next_hump(track))
        & zero.below(landing.arrival)
}

/// One step of Householder's method of order 4: relative error 1e-7 from a guess within a tenth.
#[inline(always)]
fn take_householder_step<V: Vector>(track: &Track<V>, launch: &Launch<V>, d: V) -> V {
    let (psi, s, c) = (launch.velocity, launch.sine, launch.cosine);
    let pull = track.k - s;
    let z = d * d;
    // The powers of d in u/d; weighted sums of them give its derivatives times powers of d.
    let (first, second, third) = (
        d * (pull * V::splat(0.5)),
        z * (c * V::splat(1.0 / 6.0)),
        (z * d) * (s * V::splat(1.0 / 24.0)),
    );
    let fourth = z * (second * V::splat(1.0 / 20.0));
    let fifth = z * (third * V::splat(1.0 / 30.0));
    let sixth = z * (fourth * V::splat(1.0 / 42.0));
    let w = (psi - (first - second)) - ((third + fourth) - (fifth + sixth));
    let w1 = ((second + second) - first)
        - ((V::splat(3.0) * third + V::splat(4.0) * fourth)
            - (V::splat(5.0) * fifth + V::splat(6.0) * sixth));
    let w2 = second - (V::splat(3.0) * third + V::splat(6.0) * fourth);
    let w3 = -(third + V::splat(4.0) * fourth);
    let step = householder(w, w1, w2 + w2, V::splat(6.0) * w3, V::splat(-24.0) * fourth);
    d - d * step
}

/// The last step, by Chebyshev's method (third order, Traub 1964). The mask marks steps so short
/// that the remaining error is below rounding.
#[inline(always)]
fn take_chebyshev_step<V: Vector>(
    track: &Track<V>,
    launch: &Launch<V>,
    d: V,
) -> (Landing<V>, V::Mask) {
    let (s, c) = (launch.sine, launch.cosine);
    let at = deflated(track.k - s, launch, d);
    let third = c - d * (s + d * (c * V::splat(0.5)));
    finish_hop(launch.phase, d, &at, third, MAX_LAST_NEWTON_STEP)
}

/// Chebyshev's step from `d`, and whether it is at most `longest` of it. `third` is `-u'''`.
#[inline(always)]
pub(in crate::impact) fn finish_hop<V: Vector>(
    launch_phase: V,
    d: V,
    at: &Deflated<V>,
    third: V,
    longest: f64,
) -> (Landing<V>, V::Mask) {
    let per_slope = V::splat(1.0) / at.slope;
    let newton = (d * at.value) * per_slope;
    let turn = ((at.curvature * V::splat(0.5)) * per_slope) * newton;
    let step = newton + newton * turn;
    let flight = d - step;
    let arrival = step * (at.curvature - step * (third * V::splat(0.5))) - at.slope;
    let turn = V::splat(TAU);
    let ahead = launch_phase + flight;
    let phase = V::select(
        ahead.below(turn),
        ahead,
        ((launch_phase - turn) + flight).max(V::splat(0.0)),
    );
    let landing = Landing {
        flight,
        phase,
        arrival,
    };
    (landing, newton.abs().below(d * V::splat(longest)))
}

/// Newton step over the flight up to which Chebyshev's method leaves an error below rounding.
const MAX_LAST_NEWTON_STEP: f64 = 5e-7;
