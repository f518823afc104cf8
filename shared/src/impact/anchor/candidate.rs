//! Candidate: a place where the first impact of a low flight may be, without a search.
//!
//! It comes from the roots of the cubic near launch, or from the fall of the parabola.

use core::f32::consts::TAU;

use super::approach::{Approach, approach};
use super::flight::{Launch, RADIANS_PER_STEP, Track, node_from_near, root};
use super::short::{MAX_DOUBLE_ROOT_DISCRIMINANT, hop, is_flat};
use super::sine_track::SineTrack;
use crate::arithmetic::square_root_single;

// The thresholds below choose between two ways to the same impact. Their cost was measured over
// 200 000 launches per set: velocities 0..3, near lift-off, and nearly touching a hump.

/// Longest flight time in rad that starts from the cubic near launch, which is inaccurate beyond.
const MAX_START_FROM_LAUNCH: f32 = 4.0;

/// Share of `a1^2` by which the cubic's discriminant may be negative: omitted terms may make its
/// roots real. It affects cost only.
pub(super) const MAX_NEGATIVE_DISCRIMINANT: f32 = 0.06;

/// Flight time in rad up to which one correction covers the next two terms.
const MAX_CORRECTED_FLIGHT: f32 = 1.0;

/// Smallest discriminant, over `a1^2`, for the correction, which divides by its root. The slope is
/// then at least a seventh of `a1`.
const MIN_DISCRIMINANT_RATIO: f32 = 0.02;

/// Smallest squared speed at height 0 for an approach from the fall.
pub(super) const MIN_FALL_SPEED_SQUARED: f32 = 0.1;

/// Flight time in rad beyond a turn from lift-off up to which a fall can end. It covers the end of
/// the hump after the next and the error of the crossing of height 0.
pub(super) const MAX_FALL_BEYOND_TURN: f32 = 0.5;

pub(super) enum Candidate {
    /// A short hop: flight in rad and arrival speed, both final.
    Hop { flight: f32, arrival: f32 },
    /// The end of an approach, if that is the first.
    Near(Approach),
}

/// A candidate from the flight near launch or the fall of the parabola; `None` without a search.
///
/// Up to the end of the next hump the first down-crossing is the first impact:
///
/// - In that hump `u` is convex, so it is above 0 from the hump's begin on, and also on the concave
///   interval before.
/// - On the concave interval from launch the down-crossing ends the interval above 0.
/// - From within a hump `u` rises to the concave interval.
///
/// See [`SineTrack::ends`].
#[inline(always)]
pub(super) fn candidate(track: &SineTrack, launch: &Launch) -> Option<Candidate> {
    let (velocity, sine, cosine) = (launch.velocity, launch.sine, launch.cosine);
    // u/d = psi - a1 d + a2 d^2 - sin d^3 / 24 - cos d^4 / 120 + sin d^5 / 720 + ...
    let a1 = 0.5 * launch.pull;
    let a2 = cosine * (1.0 / 6.0);
    let discriminant = a1 * a1 - 4.0 * a2 * velocity;
    let mut near = MAX_START_FROM_LAUNCH;
    // Below the lower bound the flight clears the coming hump, or nearly so.
    let square = a1 * a1;
    if a1 > 0.0 && discriminant > -MAX_NEGATIVE_DISCRIMINANT * square {
        let slope = root(discriminant);
        near = 2.0 * velocity / (a1 + slope);
        if near < SineTrack::MAX_SHORT_FLIGHT {
            if discriminant < MAX_DOUBLE_ROOT_DISCRIMINANT * square || is_flat(launch) {
                return None;
            }
            let (flight, arrival) = hop(launch, near);
            return Some(Candidate::Hop { flight, arrival });
        }
        if near < MAX_CORRECTED_FLIGHT && discriminant > MIN_DISCRIMINANT_RATIO * square {
            let z = near * near;
            let third = cosine * near;
            let over = sine * (1.0 / 24.0 - z * (1.0 / 720.0)) + third * (1.0 / 120.0);
            let steeper = slope + z * (sine * (1.0 / 8.0) + third * (1.0 / 30.0));
            let inverse = 1.0 / steeper;
            let newton = z * near * over * inverse;
            let quadratic = (a2 - sine * (1.0 / 8.0) * near) * inverse;
            near -= newton * (1.0 - newton * quadratic);
        }
    } else if a1 <= 0.0 && a2 < 0.0 {
        near = (a1 - square_root_single(discriminant)) / (a2 + a2);
        if near < SineTrack::MAX_SHORT_FLIGHT {
            return None;
        }
    }
    let rise = velocity + cosine;
    let (mut speed, mut origin, mut base) = (-rise, 0.0, sine);
    if near >= MAX_START_FROM_LAUNCH {
        let square = rise * rise + 2.0 * track.gravity.k * sine;
        if !(rise > 0.0 && square > MIN_FALL_SPEED_SQUARED) {
            return None;
        }
        speed = square_root_single(square);
        origin = (rise + speed) * track.gravity.inverse;
        // Leaves flights that end after the hump after the next one to the search.
        let to_lift_off = track.lift_off.wrapping_sub(launch.phase) as f32 * RADIANS_PER_STEP;
        if origin > to_lift_off + (TAU + MAX_FALL_BEYOND_TURN) {
            return None;
        }
        near = origin;
        base = 0.0;
    }
    let (node, offset) = node_from_near(launch.phase, near);
    let dt = (near - origin) - offset;
    approach(track, node, dt, speed, base)
        .filter(|approach| approach.preserves_distance(node, dt))
        .map(Candidate::Near)
}
