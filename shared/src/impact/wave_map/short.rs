//! Short hops on a track of several tones: the root of the gap divided by the flight time, one term
//! per tone.
//!
//! Method as in [`double::short`](super::super::double).

use core::f64::consts::TAU;

use super::launch::Launch;
use super::track::Track;
use crate::arithmetic::lane::Lane;
use crate::impact::double::short::{MAX_SHORT_HOP, remainders};
use crate::impact::double::step::{Landing, householder};

/// `u/d` and `u'` at some flight time.
pub(super) struct Deflated<L> {
    /// `u/d`.
    pub value: L,
    /// `u'`.
    pub slope: L,
    /// `u''`.
    pub curvature: L,
}

/// `u/d` and `u'` after `d` <= 0.55/N rad, each exact relative to its terms.
#[inline(always)]
pub(super) fn deflated<L: Lane, const N: usize>(
    track: &Track,
    launch: &Launch<L>,
    d: L,
) -> Deflated<L> {
    let pull = launch.pull(track);
    let mut value = pull * L::splat(0.5);
    let mut slope = launch.velocity - pull * d;
    let mut curvature = -pull;
    for (n, &[s, c]) in launch.parts.iter().enumerate().take(N) {
        let q = L::splat((n + 1) as f64);
        let x = q * d;
        let z = x * x;
        let [third, fourth] = remainders(z);
        let versine = z * (L::splat(0.5) - z * fourth);
        let sagitta = x * z * third;
        let square = q * q;
        value = value - (square * x) * (c * third - (s * x) * fourth);
        slope = slope + q * (c * versine - s * sagitta);
        curvature = curvature + square * (c * (x - sagitta) - s * versine);
    }
    Deflated {
        value: launch.velocity - d * value,
        slope,
        curvature,
    }
}

/// Landing of a short hop; the mask marks certified first impacts.
///
/// Lanes whose last step is too long repeat it up to twice.
#[inline(always)]
pub(super) fn landing<L: Lane, const N: usize>(
    track: &Track,
    launch: &Launch<L>,
) -> (Landing<L>, L::Mask) {
    let d = take_householder_step(track, launch, launch.over_after(track));
    let (mut landing, mut settled) = take_chebyshev_step::<L, N>(track, launch, d);
    for _ in 0..2 {
        if L::any(!settled) {
            let (again, then) = take_chebyshev_step::<L, N>(track, launch, landing.flight);
            landing = landing.or(settled, again);
            settled = settled | then;
        }
    }
    (
        landing,
        settled & is_first_impact::<L, N>(track, launch, &landing),
    )
}

/// Whether a landing is the first.
///
/// Up to the next hump u is concave, or convex and then concave, so it has one root there.
#[inline(always)]
fn is_first_impact<L: Lane, const N: usize>(
    track: &Track,
    launch: &Launch<L>,
    landing: &Landing<L>,
) -> L::Mask {
    let (d, zero) = (landing.flight, L::splat(0.0));
    let mut wait = L::splat(f64::MAX);
    for hump in track.humps() {
        wait = wait.min(launch.ahead(hump.begin.phase));
    }
    zero.below(d)
        & d.below(L::splat(1.1 * MAX_SHORT_HOP / N as f64))
        & d.below(wait)
        & zero.below(landing.arrival)
}

/// One step of Householder's method of order 4 on the first terms of `u/d`.
#[inline(always)]
fn take_householder_step<L: Lane>(track: &Track, launch: &Launch<L>, d: L) -> L {
    let (c, s) = (launch.at.surge, launch.at.bend);
    let first = launch.pull(track) * L::splat(0.5);
    let second = c * L::splat(1.0 / 6.0);
    let third = s * L::splat(1.0 / 24.0);
    let w = launch.velocity - d * (first - d * (second - d * third));
    let w1 = d * (second + second - L::splat(3.0) * (d * third)) - first;
    let w2 = second + second - L::splat(6.0) * (d * third);
    d - householder(w, w1, w2, -(L::splat(6.0) * third), L::splat(0.0))
}

/// The last step, by Chebyshev's method (third order, Traub 1964).
///
/// The mask marks steps so short that the remaining error is below rounding.
#[inline(always)]
fn take_chebyshev_step<L: Lane, const N: usize>(
    track: &Track,
    launch: &Launch<L>,
    d: L,
) -> (Landing<L>, L::Mask) {
    let at = deflated::<L, N>(track, launch, d);
    let per_slope = L::splat(1.0) / at.slope;
    let newton = (d * at.value) * per_slope;
    let turn = ((at.curvature * L::splat(0.5)) * per_slope) * newton;
    let back = newton + newton * turn;
    let flight = d - back;
    let third = launch.at.surge - d * launch.at.bend;
    let arrival = back * (at.curvature - back * (third * L::splat(0.5))) - at.slope;
    let ahead = launch.phase + flight;
    let phase = L::select(
        ahead.below(L::splat(TAU)),
        ahead,
        ((launch.phase - L::splat(TAU)) + flight).max(L::splat(0.0)),
    );
    let landing = Landing {
        flight,
        phase,
        arrival,
    };
    (
        landing,
        newton.abs().below(d * L::splat(MAX_LAST_NEWTON_STEP)),
    )
}

/// Newton step, relative to the flight, up to which Chebyshev's method leaves an error below
/// rounding.
const MAX_LAST_NEWTON_STEP: f64 = 2e-7;
