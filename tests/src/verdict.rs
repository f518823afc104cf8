//! Verdict on whether a kernel's impact is the first one.

use std::f64::consts::TAU;

use kband::impact::{Impact, Integer, Kernel, Map, PartState, Single, WaveMap};

use crate::oracle::Flight;
use crate::states::Launch;

/// A launch and its first impact, proven once for all arithmetics with this launch.
pub struct Proof {
    pub launch: Launch,
    first: Flight,
}

impl Proof {
    pub fn new(launch: Launch) -> Self {
        let PartState { phase, velocity } = launch.state();
        let first = launch.track.first_impact(phase, velocity);
        Self { launch, first }
    }

    /// Distance in rad from the launch to the phase at which the track's downward acceleration
    /// crosses k.
    pub fn distance_to_edge(&self) -> f64 {
        let [excess, surge] = self.launch.excess();
        (excess / surge).abs()
    }
}

/// The oracle's verdict on one impact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// The first root, or a rest where the part rests.
    First,
    /// Another root, which the kernel flags as uncertain within rounding.
    Flagged,
    /// Undecided within the oracle's rounding. The root is later than the oracle's, whose touch is
    /// within rounding, or it is an earlier touch within rounding. Or another root, because the
    /// rounding of `A - k` decides between a hop and a throw.
    Undecided,
}

/// A kernel under test, with the effect of its rounding on the gap.
pub trait Tried: Kernel {
    /// Rounding of the gap `d` after launch.
    fn rounding(launch: &Launch, d: f64) -> f64;
    /// Resolution of a flight time, and of a velocity.
    const STEPS: [f64; 2];
}

/// Resolution of a phase, rad.
const STEP: f64 = TAU / 4_294_967_296.0;
/// Resolution of a velocity in integers.
const VELOCITY_STEP: f64 = 1.0 / 67_108_864.0;

impl Tried for Map {
    fn rounding(launch: &Launch, d: f64) -> f64 {
        launch.rounding(d)
    }
    const STEPS: [f64; 2] = [0.0; 2];
}

impl Tried for WaveMap {
    fn rounding(launch: &Launch, d: f64) -> f64 {
        4.0 * launch.rounding(d)
    }
    const STEPS: [f64; 2] = [0.0; 2];
}

impl Tried for Integer {
    fn rounding(_: &Launch, d: f64) -> f64 {
        // Slopes have a resolution of 2^-56.
        1e-15 * d.min(1.0) + 1e-15 * d
    }
    const STEPS: [f64; 2] = [STEP, VELOCITY_STEP];
}

impl Tried for Single {
    fn rounding(launch: &Launch, d: f64) -> f64 {
        8.0 * launch.rounding(d) * (f64::from(f32::EPSILON) / f64::EPSILON)
    }
    const STEPS: [f64; 2] = [STEP, 1e-30];
}

/// Whether the rounding of `A - k`, or some steps of the phase, decide at launch between a tiny hop
/// and a throw. Near launch the gap is `psi d - (k - A) d^2/2 + A' d^3/6`, with two roots or none.
pub(crate) fn is_left_open(launch: &Launch, step: f64) -> bool {
    let [excess, surge] = launch.excess();
    if surge <= 0.0 {
        return false;
    }
    // Excess at which both roots coincide.
    let level = (8.0 / 3.0 * surge * launch.velocity).sqrt();
    let [_, _, pushes, jerk, _] = launch.track.sums();
    (level + excess).abs() <= f64::EPSILON * pushes + 6.0 * step * jerk
}

/// Compares an arithmetic's impact with the proof of its launch; the error states the cause.
///
/// # Errors
/// A wrong root without a flag, a number that is not finite, a phase outside the turn, or a
/// negative velocity. Also a speed or phase that does not agree with the flight.
pub(crate) fn judge<K: Tried>(
    proof: &Proof,
    impact: &Impact<PartState>,
) -> Result<Verdict, String> {
    let [step, velocity_step] = K::STEPS;
    let Proof { launch, first } = proof;
    let truth = first.duration;
    let (restitution, phase, velocity) = (launch.restitution, launch.phase, launch.velocity);
    let (d, next) = (impact.flight, impact.next);
    if !(d.is_finite() && d >= 0.0) {
        return Err("flight".into());
    }
    if !(next.velocity.is_finite() && next.velocity >= 0.0) {
        return Err("velocity".into());
    }
    if !(0.0..TAU).contains(&next.phase) {
        return Err("phase".into());
    }
    let [excess, surge] = launch.excess();
    // Downward acceleration and k are rounded to half a unit of their terms, and the lift-off phase
    // to its step.
    let [_, _, pushes, jerk, _] = launch.track.sums();
    let level = 4.0 * f64::EPSILON * pushes + step * jerk;
    if d == 0.0 && velocity == 0.0 {
        let rests = (excess <= level).then_some(Verdict::First);
        return rests.ok_or("rests though it is thrown".into());
    }
    if velocity < 1e-22 && excess.abs() <= level && surge.abs() < 5e-5 {
        // At the flat top of the track only rounding decides whether the part is thrown.
        return Ok(Verdict::First);
    }
    let turns = (phase + d - next.phase) / TAU;
    if (turns - turns.round()).abs() > 2.0 * f64::EPSILON * (2.0 + d) {
        return Err("phase is not that of the flight".into());
    }
    let near = |d: f64, truth: f64| {
        let [height, slope, curvature] = launch.gap(d);
        let noise = K::rounding(launch, d.max(truth));
        // Shift of the root by that noise: linear at a fast arrival, a square root at a double
        // root.
        let moved = if slope * slope > 4.0 * curvature.abs() * noise {
            noise / slope.abs()
        } else {
            (noise / curvature.abs().max(1e-300)).sqrt().min(d)
        };
        let moved = moved + f64::EPSILON * d + step;
        (height, slope, curvature, noise, moved)
    };
    let (height, slope, curvature, noise, moved) = near(d, d);
    // Error of a simple root, from its residual.
    let off = height.abs() / slope.abs();
    let simple = slope < 0.0 && off * curvature.abs() < 0.1 * slope.abs();
    let nothing = 64.0 * step;
    // A hop of a few steps of the flight time.
    let hops = nothing > 0.0 && d <= nothing && launch.gap(nothing)[0] <= 0.0;
    if !(hops || simple && off <= 64.0 * moved && (d - truth).abs() <= 64.0 * moved) {
        let (.., moved) = near(d, truth);
        let deviation = (d - truth).abs() / moved;
        if deviation > 64.0 {
            if impact.grazes {
                return Ok(Verdict::Flagged);
            }
            if is_left_open(launch, step) && (d < 1e-12 || height.abs() <= 64.0 * noise) {
                return Ok(Verdict::Undecided);
            }
            let touch = launch.gap(truth)[0].abs();
            if d > truth && touch <= launch.rounding(truth) {
                let [height, slope, _] = launch.gap(d);
                let room = 64.0 * (K::rounding(launch, d) + moved * slope.abs());
                if velocity * d > 1e-3 && slope < 0.0 && height.abs() <= room {
                    return Ok(Verdict::Undecided);
                }
            }
            // The oracle may step over a touch within its rounding.
            if d < truth && height.abs() <= 64.0 * noise && first.clearance < 1.0 {
                return Ok(Verdict::Undecided);
            }
            let off = format!("off by {deviation:e}");
            return Err(format!("wrong root, expected flight {truth:e}, {off}"));
        }
    }
    if nothing > 0.0 && d <= nothing {
        let fastest = velocity + nothing * (excess.abs() + nothing * jerk);
        let is_plausible = next.velocity <= restitution * fastest + velocity_step;
        let verdict = is_plausible.then_some(Verdict::First);
        return verdict.ok_or("velocity after a hop of nothing".into());
    }
    let speed = restitution * (-slope).max(0.0);
    let tolerance = 64.0
        * (moved * (curvature.abs() + moved) + noise / d + f64::EPSILON * speed + velocity_step);
    if (next.velocity - speed).abs() > tolerance {
        return Err(format!("velocity, expected {speed:e} within {tolerance:e}"));
    }
    Ok(Verdict::First)
}
