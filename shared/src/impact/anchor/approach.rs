//! Steps on nodes from the fall of the parabola.

use super::flight::{Flight, Motion, NODES_PER_RADIAN, SPACING, Track, abs, nearest};
use crate::arithmetic::square_root_single;

/// The impact of a tall flight, nearly: node and offset; `None` where the flight is not tall or the
/// steps do not converge soon.
///
/// Tall is a flight that passes every height h of the track faster than the track ever does there, which
/// is at most `sqrt(1 - h^2)`: on the rise it cannot meet the track, on the fall it crosses it once. The
/// square of its speed, `v^2 + 2 k (sin - h)`, is above `1 - h^2` for all of them where that at height 0
/// is above `1 + k^2`, or `2 k` where k >= 1; on any track, above the largest `S'^2 + 2 k S` of a turn.
#[inline(always)]
pub(super) fn fall<F: Flight>(
    track: &impl Track,
    phase: u32,
    height: f32,
    rise: f32,
) -> Option<Approach> {
    // With the sign of the rise: of a part that sinks it is below 2 k h, and so below what is asked.
    let square = rise * abs(rise) + 2.0 * track.k() * height;
    let is_tall = square >= track.tall();
    if !is_tall {
        return None;
    }
    let speed = square_root_single(square);
    let (node, offset) = F::node_of(phase, (rise + speed) * track.inverse());
    approach::<F>(track, node, -offset, speed, 0.0)
}

/// The last of some steps on nodes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Approach {
    /// Where it started.
    pub node: i32,
    /// Its length, rad.
    pub step: f32,
    /// How long after the height of the first step it started, in rad.
    late: f32,
    /// Speed downwards against the track at that node, half the rate at which it grows, A' and -A''.
    speed: f32,
    gain: f32,
    surge: f32,
    bend: f32,
    /// The node nearest to where it ends and the distance from there.
    pub end: (i32, f32),
}

impl Approach {
    /// Arrival speed where it ends, near to its node.
    #[inline(always)]
    pub fn arrival(&self) -> f32 {
        let bend = 0.5 * self.surge - self.bend * (1.0 / 6.0) * self.step;
        self.speed + self.step * (self.gain + self.gain - bend * self.step)
    }

    /// Whether the steps from a node `late` after that height have kept the distance.
    #[inline(always)]
    pub fn has_kept(&self, node: i32, late: f32) -> bool {
        let walked = self.node.wrapping_sub(node) as f32 * SPACING;
        abs(self.late - late - walked) < LOST
    }
}

/// Steps after which an approach is given up for the search, which bounds its time. Of 420 000 launches none more
/// is wrong or flagged with 2 to 12.
const ROUNDS: u32 = 6;
/// Largest height that an approach ends at: the fastest part is nearer to its crossing of height 0. Between 2,
/// beyond which the exact height wraps, and 100 no impact changes.
const NEAR: f32 = 2.0;

/// Largest `b2 u0` over the slope's square at the last step of a kernel that settles no further: of so simple a root a
/// third-order step leaves a thousandth of itself. Between 0.01 and 10 none more is wrong or flagged, for `LEAP` is
/// what bounds the error.
const SIMPLE: f32 = 0.1;

/// What the distance from launch may have lost on the way, in rad, where a kernel settles no further: a step from where the part is
/// hardly nearer to the track leads a thousand rad away, and the next one back.
const LOST: f32 = 2e-6;

/// Householder's third-order step on nodes until it is short: from a node `late` after the part was at
/// height `base`, going down at `speed`.
#[inline(always)]
pub(super) fn approach<F: Flight>(
    track: &impl Track,
    mut node: i32,
    mut late: f32,
    speed: f32,
    base: f32,
) -> Option<Approach> {
    for _ in 0..ROUNDS {
        let Motion {
            height,
            speed: cosine,
            push,
            surge,
            bend,
        } = track.at(node);
        let u0 = late * (speed + track.half_k() * late) + (height - base);
        let u1 = speed + track.k() * late + cosine;
        let b2 = 0.5 * (track.k() - push);
        let square = u1 * u1;
        let product = b2 * u0;
        let step = householder(u0, u1, square, product, -surge);
        let (jump, count) = nearest(step * NODES_PER_RADIAN);
        let next = node.wrapping_add(jump);
        // Householder's step is short as well where it leads to no root, but not Newton's. The steps may
        // have led back to launch, where the part rises over the track.
        let ends = if F::FINAL {
            abs(u0) < F::LEAP * (u1 - F::SLOW) && abs(product) < SIMPLE * square
        } else {
            // Far from a root the step is short by chance, and the exact height wraps.
            abs(step) < F::LEAP && abs(u0) < NEAR
        };
        if ends {
            return Some(Approach {
                node,
                step,
                late,
                speed: u1,
                gain: b2,
                surge,
                bend,
                end: (next, step - count * SPACING),
            });
        }
        node = next;
        late += count * SPACING;
    }
    None
}

/// Householder's third-order step on `u0 + u1 d + b2 d^2 + cos d^3 / 6`, from the square of `u1` and the
/// product `b2 u0`.
#[inline(always)]
pub(super) fn householder(u0: f32, u1: f32, square: f32, product: f32, cosine: f32) -> f32 {
    -u0 * (square - product) / (u1 * (square - 2.0 * product) + cosine * (1.0 / 6.0) * u0 * u0)
}
