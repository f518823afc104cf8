//! Approach: Householder's method of order 3 on table nodes (Householder 1970), from the fall of
//! the parabola.

use super::flight::{
    Gravity, MAX_GRAZING_SPEED, Motion, NODES_PER_RADIAN, SPACING, Track, abs, nearest,
    node_from_near,
};
use crate::arithmetic::square_root_single;

/// Node and offset near the impact of a tall flight.
///
/// `None` if the flight is not tall or the steps do not converge soon.
///
/// A flight is tall if it passes every height h of the track faster than the track's speed there,
/// at most `sqrt(1 - h^2)`. It cannot meet the track on the rise, and crosses it once on the fall.
/// The squared speed `v^2 + 2 k (sin - h)` must exceed `1 - h^2` for all h. At height 0 the
/// condition is `1 + k^2`, or `2 k` where k >= 1. On any track the condition is the largest
/// `S'^2 + 2 k S` of a turn.
#[inline(always)]
pub(super) fn fall(track: &impl Track, phase: u32, height: f32, rise: f32) -> Option<Approach> {
    let Gravity {
        k,
        inverse,
        min_tall_speed_squared,
        ..
    } = track.gravity();
    // The sign of the rise makes the value of a sinking part smaller than 2 k h, below the
    // threshold.
    let square = rise * abs(rise) + 2.0 * k * height;
    let is_tall = square >= min_tall_speed_squared;
    if !is_tall {
        return None;
    }
    let speed = square_root_single(square);
    let (node, offset) = node_from_near(phase, (rise + speed) * inverse);
    approach(track, node, -offset, speed, 0.0)
}

/// The last step of an approach.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Approach {
    /// Node where the step starts.
    pub node: i32,
    /// Length of the step in rad.
    pub step: f32,
    /// Time in rad from the first step's height to the start.
    late: f32,
    /// Speed downwards relative to the track at that node, half its growth rate, A' and -A''.
    speed: f32,
    gain: f32,
    surge: f32,
    bend: f32,
}

impl Approach {
    /// Arrival speed at the step's end, which is near its node.
    #[inline(always)]
    pub fn arrival(&self) -> f32 {
        let bend = 0.5 * self.surge - self.bend * (1.0 / 6.0) * self.step;
        self.speed + self.step * (self.gain + self.gain - bend * self.step)
    }

    /// Whether the steps from a node at time `late` preserved the distance.
    #[inline(always)]
    pub fn preserves_distance(&self, node: i32, late: f32) -> bool {
        let walked = self.node.wrapping_sub(node) as f32 * SPACING;
        abs(self.late - late - walked) < MAX_DISTANCE_LOSS
    }
}

/// Number of steps after which the search replaces the approach, which bounds the time.
const MAX_STEPS: u32 = 6;

/// Largest ratio of `b2 u0` to the squared slope at the last step of a final approach. There a
/// third-order step leaves a thousandth of itself. `Track::MAX_LAST_STEP` bounds the error.
const MAX_CURVATURE_RATIO: f32 = 0.1;

/// Largest loss of distance from launch, in rad, over the steps of a final approach. If the part
/// moves nearly parallel to the track, one step can lead a thousand rad away and the next back.
const MAX_DISTANCE_LOSS: f32 = 2e-6;

/// Householder's method of order 3 on nodes until a step is short.
///
/// It starts at a node, `late` rad after the part fell through height `base` at `speed`.
#[inline(always)]
pub(super) fn approach<T: Track>(
    track: &T,
    mut node: i32,
    mut late: f32,
    speed: f32,
    base: f32,
) -> Option<Approach> {
    let Gravity { k, half, .. } = track.gravity();
    for _ in 0..MAX_STEPS {
        let Motion {
            height,
            speed: cosine,
            push,
            surge,
            bend,
        } = track.at(node);
        let u0 = late * (speed + half * late) + (height - base);
        let u1 = speed + k * late + cosine;
        let b2 = 0.5 * (k - push);
        let square = u1 * u1;
        let product = b2 * u0;
        let step = householder(u0, u1, square, product, -surge);
        let (jump, count) = nearest(step * NODES_PER_RADIAN);
        // Householder's step is also short where it leads to no root; Newton's step is not. The
        // steps may also have led back to launch, where the part rises over the track.
        let ends = abs(u0) < T::MAX_LAST_STEP * (u1 - MAX_GRAZING_SPEED)
            && abs(product) < MAX_CURVATURE_RATIO * square;
        if ends {
            return Some(Approach {
                node,
                step,
                late,
                speed: u1,
                gain: b2,
                surge,
                bend,
            });
        }
        node = node.wrapping_add(jump);
        late += count * SPACING;
    }
    None
}

/// Step of Householder's method of order 3 on `u0 + u1 d + b2 d^2 + cos d^3 / 6`.
///
/// `square` is that of `u1`, `product` is `b2 u0`.
#[inline(always)]
pub(super) fn householder(u0: f32, u1: f32, square: f32, product: f32, cosine: f32) -> f32 {
    -u0 * (square - product) / (u1 * (square - 2.0 * product) + cosine * (1.0 / 6.0) * u0 * u0)
}
