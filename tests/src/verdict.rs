//! Whether an impact that a kernel found is the first one.

use std::f64::consts::TAU;

use kband::impact::{Exact, Hybrid, Impact, Integer, Kernel, Map, PartState, Single};

use crate::states::Launch;
use crate::{certificate, oracle};

/// What the oracle says of one impact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// The first root, to rounding scaled by the condition of the problem: the deviation in units of
    /// that.
    First(f64),
    /// Another root; one of the two decisions lies within rounding, and the kernel says so.
    Flagged,
    /// The part rests, rightly.
    Rests,
    /// A later root than the oracle's, whose touch is within the oracle's own rounding; or another one where a rounding
    /// of `sin t - k` decides whether the part hops or is thrown.
    Undecided,
}

/// A kernel under trial: how far its rounding moves the gap.
pub trait Tried: Kernel {
    /// Rounding of the gap `d` after launch.
    fn rounding(launch: &Launch, d: f64) -> f64;
    /// Step of a flight time, and of a velocity.
    const STEPS: [f64; 2];
    /// Rounding of an arrival speed relative to the launch.
    const RELATIVE: f64 = 0.0;
}

/// One step of a phase in rad.
const STEP: f64 = TAU / 4_294_967_296.0;
/// One step of a velocity in integers.
const VELOCITY_STEP: f64 = 1.0 / 67_108_864.0;

fn f64_rounding(launch: &Launch, d: f64) -> f64 {
    oracle::rounding(launch.k, launch.phase, launch.velocity, d)
}

impl Tried for Map {
    fn rounding(launch: &Launch, d: f64) -> f64 {
        f64_rounding(launch, d)
    }
    const STEPS: [f64; 2] = [0.0; 2];
}

impl Tried for Exact {
    fn rounding(launch: &Launch, d: f64) -> f64 {
        f64_rounding(launch, d)
    }
    const STEPS: [f64; 2] = [0.0; 2];
}

impl Tried for Hybrid {
    fn rounding(_: &Launch, d: f64) -> f64 {
        // Sines to 2^-30, short hops in f32; the cosine at launch to 2^-36.
        3e-9 * d.min(1.0) + 1.5e-11 * d
    }
    const STEPS: [f64; 2] = [STEP, VELOCITY_STEP];
}

impl Tried for Integer {
    fn rounding(_: &Launch, d: f64) -> f64 {
        // Sine and cosine at launch to 2^-30.
        1e-9 * d.min(1.0) + 1e-9 * d
    }
    const STEPS: [f64; 2] = [STEP, VELOCITY_STEP];
}

impl Tried for Single {
    fn rounding(launch: &Launch, d: f64) -> f64 {
        8.0 * f64_rounding(launch, d) * (f64::from(f32::EPSILON) / f64::EPSILON)
    }
    const STEPS: [f64; 2] = [STEP, 1e-30];
    const RELATIVE: f64 = 1e-6;
}

/// Judges what `map` makes of `launch`; the error tells all that is needed to replay it.
///
/// # Errors
/// A wrong root that is not flagged, a number that is not finite, a phase outside the turn, a negative
/// velocity.
pub fn judge(launch: &Launch) -> Result<Verdict, String> {
    let map = Map::build(launch.k, launch.restitution).map_err(|e| format!("{e:?}"))?;
    let impact = map.impact(launch.state());
    judge_impact(launch, &impact).map_err(|cause| format!("{cause}: {launch:?} gave {impact:?}"))
}

/// Judges an impact that some f64 kernel made of `launch`; the error is its cause.
///
/// # Errors
/// As [`judge`].
pub fn judge_impact(launch: &Launch, impact: &Impact<PartState>) -> Result<Verdict, String> {
    judge_as::<Map>(launch, impact, Map::STEPS)
}

/// Judges every arithmetic that can hold `launch`, the microcontrollers' on the state that they hold
/// instead; gives the verdict on f64. The error names the arithmetic and the command that replays it.
///
/// # Errors
/// As [`judge`], for any of them.
pub fn judge_all(launch: &Launch) -> Result<Verdict, String> {
    let verdict = judge_kernel::<Map>(launch)?;
    judge_kernel::<Exact>(launch)?;
    judge_kernel::<Hybrid>(launch)?;
    judge_kernel::<Single>(launch)?;
    judge_kernel::<Integer>(launch)?;
    verdict.ok_or_else(|| format!("f64 refuses {launch:?}"))
}

/// Judges one arithmetic; `None` where it refuses to hold the launch.
fn judge_kernel<K: Tried>(launch: &Launch) -> Result<Option<Verdict>, String> {
    let Ok(kernel) = K::build(launch.k, launch.restitution) else {
        return Ok(None);
    };
    let Ok(state) = K::state(launch.phase, launch.velocity) else {
        return Ok(None);
    };
    let held = K::observe(state);
    let impact = kernel.impact(state);
    let impact = Impact {
        flight: impact.flight,
        next: K::observe(impact.next),
        grazes: impact.grazes,
    };
    let launch = Launch {
        phase: held.phase,
        velocity: held.velocity,
        ..*launch
    };
    // So near to lift-off the step of the phase decides whether the track throws the part.
    let from_edge = ((held.phase.sin() - launch.k) / held.phase.cos()).abs();
    if held.velocity < 1e-16 && from_edge < 6.0 * K::STEPS[0] {
        return Ok(Some(Verdict::Flagged));
    }
    judge_as::<K>(&launch, &impact, K::STEPS)
        .map(Some)
        .map_err(|cause| {
            format!(
                "{cause}\n    gave {impact:?}\n    kband impacts --arithmetic {} --k {:e} --restitution {:e} --phase {:e} --velocity {:e}",
                K::NAME,
                launch.k,
                launch.restitution,
                launch.phase,
                launch.velocity
            )
        })
}

/// When the first impact is: where that is soon proven, as the map in f64 has it, else the oracle's.
fn first_impact(launch: &Launch) -> f64 {
    let Launch {
        k, phase, velocity, ..
    } = *launch;
    let map = Map::build(k, 0.0).map(|map| map.impact(launch.state()));
    if let Ok(Impact { flight: d, .. }) = map {
        let [height, slope, curvature] = oracle::gap(k, phase, velocity, d);
        let noise = f64_rounding(launch, d);
        let simple = slope < 0.0 && slope * slope > 100.0 * curvature.abs() * noise;
        if simple && height.abs() <= 16.0 * noise && certificate::is_first(k, phase, velocity, d) {
            return d;
        }
    }
    oracle::first_impact(k, phase, velocity).duration
}

/// Whether a rounding of `sin t - k` decides at launch between a hop of next to nothing and a throw: the gap near
/// there is `psi d - (k - sin t) d^2/2 + cos t d^3/6`, with two roots or none.
fn is_left_open(launch: &Launch) -> bool {
    let Launch {
        k, phase, velocity, ..
    } = *launch;
    let (sine, cosine) = phase.sin_cos();
    let pull = k - sine;
    if cosine <= 0.0 {
        return false;
    }
    // Where both roots are one.
    let level = (8.0 / 3.0 * cosine * velocity).sqrt();
    (pull - level).abs() <= f64::EPSILON
}

fn judge_as<K: Tried>(
    launch: &Launch,
    impact: &Impact<PartState>,
    [step, velocity_step]: [f64; 2],
) -> Result<Verdict, String> {
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
    let excess = phase.sin() - k;
    if d == 0.0 && velocity == 0.0 {
        // sin and k round to half a unit of 1 each, or the phase where sin is k to its step.
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
        let [height, slope, curvature] = oracle::gap(k, phase, velocity, d);
        let noise = K::rounding(launch, d.max(truth));
        // How far the root moves for that noise: linear where the arrival is fast, as the square root
        // where two roots meet.
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
    // The root is so far off by the residual, where that is simple.
    let off = height.abs() / slope.abs();
    let simple = slope < 0.0 && off * curvature.abs() < 0.1 * slope.abs();
    let nothing = 64.0 * step;
    let deviation = if d <= nothing && oracle::gap(k, phase, velocity, nothing)[0] <= 0.0 {
        // A hop of some steps of a flight time.
        0.0
    } else if simple && off <= 64.0 * moved && certificate::is_first(k, phase, velocity, d) {
        off / moved
    } else {
        let truth = first_impact(launch);
        let (.., moved) = near(d, truth);
        let deviation = (d - truth).abs() / moved;
        if deviation > 64.0 {
            if impact.grazes {
                return Ok(Verdict::Flagged);
            }
            if is_left_open(launch) && (d < 1e-12 || height.abs() <= 64.0 * noise) {
                return Ok(Verdict::Undecided);
            }
            let touch = oracle::gap(k, phase, velocity, truth)[0].abs();
            if d > truth && touch <= oracle::rounding(k, phase, velocity, truth) {
                let [height, slope, _] = oracle::gap(k, phase, velocity, d);
                let room = 64.0 * (K::rounding(launch, d) + moved * slope.abs());
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
    if d <= nothing {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_rounding_of_the_push_decides_is_left_open() {
        // Two that a soak of 1e9 found; in 50 digits both impacts are the first, and the oracle's are not.
        for (k, restitution, phase, velocity) in [
            (
                0.613_353_275_556_075_8,
                0.163_620_263_219_645_07,
                0.660_299_308_068_963,
                1.317_222_040_032_706_2e-30,
            ),
            (
                0.989_523_603_438_732_6,
                0.983_134_726_659_991_6,
                1.425_918_859_129_105,
                1.060_746_879_001_771e-30,
            ),
        ] {
            let launch = Launch {
                k,
                restitution,
                phase,
                velocity,
            };
            assert_eq!(judge_all(&launch), Ok(Verdict::Undecided), "{launch:?}");
            let faster = Launch {
                velocity: 4.0 * velocity,
                ..launch
            };
            assert!(!is_left_open(&faster));
        }
    }
}
