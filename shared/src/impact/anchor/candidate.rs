//! Where the first impact of a low flight may be, without a search.

use core::f32::consts::TAU;

use super::approach::{Approach, approach};
use super::flight::{Flight, Launch, RADIANS_PER_STEP, root};
use super::shape::Shape;
use super::short::{DOUBLE, hop, is_flat};
use crate::arithmetic::square_root_single;

// The thresholds below choose between two ways to the same impact. What they cost was measured over
// 200 000 launches a set: velocities 0..3, near lift-off, and such that all but touch a hump.

/// No start near launch is farther, in rad: there the cubic does not tell. At 2 more flights are searched
/// (6.2 % of those below velocity 3, for 3.5 %), at 8 few less (3.1 %) for 3 % more steps.
const FAR: f32 = 4.0;

/// The cubic's roots may be complex by this share of `a1^2` and still start an approach, as terms left out
/// may make them real. Cost alone: between 0 and 1 it moves only flights that all but touch a hump.
pub(super) const NEARLY_REAL: f32 = 0.06;

/// Flights up to this many rad are corrected by the next two terms at once. Tuned: at 2 more flights are
/// searched (5.4 % for 3.5 %), at 4 `kernels_survive_their_whole_range` fails; at 0.5 it takes 4 % more
/// steps.
const CORRECTED: f32 = 1.0;

/// The correction divides by the root of the discriminant, which must be this share of `a1^2`: its slope is
/// then at least a seventh of `a1`.
const STEEP: f32 = 0.02;

/// The least square of the speed at height 0 of a fall that an approach starts from; below, the parabola
/// hardly reaches the middle of the stroke. At 0.4 a twentieth more flights are searched, at 0 no fewer.
pub(super) const LEAST: f32 = 0.1;

/// How far beyond a turn from lift-off a fall may end, in rad: the end of the hump after the next and what
/// the crossing of height 0 is off by. At 3 a tenth fewer launches near lift-off are searched, for as many
/// more steps.
pub(super) const BEYOND: f32 = 0.5;

/// Where the first impact of a low flight may be.
pub(crate) enum Candidate {
    /// A short hop: flight in rad and arrival speed, final.
    Hop { flight: f32, arrival: f32 },
    /// Near `offset` rad from a node, if a down-crossing there is the first.
    Near { node: i32, offset: f32 },
    /// At the end of an approach that is [`Flight::FINAL`], if that is the first.
    Final(Approach),
    /// Nowhere that is told so quickly.
    Unknown,
}

/// A candidate from the flight near launch or the fall of the parabola.
///
/// Up to the end of the next hump a down-crossing is the first impact: it may lie in that hump, where `u`
/// is convex and so above it from its begin on, and where `u` is above 0 at its begin it is above 0 on
/// the concave stretch from launch; or it lies on that stretch, which it ends. From within a hump `u`
/// rises to the stretch. See [`Shape::ends`].
#[inline(always)]
pub(crate) fn candidate<F: Flight>(shape: &Shape, launch: &Launch) -> Candidate {
    let Launch {
        velocity,
        sine,
        cosine,
        pull,
        ..
    } = *launch;
    // u/d = psi - a1 d + a2 d^2 - sin d^3 / 24 - cos d^4 / 120 + sin d^5 / 720 + ...
    let a1 = 0.5 * pull;
    let a2 = cosine * (1.0 / 6.0);
    let discriminant = a1 * a1 - 4.0 * a2 * velocity;
    let mut near = FAR;
    // Below the lower bound it clears the coming hump, or nearly so.
    let square = a1 * a1;
    if a1 > 0.0 && discriminant > -NEARLY_REAL * square {
        let slope = root(discriminant);
        near = 2.0 * velocity / (a1 + slope);
        if near < F::SHORT {
            if discriminant < DOUBLE * square || is_flat::<F>(launch) {
                return Candidate::Unknown;
            }
            let (flight, arrival) = hop(launch, near);
            return Candidate::Hop { flight, arrival };
        }
        if near < CORRECTED && discriminant > STEEP * square {
            let z = near * near;
            let third = cosine * near;
            let over = sine * (1.0 / 24.0 - z * (1.0 / 720.0)) + third * (1.0 / 120.0);
            let steeper = slope + z * (sine * (1.0 / 8.0) + third * (1.0 / 30.0));
            let inverse = 1.0 / steeper;
            let newton = z * near * over * inverse;
            let bend = (a2 - sine * (1.0 / 8.0) * near) * inverse;
            near -= newton * (1.0 - newton * bend);
            if !F::FINAL {
                let (node, offset) = F::node_of(launch.phase, near);
                return Candidate::Near { node, offset };
            }
        }
    } else if a1 <= 0.0 && a2 < 0.0 {
        near = (a1 - square_root_single(discriminant)) / (a2 + a2);
        if near < F::SHORT {
            return Candidate::Unknown;
        }
    }
    let rise = velocity + cosine;
    let (mut speed, mut origin, mut base) = (-rise, 0.0, sine);
    if near >= FAR {
        let square = rise * rise + 2.0 * shape.k * sine;
        if !(rise > 0.0 && square > LEAST) {
            return Candidate::Unknown;
        }
        speed = square_root_single(square);
        origin = (rise + speed) * shape.inverse;
        // No flight that ends after the hump after the next one is told here.
        let to_lift_off = shape.lift_off.wrapping_sub(launch.phase) as f32 * RADIANS_PER_STEP;
        if origin > to_lift_off + (TAU + BEYOND) {
            return Candidate::Unknown;
        }
        near = origin;
        base = 0.0;
    }
    let (node, offset) = F::node_of(launch.phase, near);
    let late = (near - origin) - offset;
    match approach::<F>(shape, node, late, speed, base) {
        Some(approach) if F::FINAL && approach.has_kept(node, late) => Candidate::Final(approach),
        Some(_) if F::FINAL => Candidate::Unknown,
        Some(approach) => {
            let (node, offset) = approach.end;
            Candidate::Near { node, offset }
        }
        None => Candidate::Unknown,
    }
}
