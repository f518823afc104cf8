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

/// When the ball falls through height 0, and how fast.
#[derive(Clone, Copy)]
pub(crate) struct Crossing<L> {
    /// Time after launch.
    time: L,
    /// Speed downwards.
    speed: L,
}

impl<L: Lane> Crossing<L> {
    /// A place to put one.
    pub fn none() -> Self {
        let zero = L::splat(0.0);
        Self {
            time: zero,
            speed: zero,
        }
    }
}

/// The crossing that a tall flight starts from.
#[inline(always)]
pub(crate) fn crossing<L: Lane>(track: &Track<L>, launch: &Launch<L>) -> Crossing<L> {
    let v = launch.rise();
    let speed = (v * v + (track.k + track.k) * launch.sine).sqrt();
    Crossing {
        time: (v + speed) * track.per_k,
        speed,
    }
}

/// A flight time within 2e-3 of the impact.
#[inline(always)]
pub(crate) fn approach<L: Lane>(track: &Track<L>, launch: &Launch<L>, crossing: &Crossing<L>) -> L {
    let node = Node::near(launch.phase, crossing.time);
    let past = node.distance - crossing.time;
    // Relative to the crossing nothing cancels: y = -past (V + k past/2).
    let value = -(past * (crossing.speed + track.half() * past) + node.sine);
    let slope = -((crossing.speed + track.k * past) + node.cosine);
    let step = householder(
        value,
        slope,
        (node.sine - track.k) * L::splat(0.5),
        node.cosine * L::splat(1.0 / 6.0),
    );
    node.distance + step
}

/// The end of a tall flight.
#[inline(always)]
pub(crate) fn landing(track: &Track<f64>, launch: &Launch<f64>) -> Landing<f64> {
    let d = approach(track, launch, &crossing(track, launch));
    finish(track, launch, d).0
}
