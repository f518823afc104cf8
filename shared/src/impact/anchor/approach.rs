//! Impact of a flight by Householder's method of order 3 (Householder 1970), in steps between table
//! nodes. The start is the time at which the part falls through a given height.
//!
//! The root is that of the track's height over the part. It rises through 0 at the impact.

use super::flight::{
    Gravity, MAX_GRAZING_SPEED, NODES_PER_RADIAN, SPACING, Track, abs, nearest, node_from_near,
};
use crate::arithmetic::square_root_single;

/// Node and offset near the impact of a tall flight.
///
/// `None` if the flight is not tall or the steps converge too slowly.
///
/// A flight is tall if it passes every height h of the track faster than the track's speed there,
/// at most `sqrt(1 - h^2)`. It cannot meet the track on the rise, and crosses it once on the fall.
/// The squared speed `v^2 + 2 k (sin - h)` must exceed `1 - h^2` for all h. The squared speed at
/// height 0 must therefore exceed `1 + k^2`, or `2 k` if k >= 1. On any track it must exceed the
/// largest `S'^2 + 2 k S` within a turn.
#[inline(always)]
pub(super) fn fall(track: &impl Track, phase: u32, height: f32, rise: f32) -> Option<Approach> {
    let gravity = track.gravity();
    // A part that sinks gets a value below 2 k h, which is below the threshold.
    let square = rise * abs(rise) + 2.0 * gravity.k * height;
    let is_tall = square >= gravity.min_tall_speed_squared;
    if !is_tall {
        return None;
    }
    let speed = square_root_single(square);
    let (node, offset) = node_from_near(phase, (rise + speed) * gravity.inverse);
    approach(track, node, -offset, speed, 0.0)
}

/// Node nearest to the impact, and the last step from there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Approach {
    pub node: i32,
    /// Length of the step in rad.
    pub step: f32,
    /// Time in rad from the fall through the given height to this node.
    dt: f32,
    /// Speed of the part downwards relative to the track, at that node.
    speed: f32,
    /// Half of that speed's derivative.
    gain: f32,
    /// Derivatives of the track's displacement at that node: `-S'''` and `S''''`.
    jerk: f32,
    snap: f32,
}

impl Approach {
    /// Arrival speed at the step's end, which is near its node.
    #[inline(always)]
    pub fn arrival(&self) -> f32 {
        let quadratic = 0.5 * self.jerk - self.snap * (1.0 / 6.0) * self.step;
        self.speed + self.step * (self.gain + self.gain - quadratic * self.step)
    }

    /// Whether time and node agree: both have advanced equally from `node` at time `dt`.
    #[inline(always)]
    pub fn preserves_distance(&self, node: i32, dt: f32) -> bool {
        let advanced = self.node.wrapping_sub(node) as f32 * SPACING;
        abs(self.dt - dt - advanced) < MAX_DISTANCE_LOSS
    }
}

/// Largest number of steps; then the caller searches instead. It bounds the time.
const MAX_STEPS: u32 = 6;

/// Largest ratio of `b2 u0` to the squared slope before the last step. Its relative error is then
/// the cube of this. `Track::MAX_LAST_STEP` bounds the absolute error.
const MAX_CURVATURE_RATIO: f32 = 0.1;

/// Largest rounding error of the time, in rad, over all steps. If the part moves nearly parallel to
/// the track, one step can lead a thousand rad away and the next back.
const MAX_DISTANCE_LOSS: f32 = 2e-6;

/// Householder's method of order 3 on nodes until a step is short. It starts at a node, `dt` rad
/// after the part fell through height `base` at `speed`. `None` if no step gets short.
#[inline(always)]
pub(super) fn approach<T: Track>(
    track: &T,
    mut node: i32,
    mut dt: f32,
    speed: f32,
    base: f32,
) -> Option<Approach> {
    let Gravity { k, half, .. } = track.gravity();
    for _ in 0..MAX_STEPS {
        let at = track.at(node);
        let u0 = dt * (speed + half * dt) + (at.height - base);
        let u1 = speed + k * dt + at.speed;
        let b2 = 0.5 * (k - at.push);
        let square = u1 * u1;
        let product = b2 * u0;
        let step = householder(u0, u1, square, product, -at.jerk);
        let (jump, count) = nearest(step * NODES_PER_RADIAN);
        // Householder's step can be short without a root nearby, Newton's cannot. The steps may
        // also have led back to the launch, where the part rises over the track.
        let ends = abs(u0) < T::MAX_LAST_STEP * (u1 - MAX_GRAZING_SPEED)
            && abs(product) < MAX_CURVATURE_RATIO * square;
        if ends {
            return Some(Approach {
                node,
                step,
                dt,
                speed: u1,
                gain: b2,
                jerk: at.jerk,
                snap: at.snap,
            });
        }
        node = node.wrapping_add(jump);
        dt += count * SPACING;
    }
    None
}

/// Step of Householder's method of order 3 on `u0 + u1 d + b2 d^2 + u3 d^3 / 6`. `square` is that
/// of `u1`, `product` is `b2 u0`. The sign of all coefficients is free.
#[inline(always)]
pub(super) fn householder(u0: f32, u1: f32, square: f32, product: f32, u3: f32) -> f32 {
    -u0 * (square - product) / (u1 * (square - 2.0 * product) + u3 * (1.0 / 6.0) * u0 * u0)
}
