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

/// Where the ball falls through height 0, and how fast.
#[derive(Clone, Copy)]
struct Crossing<V> {
    /// Phase in node spacings, counted through all turns.
    nodes: V,
    speed: V,
}

/// The crossing of height 0 of a tall flight, to 2e-8 of the flight.
#[inline(always)]
fn crossing<V: Vector>(track: &Track<V>, launch: &Launch<V>) -> Crossing<V> {
    let per_node = V::splat(node::COUNT as f64 / TAU);
    let v = launch.rise();
    let speed = launch.speed_squared_at_zero(track).rough_sqrt();
    Crossing {
        nodes: (v + speed) * (track.per_k * per_node) + launch.phase * per_node,
        speed,
    }
}

/// Landing within 1.4e-3 rad, by one step of Householder's method of order 4.
#[inline(always)]
fn approach<V: Vector>(track: &Track<V>, crossing: &Crossing<V>) -> LandingEstimate<V> {
    let rounded = crossing.nodes + V::splat(ROUNDING_OFFSET);
    let (sine, cosine) = V::node(rounded);
    let elapsed =
        ((rounded - V::splat(ROUNDING_OFFSET)) - crossing.nodes) * V::splat(node::SPACING);
    // Relative to the crossing nothing cancels. Gravity adds less than 1e-4 to the fall.
    let below = elapsed * crossing.speed + sine;
    let speed = (crossing.speed + track.k * elapsed) + cosine;
    let step = householder(below, speed, track.k - sine, -cosine, sine);
    LandingEstimate { rounded, step }
}

#[inline(always)]
pub(crate) fn landing<V: Vector>(track: &Track<V>, launch: &Launch<V>) -> Landing<V> {
    let estimate = approach(track, &crossing(track, launch));
    GapNearImpact::new(track, launch, &estimate).finish(track)
}
