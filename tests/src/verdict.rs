//! Whether an impact that a kernel found is the first one.

use kband::impact::{Impact, Kernel, Map, State};

use crate::oracle;
use crate::states::Launch;

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
}

/// Judges what `map` makes of `launch`; the error tells all that is needed to replay it.
///
/// # Errors
/// A wrong root that is not flagged, a number that is not finite, a phase outside the turn, a negative
/// velocity.
pub fn judge(launch: &Launch) -> Result<Verdict, String> {
    let Launch {
        k,
        restitution,
        phase,
        velocity,
    } = *launch;
    let map = Map::build(k, restitution).map_err(|e| format!("{e:?}"))?;
    let state = State { phase, velocity };
    let impact = map.impact(state);
    judge_impact(launch, &impact).map_err(|cause| format!("{cause}: {launch:?} gave {impact:?}"))
}

/// Judges an impact that some kernel made of `launch`; the error is its cause.
///
/// # Errors
/// As [`judge`].
pub fn judge_impact(launch: &Launch, impact: &Impact<State>) -> Result<Verdict, String> {
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
    if !(0.0..std::f64::consts::TAU).contains(&next.phase) {
        return Err("phase".into());
    }
    if d == 0.0 {
        // sin and k round to half a unit of 1 each.
        return if velocity == 0.0 && phase.sin() - k <= 4.0 * f64::EPSILON {
            Ok(Verdict::Rests)
        } else {
            Err("rests though it is thrown".into())
        };
    }
    let turns = (phase + d - next.phase) / std::f64::consts::TAU;
    if (turns - turns.round()).abs() > 2.0 * f64::EPSILON * (2.0 + d) {
        return Err("phase is not that of the flight".into());
    }
    let truth = oracle::first_impact(k, phase, velocity);
    let [_, slope, curvature] = oracle::gap(k, phase, velocity, d);
    let noise = oracle::rounding(k, phase, velocity, d.max(truth.duration));
    // How far the root moves for that noise: linear where the arrival is fast, as the square root where
    // two roots meet.
    let moved = if slope * slope > 4.0 * curvature.abs() * noise {
        noise / slope.abs()
    } else {
        (noise / curvature.abs().max(1e-300)).sqrt()
    };
    let deviation = (d - truth.duration).abs() / (moved + f64::EPSILON * d);
    if deviation <= 64.0 {
        let speed = restitution * (-slope).max(0.0);
        let tolerance =
            64.0 * (moved * curvature.abs() + noise.min(noise / d) + f64::EPSILON * speed);
        if (next.velocity - speed).abs() > tolerance {
            return Err(format!("velocity, expected {speed:e} within {tolerance:e}"));
        }
        return Ok(Verdict::First(deviation));
    }
    if impact.grazes {
        return Ok(Verdict::Flagged);
    }
    Err(format!(
        "wrong root, expected {truth:?}, off by {deviation:e}"
    ))
}
