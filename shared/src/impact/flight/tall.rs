//! Tall flights: the ball leaves height 1 faster than the track ever moves.
//!
//! It then returns through height 1 as fast, so no earlier impact is possible and the gap is monotone
//! where it ends: `-V x - k x^2/2 = sin(phi + x)`, with V the ball's speed through height 0, is Kepler's
//! equation with eccentricity 1/V < 1 bent by the parabola. From the crossing of height 0 one step of
//! third order and one reverted series reach rounding.

use super::{Landing, Launch, Track, finish, householder};
use crate::arithmetic::lane::{Lane, Node};

/// Smallest square of the speed at height 1 of a tall flight. The certificate holds from 1; from here
/// on one step of third order comes within 2e-3 of the root.
pub(crate) const LEAVING: f64 = 4.0;

/// The end of a tall flight.
#[inline(always)]
pub(crate) fn landing<L: Lane>(track: &Track<L>, launch: &Launch<L>) -> Landing<L> {
    let v = launch.rise();
    let fall = (v * v + (track.k + track.k) * launch.sine).sqrt();
    let crossing = (v + fall) * track.per_k;
    let node = Node::near(launch.phase, crossing);
    let past = node.distance - crossing;
    // Relative to the crossing nothing cancels: y = -past (V + k past/2).
    let value = -(past * (fall + track.half() * past) + node.sine);
    let slope = -((fall + track.k * past) + node.cosine);
    let step = householder(
        value,
        slope,
        (node.sine - track.k) * L::splat(0.5),
        node.cosine * L::splat(1.0 / 6.0),
    );
    finish(track, launch, node.distance + step).0
}
