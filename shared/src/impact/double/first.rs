//! The first impact of a flight, by the kind of the flight.
//!
//! With `v = psi + cos t` the ball's height over the middle of the track's stroke is the parabola
//! `y(d) = sin t + v d - k d^2/2`. The gap to the track is `u(d) = y(d) - sin(t + d)`. The kinds:
//!
//! - [`tall`]: the ball leaves height 1 faster than the track's top speed; it meets the track once,
//!   in a monotone interval;
//! - [`short`]: the flight ends within a fraction of a turn; the root of `u/d`, which keeps every
//!   digit down to the smallest hops;
//! - [once](low::find_single_interval): the flight ends before the next hump, or exceeds the top
//!   speed at height 1; it meets the track once;
//! - [`low`]: any other flight that closed forms certify;
//! - [`search`]: a decision is close to rounding.
//!
//! All except the search are generic over [`Vector`]: one orbit or several side by side, with the
//! same bits. The latency of the chain of dependent operations sets the cost of a flight. So the
//! kinds branch early, each with its own short chain.

use super::launch::{Launch, Track};
use super::step::Landing;
use super::{low, search, short, tall};
use crate::arithmetic::vector::Vector;

/// The first impact after `launch`, and whether it grazes; `None` if the part rests.
#[inline(always)]
pub(crate) fn first_impact(
    track: &Track<f64>,
    launch: &Launch<f64>,
) -> Option<(Landing<f64>, bool)> {
    if f64::any(launch.is_tall(track)) {
        return Some((tall::landing(track, launch), false));
    }
    let Launch {
        phase,
        velocity,
        sine,
        cosine,
    } = *launch;
    // Passed by value: in memory the launch would also delay the tall flights.
    land_not_tall(track, phase, velocity, sine, cosine)
}

/// [`first_impact`] of a flight that is not tall.
#[inline(never)]
fn land_not_tall(
    track: &Track<f64>,
    phase: f64,
    velocity: f64,
    sine: f64,
    cosine: f64,
) -> Option<(Landing<f64>, bool)> {
    let launch = Launch {
        phase,
        velocity,
        sine,
        cosine,
    };
    if velocity <= 0.0 && f64::any(launch.rests(track)) {
        return None;
    }
    if f64::any(launch.is_short(track)) {
        let (landing, certain) = short::landing(track, &launch, short::guess(track, &launch));
        if f64::any(certain) {
            return Some((landing, false));
        }
        let landing = short::land_by_iteration(track, &launch);
        return Some(certainly(landing, track, &launch));
    }
    let one_root = f64::any(launch.has_one_root(track));
    let interval = if one_root {
        low::find_single_interval(track, &launch)
    } else {
        low::find_interval(track, &launch)
    };
    let estimate = low::approach(track, &launch, &interval);
    let (landing, certain) = low::landing(track, &launch, &interval, &estimate);
    if f64::any(certain) {
        return Some((landing, false));
    }
    let landing = low::land_by_iteration(track, &launch, interval);
    Some(certainly(landing, track, &launch))
}

/// A landing, or that of the search; and whether it grazes.
#[cold]
fn certainly(
    landing: Option<Landing<f64>>,
    track: &Track<f64>,
    launch: &Launch<f64>,
) -> (Landing<f64>, bool) {
    landing.map_or_else(
        || search::landing(track, launch),
        |landing| (landing, false),
    )
}
