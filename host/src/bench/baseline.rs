//! Baselines: the impact map by textbook methods, in f64 with the platform's sine. They share no
//! code with the kernels.

use std::f64::consts::{PI, TAU};

use kband::feeder::OutOfRange;
use kband::impact::{Impact, Kernel, Map, PartState};

/// Scan and bracket: the general event detector ([`bracket`]).
pub type Bracket = Baseline<true>;
/// Segments of one curvature and Newton's method ([`newton`]).
pub type Textbook = Baseline<false>;

/// The impact map by scan and bracket, or by the textbook's method.
#[derive(Clone, Copy, Debug)]
pub struct Baseline<const BRACKET: bool> {
    k: f64,
    restitution: f64,
}

impl<const BRACKET: bool> Kernel for Baseline<BRACKET> {
    type State = PartState;

    const NAME: &'static str = if BRACKET { "bracket" } else { "textbook" };

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
        } else if BRACKET {
            bracket(self.k, [s, c], launch)
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

/// Flight and speed of arrival: a scan in steps of 0.05 rad until the gap changes sign, then the
/// Illinois method (Dowell & Jarratt 1971).
///
/// It can step over a graze and misses hops shorter than its step.
fn bracket(k: f64, [s, c]: [f64; 2], launch: PartState) -> [f64; 2] {
    const STEP: f64 = 0.05;
    let PartState { phase, velocity } = launch;
    let gap = |d: f64| (velocity + c) * d - 0.5 * k * d * d - ((phase + d).sin() - s);
    let (mut low, mut high) = (1e-9, STEP);
    let (mut at_low, mut at_high) = (gap(low), gap(high));
    while at_high > 0.0 && high < 1e6 {
        (low, at_low) = (high, at_high);
        high += STEP;
        at_high = gap(high);
    }
    for _ in 0..100 {
        let d = high - at_high * (high - low) / (at_high - at_low);
        let step = d - high;
        let u = gap(d);
        // The end that stays counts half, or it would stay for ever.
        if (u > 0.0) == (at_high > 0.0) {
            at_low *= 0.5;
        } else {
            (low, at_low) = (high, at_high);
        }
        (high, at_high) = (d, u);
        if step.abs() <= 4.0 * f64::EPSILON * d || u == 0.0 {
            break;
        }
    }
    [high, k * high + (phase + high).cos() - c - velocity]
}

/// Flight and speed of arrival by Newton's method, segment by segment.
///
/// Between the phases with `sin t = k` the gap is convex or concave, so the method converges
/// monotonically from an end of the segment.
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
    // At a segment's end the gap needs no sine.
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
    // Skips whole turns above the track's reach.
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
        // From the right end of a concave segment that ends below 0, from the left of a convex one.
        let (from, side) = if convex { (low, 1.0) } else { (high, -1.0) };
        let (u, slope) = (at_end(from), v - k * from - lift_off_cosine);
        let open = if convex {
            first || slope >= 0.0
        } else {
            u > 0.0
        };
        if !open && let Some(d) = monotone(gap, from - u / slope, side, high) {
            break d;
        }
        low = high;
        high += if convex {
            PI + 2.0 * lift_off
        } else {
            PI - 2.0 * lift_off
        };
        convex = !convex;
        first = false;
        if !low.is_finite() || low > 1e7 {
            break f64::NAN;
        }
    };
    [d, -gap(d).1]
}

/// The zero where the gap falls, up to `high`, by steps from one side: the gap times `side` is
/// above 0 before it.
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
