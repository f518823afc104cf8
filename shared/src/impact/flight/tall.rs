//! Tall flights: the ball leaves height 1 faster than the track ever moves.
//!
//! It then returns through height 1 as fast, so no earlier impact is possible and the gap is monotone
//! where it ends: `-V x - k x^2/2 = sin(phi + x)`, with V the ball's speed through height 0, is Kepler's
//! equation with eccentricity 1/V < 1 bent by the parabola. From the crossing of height 0 two steps
//! of fourth order, each on a node of the table, reach rounding.

use super::{Landing, Launch, Near, Track, householder};
use core::f64::consts::TAU;

use crate::arithmetic::lane::{Lane, ROUNDER};
use crate::arithmetic::node;

/// Smallest square of the speed at height 1 of a tall flight. The certificate holds from 1; from here
/// on one step of fourth order comes within 1.4e-3 of the root (4.2e-4 from 4 on, 9e-5 from 6 on, up to 400):
/// measured over 200 000 states in each of five ranges of it, k in 0.02..0.98. What the second then leaves is in
/// the residual that the golden data are held against.
pub(crate) const LEAVING: f64 = 3.0;

/// When the ball falls through height 0, and how fast.
#[derive(Clone, Copy)]
pub(crate) struct Crossing<L> {
    /// Time after launch.
    pub time: L,
    /// Speed downwards.
    pub speed: L,
}

/// The crossing that a tall flight starts from, to the 24 bits of a rough square root: 2e-8 of the flight.
#[inline(always)]
pub(crate) fn crossing<L: Lane>(track: &Track<L>, launch: &Launch<L>) -> Crossing<L> {
    let v = launch.rise();
    let speed = launch.level(track).rough_sqrt();
    Crossing {
        time: ((v + speed) * track.per_k).lone(),
        speed,
    }
}

/// A flight time within 1.4e-3 of the impact.
#[inline(always)]
pub(crate) fn approach<L: Lane>(track: &Track<L>, launch: &Launch<L>, crossing: &Crossing<L>) -> L {
    let per_node = L::splat(node::COUNT as f64 / TAU);
    let nodes = crossing.time * per_node + launch.phase * per_node;
    let rounded = nodes + L::splat(ROUNDER);
    let (sine, cosine) = L::node(rounded);
    let past = ((rounded - L::splat(ROUNDER)) - nodes) * L::splat(node::SPACING);
    // Relative to the crossing nothing cancels: y = -past (V + k past/2).
    let gained = track.half() * past;
    let mean = crossing.speed + gained;
    let below = past * mean + sine;
    let speed = (mean + gained) + cosine;
    let back = householder(below, speed, track.k - sine, -cosine, sine);
    crossing.time + (past - back)
}

/// The end of a tall flight.
#[inline(always)]
pub(crate) fn landing(track: &Track<f64>, launch: &Launch<f64>) -> Landing<f64> {
    let crossing = crossing(track, launch);
    let close = approach(track, launch, &crossing);
    Near::at(track, launch, close).finish(track)
}
