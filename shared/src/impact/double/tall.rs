//! Tall flights: the ball leaves height 1 faster than the track's top speed
//! (docs/theory-impacts.md#t3.1).
//!
//! The ball returns through height 1 equally fast, so no earlier impact is possible. The gap is
//! monotone where the flight ends: `-V x - k x^2/2 = sin(phi + x)`, with V the speed at height 0.
//! This is Kepler's equation with eccentricity 1/V < 1, bent by the parabola. From the crossing of
//! height 0, two steps of Householder's method of order 4 reach rounding, each on a table node.

use core::f64::consts::TAU;

use super::launch::{Launch, Track};
use super::step::{GapNearImpact, Landing, LandingEstimate, householder};
use crate::arithmetic::node;
use crate::arithmetic::vector::{ROUNDING_OFFSET, Vector};

/// Smallest squared speed at height 1 of a tall flight, in `(b w)^2`; the certificate holds from 1.
/// At 3 one step comes within 1.4e-3 of the root, at 4 within 4.4e-4, at 6 within 9.4e-5. Measured
/// over 300 000 states or more in each of five ranges, k in 0.02..0.98. The golden data bound the
/// residual after the second step.
pub(crate) const MIN_TALL_SPEED_SQUARED: f64 = 3.0;

impl<V: Vector> Launch<V> {
    #[inline(always)]
    pub fn is_tall(&self, track: &Track<V>) -> V::Mask {
        let bound = V::splat(MIN_TALL_SPEED_SQUARED) + (track.k + track.k);
        bound.below(self.speed_squared_at_zero(track)) & V::splat(0.0).below(self.rise())
    }
}

#[inline(always)]
pub(crate) fn landing<V: Vector>(track: &Track<V>, launch: &Launch<V>) -> Landing<V> {
    // Phase where the ball falls through height 0, in node spacings, to 2e-8 of the flight; it is
    // counted through all turns.
    let per_node = V::splat(node::COUNT as f64 / TAU);
    let falling = launch.speed_squared_at_zero(track).rough_sqrt();
    let nodes = (launch.rise() + falling) * (track.per_k * per_node) + launch.phase * per_node;
    // The landing within 1.4e-3 rad, by one step of Householder's method of order 4.
    let rounded = nodes + V::splat(ROUNDING_OFFSET);
    let (sine, cosine) = V::node(rounded);
    let elapsed = ((rounded - V::splat(ROUNDING_OFFSET)) - nodes) * V::splat(node::SPACING);
    // Relative to the crossing nothing cancels. Gravity adds less than 1e-4 to the fall.
    let below = elapsed * falling + sine;
    let speed = (falling + track.k * elapsed) + cosine;
    let step = householder(below, speed, track.k - sine, -cosine, sine);
    GapNearImpact::new(track, launch, &LandingEstimate { rounded, step }).finish(track)
}
