//! Short hops: the gap divided by the flight time.
//!
//! `w(d) = u/d = psi - d [(k - s)/2 - c d (1/6 - d^2/120 + ...) + s d^2 (1/24 - d^2/720 + ...)]` has lost
//! nothing when psi is 1e-30: d and the arrival speed are accurate relative to themselves throughout a
//! chatter.

use core::f64::consts::TAU;

use super::{Landing, Launch, Track, householder};
use crate::arithmetic::lane::Lane;

/// Longest short hop in rad.
pub(crate) const LONGEST: f64 = 0.25;

/// `u/d` and `u'` at some flight time.
pub(super) struct Deflated<L> {
    /// `u/d`.
    pub value: L,
    /// `u'`.
    pub slope: L,
    /// `u''`.
    pub curvature: L,
}

/// `u/d` and `u'` after `d` <= 0.5 rad, each exact relative to its terms.
#[inline(always)]
pub(super) fn deflated<L: Lane>(pull: L, launch: &Launch<L>, d: L) -> Deflated<L> {
    let z = d * d;
    // (d - sin d)/d^3 and (d^2/2 - 1 + cos d)/d^4.
    let third = L::splat(1.0 / 6.0)
        - z * (L::splat(1.0 / 120.0)
            - z * (L::splat(1.0 / 5040.0)
                - z * (L::splat(1.0 / 362_880.0)
                    - z * (L::splat(1.0 / 39_916_800.0) - z * L::splat(1.0 / 6_227_020_800.0)))));
    let fourth = L::splat(1.0 / 24.0)
        - z * (L::splat(1.0 / 720.0)
            - z * (L::splat(1.0 / 40_320.0)
                - z * (L::splat(1.0 / 3_628_800.0) - z * L::splat(1.0 / 479_001_600.0))));
    let versine = z * (L::splat(0.5) - z * fourth);
    let sagitta = d * z * third;
    let (s, c) = (launch.sine, launch.cosine);
    Deflated {
        value: launch.velocity - d * (pull * L::splat(0.5) - d * (c * third - (s * d) * fourth)),
        slope: (launch.velocity - pull * d) + (c * versine - s * sagitta),
        curvature: (c * (d - sagitta) - s * versine) - pull,
    }
}

/// A first guess of a short hop: the root of the quadratic of `u/d`.
#[inline(always)]
pub(crate) fn guess<L: Lane>(track: &Track<L>, launch: &Launch<L>) -> L {
    let psi = launch.velocity;
    let a1 = (track.k - launch.sine) * L::splat(0.5);
    let a2 = launch.cosine * L::splat(1.0 / 6.0);
    let zero = L::splat(0.0);
    let root = (a1 * a1 - L::splat(4.0) * (a2 * psi)).max(zero).sqrt();
    let pulled = zero.below(a1);
    L::select(pulled, psi + psi, a1 - root) / L::select(pulled, a1 + root, a2 + a2)
}

/// The end of a short hop from a guess; the mask says where it is certain to be the first impact.
#[inline(always)]
pub(crate) fn landing<L: Lane>(
    track: &Track<L>,
    launch: &Launch<L>,
    guess: L,
) -> (Landing<L>, L::Mask) {
    let zero = L::splat(0.0);
    let (s, c) = (launch.sine, launch.cosine);
    let pull = track.k - s;
    let a2 = c * L::splat(1.0 / 6.0);
    let mut d = guess;
    let mut open = L::splat(-1.0).below(zero);
    for _ in 0..3 {
        let w = deflated(pull, launch, d);
        // d w' = u' - w, d^2 w''/2 and d^3 w'''/6 to the leading orders.
        let (sd, cd) = (s * d, c * d);
        let b2 = (a2 - (sd * L::splat(1.0 / 8.0) + (cd * d) * L::splat(1.0 / 20.0))) * d;
        let step = -householder(
            w.value * d,
            w.slope - w.value,
            b2 + b2,
            -(sd * L::splat(1.0 / 4.0) + (cd * d) * L::splat(1.0 / 5.0)),
            zero,
        );
        d = L::select(open, d + step, d);
        // Third order: the next step would be the fourth power of this one, relative to d.
        open = open & !step.abs().below(d * L::splat(2e-6));
        if !L::any(open) {
            break;
        }
    }
    let arrival = -deflated(pull, launch, d).slope;
    let turn = L::splat(TAU);
    let ahead = launch.phase + d;
    let phase = L::select(
        ahead.below(turn),
        ahead,
        ((launch.phase - turn) + d).max(zero),
    );
    // u is concave from the launch, or convex and then concave, up to the next edge: one root.
    let wait = track.edge - launch.phase;
    let wait = L::select(wait.below(zero), wait + turn, wait);
    let certain = !open
        & zero.below(d)
        & d.below(L::splat(2.0 * LONGEST))
        & !wait.below(d)
        & !arrival.below(zero);
    (
        Landing {
            flight: d,
            phase,
            arrival,
        },
        certain,
    )
}
