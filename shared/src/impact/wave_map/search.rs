//! The certified search on a track of several tones, for decisions close to rounding
//! (docs/theory-impacts.md#t3.2).
//!
//! It visits the intervals between the edges in order. Where the push is below k the gap is
//! concave, so its sign at the end decides whether the interval holds the impact. Over a hump the
//! gap is convex, so the sign of its minimum decides. No impact can be missed, and every root is
//! bracketed.

use core::f64::consts::TAU;

use super::launch::Launch;
use super::short::deflated;
use super::track::{Hump, Track, ahead};
use crate::arithmetic::square_root;
use crate::arithmetic::vector::{Arc, Node, floor};
use crate::impact::double::bracket::{Gap, Path, impact_at_hump, root};
use crate::impact::double::low::ROUNDING_MARGIN;
use crate::impact::double::short::MAX_SHORT_HOP;
use crate::impact::double::step::Landing;
use crate::impact::wave::motion;

struct Flight<'a, const N: usize> {
    track: &'a Track,
    launch: &'a Launch,
}

/// The first impact after `launch`, and whether it grazes: another touch is within rounding.
#[cold]
pub(super) fn landing<const N: usize>(track: &Track, launch: &Launch) -> (Landing<f64>, bool) {
    let flight = Flight::<N> { track, launch };
    let humps = track.humps();
    let Some(first) = humps.first() else {
        // Concave throughout: below the track's reach there is no impact.
        let v = launch.rise();
        let max_speed = launch.speed_at(track, -track.wave.bottom).max(0.0);
        let high = (v + square_root(max_speed)) * track.per_k;
        return root(&flight, 0.0, high + 1e-9 * (1.0 + high), false);
    };
    // The hump that holds the launch. At lift-off, to rounding, a hump has begun.
    let lifting = launch.velocity == 0.0 && launch.at.jerk > 0.0;
    let within = |hump: &&Hump| {
        let elapsed = ahead(hump.begin.phase, launch.phase);
        elapsed < hump.width || (lifting && TAU - elapsed < 1e-6)
    };
    let begun = humps.iter().find(within);
    let mut low = begun.map_or(0.0, |hump| ahead(launch.phase, hump.end.phase));
    // The humps from the next one on.
    let wait = |hump: &Hump| {
        let wait = ahead(launch.phase, hump.begin.phase);
        let same_hump = begun.is_some_and(|begun| begun.begin.phase == hump.begin.phase);
        if wait == 0.0 || (same_hump && wait < 1.0) {
            wait + TAU
        } else {
            wait
        }
    };
    let mut next = 0;
    for (n, hump) in humps.iter().enumerate() {
        if wait(hump) < wait(humps.get(next).unwrap_or(first)) {
            next = n;
        }
    }
    let (above_from, above_to) = flight.time_above_reach();
    let mut turns = 0.0;
    let mut grazes = false;
    loop {
        let mut latest = 0.0;
        for n in 0..humps.len() {
            let hump = humps.get((next + n) % humps.len()).unwrap_or(first);
            let begin = wait(hump) + turns;
            let at_begin = flight.at(begin);
            let end = begin + hump.width;
            let passes = above_from <= begin && end <= above_to;
            let times = [low, begin, end];
            if let Some(landing) = impact_at_hump(&flight, at_begin, times, passes, &mut grazes) {
                return landing;
            }
            low = end;
            latest = end;
        }
        turns += TAU;
        // Skips every turn whose humps begin and end while the ball is above the track's reach.
        if above_from <= turns {
            let skipped = floor((above_to - (latest + TAU)) * (1.0 / TAU));
            if skipped > 0.0 {
                turns += skipped * TAU;
                low = latest + skipped * TAU;
            }
        }
    }
}

impl<const N: usize> Flight<'_, N> {
    /// Begin and end in rad of the ball's time above the track's reach.
    fn time_above_reach(&self) -> (f64, f64) {
        let v = self.launch.rise();
        let leaving = self.launch.speed_at(self.track, self.track.wave.top) - ROUNDING_MARGIN;
        if v > 0.0 && leaving > 0.0 {
            let root = square_root(leaving);
            let per_k = self.track.per_k;
            ((v - root) * per_k, (v + root) * per_k * (1.0 - 1e-12))
        } else {
            (f64::INFINITY, 0.0)
        }
    }
}

impl<const N: usize> Path for Flight<'_, N> {
    const MAX_SHORT_HOP: f64 = MAX_SHORT_HOP / N as f64;

    fn hop(&self) -> Option<f64> {
        let pull = self.launch.pull(self.track);
        (pull > 0.0).then(|| 2.0 * self.launch.velocity / pull)
    }

    fn at(&self, d: f64) -> Gap {
        let (track, launch) = (self.track, self.launch);
        let pull = launch.pull(track);
        if d < Self::MAX_SHORT_HOP {
            let w = deflated::<N>(track, launch, d);
            let forward = launch.phase + d;
            let phase = if forward < TAU {
                forward
            } else {
                ((launch.phase - TAU) + d).max(0.0)
            };
            let forces = pull.abs() + track.k + track.wave.peak_acceleration();
            let turning = d * launch.at.jerk.abs();
            return Gap {
                value: d * w.value,
                slope: w.slope,
                curvature: w.curvature,
                phase,
                rounding: f64::EPSILON * d * (launch.velocity + d * (forces + turning)),
            };
        }
        let node = Node::near(launch.phase, d);
        let x = d - node.distance;
        let arc = Arc::new(x);
        let sine = node.sine + (node.cosine * arc.sine - node.sine * arc.versine);
        let cosine = node.cosine - (node.sine * arc.sine + node.cosine * arc.versine);
        let at = motion::<N>(&track.wave.parts::<N>(sine, cosine));
        let v = launch.rise();
        let speed = v - track.k * node.distance;
        Gap {
            value: (launch.height(track, node.distance) - at.height)
                + x * (speed - 0.5 * track.k * x),
            slope: (speed - track.k * x) - at.speed,
            curvature: at.push - track.k,
            phase: node.phase(x),
            rounding: f64::EPSILON * (8.0 + d * (4.0 + v.abs() + track.k * d)),
        }
    }
}
