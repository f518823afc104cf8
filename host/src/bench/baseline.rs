//! Baseline, independent of the kernels: the impact map by a textbook method in f64.

use std::f64::consts::{PI, TAU};

use kband::feeder::OutOfRange;
use kband::impact::{Impact, Kernel, Map, PartState};

/// Segments of constant sign of curvature, with Newton's method ([`newton`]).
#[derive(Clone, Copy, Debug)]
pub struct Textbook {
    k: f64,
    restitution: f64,
}

impl Kernel for Textbook {
    type State = PartState;

    const NAME: &'static str = "textbook";

    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        Map::build(k, restitution)?;
        Ok(Self { k, restitution })
    }

    fn state(phase: f64, velocity: f64) -> Result<PartState, OutOfRange> {
        Map::state(phase, velocity)
    }

    fn observe(state: PartState) -> PartState {
        state
    }

    fn impact(&self, launch: PartState) -> Impact<PartState> {
        let (s, c) = launch.phase.sin_cos();
        let [flight, arrival] = if launch.velocity == 0.0 && s < self.k {
            [0.0; 2]
        } else {
            newton(self.k, [s, c], launch)
        };
        let phase = launch.phase + flight;
        Impact {
            flight,
            next: PartState {
                phase: phase - TAU * (phase / TAU).floor(),
                velocity: self.restitution * arrival,
            },
            grazes: false,
        }
    }
}

/// Flight and arrival speed by Newton's method. Between the phases with `sin t = k` the gap is
/// convex or concave, so the method converges from an end of such a segment.
fn newton(k: f64, [s, c]: [f64; 2], launch: PartState) -> [f64; 2] {
    let PartState { phase, velocity } = launch;
    let v = velocity + c;
    let (lift_off, lift_off_cosine) = if k < 1.0 {
        (k.asin(), (1.0 - k * k).sqrt())
    } else {
        (0.5 * PI, 0.0)
    };
    let gap = |d: f64| {
        let (sh, ch) = (0.5 * d).sin_cos();
        let (middle_cosine, middle_sine) = (c * ch - s * sh, s * ch + c * sh);
        (
            d * (v - 0.5 * k * d) - 2.0 * middle_cosine * sh,
            velocity - k * d + 2.0 * middle_sine * sh,
        )
    };
    // At the ends of a segment the sine is k.
    let at_end = |d: f64| s - k.min(1.0) + d * (v - 0.5 * k * d);
    let mut convex = s > k && phase < PI;
    let mut low = 0.0;
    let mut high = if phase < lift_off {
        lift_off - phase
    } else if convex {
        PI - lift_off - phase
    } else {
        TAU + lift_off - phase
    };
    // Skips whole turns above the range of the track.
    let leaving = v * v - 2.0 * k * (1.0 - s);
    let (above_from, above_to) = if leaving > 0.0 && v > 0.0 {
        let root = leaving.sqrt();
        ((v - root) / k, (v + root) / k)
    } else {
        (0.0, 0.0)
    };
    let mut first = true;
    let d = loop {
        if low > above_from && high < above_to {
            let turns = ((above_to - high) / TAU).floor();
            low += turns * TAU;
            high += turns * TAU;
        }
        // Starts at the right end of a concave segment below 0, or at the left of a convex one.
        let (from, side) = if convex { (low, 1.0) } else { (high, -1.0) };
        let (u, slope) = (at_end(from), v - k * from - lift_off_cosine);
        let rising = first || slope >= 0.0;
        let open = if convex { rising } else { u > 0.0 };
        if !open && let Some(d) = monotone(gap, from - u / slope, side, high) {
            break d;
        }
        low = high;
        high += PI + 2.0 * side * lift_off;
        convex = !convex;
        first = false;
        if !low.is_finite() || low > 1e7 {
            break f64::NAN;
        }
    };
    [d, -gap(d).1]
}

/// The zero of the gap up to `high`, by Newton steps from the side with `side` times the gap > 0.
fn monotone(gap: impl Fn(f64) -> (f64, f64), mut d: f64, side: f64, high: f64) -> Option<f64> {
    for _ in 0..200 {
        let (u, slope) = gap(d);
        if d > high {
            return None;
        }
        if side * u <= 0.0 {
            break;
        }
        if slope >= 0.0 {
            return (side < 0.0).then_some(d);
        }
        let step = u / slope;
        d -= step;
        if step.abs() <= f64::EPSILON * d {
            break;
        }
    }
    Some(d)
}
