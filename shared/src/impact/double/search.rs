//! The certified search, for decisions close to rounding (docs/theory-impacts.md#t3.2).
//!
//! It visits the intervals of the track in order. Between humps the gap is concave, so its sign at
//! the end decides whether the interval has the impact. Over a hump the gap is convex, so the sign
//! of its minimum decides. No impact can be missed, and every root is bracketed.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use super::bracket::{Gap, Path, impact_at_hump};
use super::launch::{Launch, Track};
use super::short::{MAX_SHORT_HOP, deflated};
use super::step::{Landing, Local};
use crate::arithmetic::square_root;
use crate::arithmetic::vector::{Arc, floor};

struct Flight<'a> {
    track: &'a Track<f64>,
    launch: &'a Launch<f64>,
}

impl Path for Flight<'_> {
    const MAX_SHORT_HOP: f64 = MAX_SHORT_HOP;

    fn at(&self, d: f64) -> Gap {
        let Flight { track, launch } = *self;
        let (s, c, psi) = (launch.sine, launch.cosine, launch.velocity);
        if d < MAX_SHORT_HOP {
            let pull = track.k - s;
            let w = deflated(pull, launch, d);
            let ahead = launch.phase + d;
            let phase = if ahead < TAU {
                ahead
            } else {
                ((launch.phase - TAU) + d).max(0.0)
            };
            let forces = pull.abs() + track.k + 1.0;
            return Gap {
                value: d * w.value,
                slope: w.slope,
                curvature: w.curvature,
                phase,
                rounding: f64::EPSILON * d * (psi + d * forces + d * d * c.abs()),
            };
        }
        let local = Local::at_nearest_node(track, launch, d);
        let node = &local.node;
        let x = d - node.distance;
        let arc = Arc::new(x);
        let turning = node.sine * arc.sine + node.cosine * arc.versine;
        let v = launch.rise();
        Gap {
            value: local.value
                + (x * (local.slope - 0.5 * track.k * x)
                    + (node.sine * arc.versine + node.cosine * arc.sagitta)),
            slope: local.slope + (turning - track.k * x),
            curvature: node.sine + (node.cosine * arc.sine - node.sine * arc.versine) - track.k,
            phase: node.phase(x),
            rounding: f64::EPSILON * (2.0 + d * (v.abs() + track.k * d)),
        }
    }

    fn hop(&self) -> Option<f64> {
        let pull = self.track.k - self.launch.sine;
        (pull > 0.0).then(|| 2.0 * self.launch.velocity / pull)
    }
}

/// The first impact after `launch`, and whether it grazes: another touch is within rounding.
#[cold]
pub(crate) fn landing(track: &Track<f64>, launch: &Launch<f64>) -> (Landing<f64>, bool) {
    let path = Flight { track, launch };
    let v = launch.rise();
    let leaving = launch.speed_squared_at_crest(track);
    // While the ball is above height 1 no hump reaches it.
    let (above_from, above_to) = if v > 0.0 && leaving > 0.0 {
        let root = square_root(leaving);
        ((v - root) * track.per_k, (v + root) * track.per_k)
    } else {
        (f64::INFINITY, 0.0)
    };
    let width = 2.0 * (FRAC_PI_2 - track.lift_off);
    let hump_end = PI - track.lift_off;
    // At rest up to lift-off, or one rounding before it: the hump has begun.
    let lifting = launch.velocity == 0.0 && launch.cosine > 0.0 && launch.phase < hump_end;
    let (mut low, first) = if launch.phase < track.lift_off && !lifting {
        (0.0, track.lift_off - launch.phase)
    } else if launch.phase < hump_end {
        (
            hump_end - launch.phase,
            (track.lift_off - launch.phase) + TAU,
        )
    } else {
        (0.0, (track.lift_off - launch.phase) + TAU)
    };
    let mut turns = 0.0;
    let mut grazes = false;
    loop {
        let begin = first + turns * TAU;
        let mut at_begin = path.at(begin);
        if begin >= MAX_SHORT_HOP {
            // The track's acceleration passes k going up here.
            at_begin.value = launch.height(track, begin) - track.k.min(1.0);
            at_begin.slope = (launch.rise() - track.k * begin) - track.lift_off_cosine;
        }
        let end = begin + width;
        let passes = above_from <= begin && end <= above_to;
        let times = [low, begin, end];
        if let Some(landing) = impact_at_hump(&path, at_begin, times, passes, &mut grazes) {
            return landing;
        }
        low = end;
        turns += 1.0;
        // Skips every hump that begins and ends while the ball is above height 1.
        let next = first + turns * TAU;
        if above_from <= next {
            let skipped = floor((above_to - (next + width)) * (1.0 / TAU));
            if skipped > 0.0 {
                turns += skipped;
                low = first + (turns - 1.0) * TAU + width;
            }
        }
    }
}
