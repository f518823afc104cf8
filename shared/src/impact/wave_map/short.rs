//! Short hops on several tones: the root of the gap over the flight time, one term per tone.
//!
//! Method as in [`double::short`](super::super::double).

use super::launch::Launch;
use super::track::Track;
use crate::impact::double::short::{
    Deflated, MAX_SHORT_HOP, finish_hop, quadratic_root, remainders,
};
use crate::impact::double::step::{Landing, householder};

/// `u/d` and `u'` after `d` <= 0.55/N rad, each exact relative to its terms.
#[inline(always)]
pub(super) fn deflated<const N: usize>(track: &Track, launch: &Launch, d: f64) -> Deflated<f64> {
    let pull = launch.pull(track);
    let mut value = pull * 0.5;
    let mut slope = launch.velocity - pull * d;
    let mut curvature = -pull;
    for (n, &[s, c]) in launch.parts.iter().enumerate().take(N) {
        let q = (n + 1) as f64;
        let x = q * d;
        let z = x * x;
        let [third, fourth] = remainders(z);
        let versine = z * (0.5 - z * fourth);
        let sagitta = x * z * third;
        let square = q * q;
        value -= (square * x) * (c * third - (s * x) * fourth);
        slope += q * (c * versine - s * sagitta);
        curvature += square * (c * (x - sagitta) - s * versine);
    }
    Deflated {
        value: launch.velocity - d * value,
        slope,
        curvature,
    }
}

/// Landing of a short hop, if it is certified as the first impact. A last step that is too long is
/// repeated up to twice.
#[inline(always)]
pub(super) fn landing<const N: usize>(track: &Track, launch: &Launch) -> Option<Landing<f64>> {
    let near = quadratic_root(launch.velocity, launch.pull(track), launch.at.jerk);
    let d = take_householder_step(track, launch, near);
    let (mut landing, mut settled) = take_chebyshev_step::<N>(track, launch, d);
    for _ in 0..2 {
        if !settled {
            (landing, settled) = take_chebyshev_step::<N>(track, launch, landing.flight);
        }
    }
    (settled && is_first_impact::<N>(track, launch, &landing)).then_some(landing)
}

/// Whether a landing is the first, as in [`double::short`](super::super::double).
#[inline(always)]
fn is_first_impact<const N: usize>(track: &Track, launch: &Launch, landing: &Landing<f64>) -> bool {
    let d = landing.flight;
    let mut humps = track.humps().iter();
    0.0 < d
        && d < 1.1 * MAX_SHORT_HOP / N as f64
        && humps.all(|hump| d < launch.ahead(hump.begin.phase))
        && 0.0 < landing.arrival
}

/// One step of Householder's method of order 4 on the first terms of `u/d`.
#[inline(always)]
fn take_householder_step(track: &Track, launch: &Launch, d: f64) -> f64 {
    let (c, s) = (launch.at.jerk, launch.at.snap);
    let first = launch.pull(track) * 0.5;
    let second = c * (1.0 / 6.0);
    let third = s * (1.0 / 24.0);
    let w = launch.velocity - d * (first - d * (second - d * third));
    let w1 = d * (second + second - 3.0 * (d * third)) - first;
    let w2 = second + second - 6.0 * (d * third);
    d - householder(w, w1, w2, -(6.0 * third), 0.0)
}

/// The last step; the flag marks steps so short that the remaining error is below rounding.
#[inline(always)]
fn take_chebyshev_step<const N: usize>(
    track: &Track,
    launch: &Launch,
    d: f64,
) -> (Landing<f64>, bool) {
    let at = deflated::<N>(track, launch, d);
    let third = launch.at.jerk - d * launch.at.snap;
    finish_hop(launch.phase, d, &at, third, MAX_LAST_NEWTON_STEP)
}

/// Newton step over the flight up to which Chebyshev's method leaves an error below rounding.
const MAX_LAST_NEWTON_STEP: f64 = 2e-7;
