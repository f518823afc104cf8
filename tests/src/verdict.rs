//! Verdict on whether a kernel's impact is the first one.

use std::f64::consts::TAU;

use kband::impact::{Hybrid, Impact, Integer, Kernel, Map, PartState, Single};

use crate::oracle::Track;
use crate::states::Launch;

/// A launch, and the time of its first impact, proven once for all arithmetics with this launch.
pub struct Proof {
    launch: Launch,
    track: Track,
    /// The impact time of the f64 map.
    guess: f64,
    first: Option<f64>,
}

impl Proof {
    /// The proof of a launch; it tries the impact time `guess` first.
    pub fn of(launch: Launch, guess: f64) -> Self {
        Self {
            launch,
            track: Track::sine(launch.k),
            guess,
            first: None,
        }
    }

    /// The launch.
    pub fn launch(&self) -> &Launch {
        &self.launch
    }

    fn gap(&self, d: f64) -> [f64; 3] {
        self.track.gap(self.launch.phase, self.launch.velocity, d)
    }

    /// Excess of the track's push over k at the launch.
    fn excess(&self) -> f64 {
        self.launch.phase.sin() - self.launch.k
    }

    /// Distance in rad from the launch to the phase at which the push passes k.
    pub fn from_edge(&self) -> f64 {
        (self.excess() / self.launch.phase.cos()).abs()
    }

    fn first(&mut self) -> f64 {
        let Launch {
            phase, velocity, ..
        } = self.launch;
        *self.first.get_or_insert_with(|| {
            let flight = self.track.first_impact_by(phase, velocity, self.guess);
            flight.duration
        })
    }
}

/// The oracle's verdict on one impact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// The first root, to rounding scaled by the condition number; holds the deviation in that
    /// unit.
    First(f64),
    /// Another root. One of the two decisions is within rounding, and the kernel flags it.
    Flagged,
    /// The part rests, correctly.
    Rests,
    /// A later root than the oracle's, whose touch is within the oracle's own rounding.
    ///
    /// Or another root where the rounding of `sin t - k` decides between a hop and a throw.
    Undecided,
}

/// A kernel under test, with the effect of its rounding on the gap.
pub trait Tried: Kernel {
    /// Rounding of the gap `d` after launch.
    fn rounding(proof: &Proof, d: f64) -> f64;
    /// Step of a flight time, and of a velocity.
    const STEPS: [f64; 2];
}

/// One step of a phase in rad.
const STEP: f64 = TAU / 4_294_967_296.0;
/// One step of a velocity in integers.
const VELOCITY_STEP: f64 = 1.0 / 67_108_864.0;

impl Tried for Map {
    fn rounding(proof: &Proof, d: f64) -> f64 {
        proof.launch.rounding(d)
    }
    const STEPS: [f64; 2] = [0.0; 2];
}

impl Tried for Hybrid {
    fn rounding(_: &Proof, d: f64) -> f64 {
        // Sines to 2^-30, short hops in f32; the cosine at launch to 2^-36.
        3e-9 * d.min(1.0) + 1.5e-11 * d
    }
    const STEPS: [f64; 2] = [STEP, VELOCITY_STEP];
}

impl Tried for Integer {
    fn rounding(_: &Proof, d: f64) -> f64 {
        // Sine and cosine at launch to 2^-30.
        1e-9 * d.min(1.0) + 1e-9 * d
    }
    const STEPS: [f64; 2] = [STEP, VELOCITY_STEP];
}

impl Tried for Single {
    fn rounding(proof: &Proof, d: f64) -> f64 {
        8.0 * proof.launch.rounding(d) * (f64::from(f32::EPSILON) / f64::EPSILON)
    }
    const STEPS: [f64; 2] = [STEP, 1e-30];
}

/// Whether the rounding of `sin t - k` decides at launch between a tiny hop and a throw.
///
/// Near launch the gap is `psi d - (k - sin t) d^2/2 + cos t d^3/6`, with two roots or none.
pub(crate) fn is_left_open(launch: &Launch) -> bool {
    let Launch {
        k, phase, velocity, ..
    } = *launch;
    let (sine, cosine) = phase.sin_cos();
    let pull = k - sine;
    if cosine <= 0.0 {
        return false;
    }
    // Double root.
    let level = (8.0 / 3.0 * cosine * velocity).sqrt();
    (pull - level).abs() <= f64::EPSILON
}

/// Judges an arithmetic's impact against the proof of its launch; the error is the cause.
///
/// # Errors
/// A wrong root without a flag, a number that is not finite, a phase outside the turn, a negative
/// velocity. A speed or a phase that does not belong to the flight.
pub(crate) fn judge<K: Tried>(
    proof: &mut Proof,
    impact: &Impact<PartState>,
) -> Result<Verdict, String> {
    let [step, velocity_step] = K::STEPS;
    let truth = proof.first();
    let proof = &*proof;
    let launch = proof.launch();
    let Launch {
        k,
        restitution,
        phase,
        velocity,
    } = *launch;
    let d = impact.flight;
    let next = impact.next;
    if !(d.is_finite() && d >= 0.0) {
        return Err("flight".into());
    }
    if !(next.velocity.is_finite() && next.velocity >= 0.0) {
        return Err("velocity".into());
    }
    if !(0.0..TAU).contains(&next.phase) {
        return Err("phase".into());
    }
    let excess = proof.excess();
    if d == 0.0 && velocity == 0.0 {
        // sin and k round to half a unit of 1 each, or the phase of lift-off to its step.
        return if excess <= 4.0 * f64::EPSILON + step {
            Ok(Verdict::Rests)
        } else {
            Err("rests though it is thrown".into())
        };
    }
    if velocity < 1e-22 && excess.abs() <= 4.0 * f64::EPSILON + step && k > 1.0 - 1e-9 {
        // At the flat top of the track rounding alone decides whether the part is thrown.
        return Ok(Verdict::Rests);
    }
    let turns = (phase + d - next.phase) / TAU;
    if (turns - turns.round()).abs() > 2.0 * f64::EPSILON * (2.0 + d) {
        return Err("phase is not that of the flight".into());
    }
    let near = |d: f64, truth: f64| {
        let [height, slope, curvature] = proof.gap(d);
        let noise = K::rounding(proof, d.max(truth));
        // Shift of the root by that noise: linear at a fast arrival, a square root at a double
        // root.
        let moved = if slope * slope > 4.0 * curvature.abs() * noise {
            noise / slope.abs()
        } else {
            (noise / curvature.abs().max(1e-300)).sqrt().min(d)
        };
        (
            height,
            slope,
            curvature,
            noise,
            moved + f64::EPSILON * d + step,
        )
    };
    let (height, slope, curvature, noise, moved) = near(d, d);
    // Error of a simple root, from the residual.
    let off = height.abs() / slope.abs();
    let simple = slope < 0.0 && off * curvature.abs() < 0.1 * slope.abs();
    let nothing = 64.0 * step;
    let deviation = if nothing > 0.0 && d <= nothing && proof.gap(nothing)[0] <= 0.0 {
        // A hop of a few steps of a flight time.
        0.0
    } else if simple && off <= 64.0 * moved && (d - truth).abs() <= 64.0 * moved {
        off / moved
    } else {
        let (.., moved) = near(d, truth);
        let deviation = (d - truth).abs() / moved;
        if deviation > 64.0 {
            if impact.grazes {
                return Ok(Verdict::Flagged);
            }
            if is_left_open(launch) && (d < 1e-12 || height.abs() <= 64.0 * noise) {
                return Ok(Verdict::Undecided);
            }
            let touch = proof.gap(truth)[0].abs();
            if d > truth && touch <= launch.rounding(truth) {
                let [height, slope, _] = proof.gap(d);
                let room = 64.0 * (K::rounding(proof, d) + moved * slope.abs());
                if velocity * d > 1e-3 && slope < 0.0 && height.abs() <= room {
                    return Ok(Verdict::Undecided);
                }
            }
            return Err(format!(
                "wrong root, expected flight {truth:e}, off by {deviation:e}"
            ));
        }
        deviation
    };
    if nothing > 0.0 && d <= nothing {
        let fastest = velocity + nothing * (excess.abs() + nothing);
        return if next.velocity <= restitution * fastest + velocity_step {
            Ok(Verdict::First(deviation))
        } else {
            Err("velocity after a hop of nothing".into())
        };
    }
    let speed = restitution * (-slope).max(0.0);
    let tolerance = 64.0
        * (moved * (curvature.abs() + moved) + noise / d + f64::EPSILON * speed + velocity_step);
    if (next.velocity - speed).abs() > tolerance {
        return Err(format!("velocity, expected {speed:e} within {tolerance:e}"));
    }
    Ok(Verdict::First(deviation))
}
