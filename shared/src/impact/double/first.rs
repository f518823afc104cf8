//! The first impact of a flight, by the kind of the flight.
//!
//! With `v = psi + cos t` the ball's height over the middle of the track's stroke is the parabola
//! `y(d) = sin t + v d - k d^2/2`; the gap to the track is `u(d) = y(d) - sin(t + d)`. A flight is
//!
//! - [`tall`]: it leaves height 1 faster than the track ever moves, so it meets the track once, in one
//!   monotone stretch;
//! - [`short`]: over within a fraction of a turn; solved for `u/d`, which keeps every digit down to the
//!   smallest hops;
//! - [once](low::once): over before the track next pushes as hard as k, or faster at height 1 than the
//!   track ever moves; so it meets the track once;
//! - [`low`]: anything else that closed forms can certify;
//! - left to [`search`] where a decision comes close to rounding.
//!
//! All but the last are written over [`Lane`]: one orbit or several side by side, the same bits. A flight
//! costs nearly its whole chain of dependent operations, as a CPU cannot hold enough of them waiting to
//! begin the next flight early. So the kinds are told apart early, each has a short chain of its own, and
//! sums are in the order in which their terms are ready. Those few that need another step take it in
//! [`hard`].

use super::launch::{Launch, Track};
use super::step::Landing;
use super::{low, search, short, tall};
use crate::arithmetic::lane::Lane;

/// The first impact after `launch`, and whether it grazes; `None` where the part rests.
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
    // By value: in memory the launch would delay the tall flights, too.
    not_tall(track, phase, velocity, sine, cosine)
}

/// [`first_impact`] of a flight that is not tall.
#[inline(never)]
fn not_tall(
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
        return Some(if f64::any(certain) {
            (landing, false)
        } else {
            hard_hop(track, &launch)
        });
    }
    let once = f64::any(launch.meets_once(track));
    let stretch = if once {
        low::once(track, &launch)
    } else {
        low::stretch(track, &launch)
    };
    let close = low::approach(track, &launch, &stretch);
    let (landing, certain) = low::landing(track, &launch, &stretch, &close);
    if !f64::any(certain) {
        return Some(hard(track, &launch, stretch));
    }
    Some((landing, false))
}

/// The first impact of a short flight of which the quick form is not certain, and whether it grazes.
#[cold]
pub(crate) fn hard_hop(track: &Track<f64>, launch: &Launch<f64>) -> (Landing<f64>, bool) {
    short::careful(track, launch)
        .map_or_else(|| searched(track, launch), |landing| (landing, false))
}

/// The same of a low flight, with the stretch that was found.
#[cold]
pub(crate) fn hard(
    track: &Track<f64>,
    launch: &Launch<f64>,
    stretch: low::Stretch<f64>,
) -> (Landing<f64>, bool) {
    low::careful(track, launch, stretch)
        .map_or_else(|| searched(track, launch), |landing| (landing, false))
}

/// The same of any flight, by the search.
#[cold]
pub(crate) fn searched(track: &Track<f64>, launch: &Launch<f64>) -> (Landing<f64>, bool) {
    search::landing(track, launch, search::PassedHumps::Skip)
}
