//! The phase portrait of an orbit.

use std::f64::consts::TAU;

use super::Arguments;
use crate::picture::{Axis, Panel, Picture, Unit};
use crate::report::number;

/// Phase and velocity of the state after each impact.
pub(super) type States = Vec<(f64, f64)>;

/// The phase portrait: the state after each impact, as large as it fits.
pub(super) fn portrait(arguments: &Arguments, drive_text: &str, mut states: States) -> Picture {
    let (first, last) = occupied(&states);
    for (phase, _) in &mut states {
        if *phase > last {
            *phase -= TAU;
        }
    }
    let slowest = states
        .iter()
        .fold(f64::INFINITY, |low, state| low.min(state.1));
    let fastest = states.iter().fold(0.0_f64, |high, state| high.max(state.1));
    let room = 0.05 * (fastest - slowest);
    // Where the velocities reach far down, 0 is among them.
    let foot = if slowest > 0.3 * fastest {
        slowest - room
    } else {
        0.0
    };
    let panel = Panel::new(
        Axis::new(
            "phase t of the drive after the impact",
            Unit::RADIANS,
            first,
            last,
        )
        .in_pi(),
        Axis::new(
            "velocity ψ after the impact",
            Unit::VELOCITY,
            foot,
            fastest + room,
        ),
    )
    .height(460.0);
    let map = match arguments.restitution {
        Some(r) => format!("{drive_text}, R = {}; ", number(r, 6)),
        None => String::new(),
    };
    let count = states.len();
    Picture::new("Phase portrait")
        .caption(format!("{map}{count} impacts"))
        .panel(panel.markers("impacts", 0, states))
}

/// The stretch of phases that holds all states with a little room, its start at or below 0 where it
/// holds 0: the turn without its widest gap, or the whole turn where no gap is wider than a third of it.
fn occupied(states: &States) -> (f64, f64) {
    let mut phases: Vec<f64> = states.iter().map(|state| state.0.rem_euclid(TAU)).collect();
    phases.sort_by(f64::total_cmp);
    let next = phases.iter().skip(1).copied();
    let again = phases.first().map(|first| first + TAU);
    let gaps = phases.iter().copied().zip(next.chain(again));
    let Some((from, until)) = gaps.max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0))) else {
        return (0.0, TAU);
    };
    let gap = until - from;
    if gap < TAU / 3.0 {
        return (0.0, TAU);
    }
    let room = (0.05 * (TAU - gap)).max(0.02);
    let first = if until >= TAU { until - TAU } else { until };
    let (low, high) = (first - room, first + TAU - gap + room);
    if high > TAU {
        (low - TAU, high - TAU)
    } else {
        (low, high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_portrait_shows_the_phases_that_occur() {
        let of = |phases: &[f64]| occupied(&phases.iter().map(|phase| (*phase, 1.0)).collect());
        let near = |(a, b): (f64, f64), (c, d): (f64, f64)| {
            assert!((a - c).abs() < 1e-9 && (b - d).abs() < 1e-9, "{a}..{b}");
        };
        near(of(&[1.0, 2.0, 1.5]), (0.95, 2.05));
        // Around 0.
        near(of(&[TAU - 0.5, 0.5, 0.1]), (-0.55, 0.55));
        near(of(&[0.3]), (0.28, 0.32));
        near(of(&[]), (0.0, TAU));
        near(of(&[0.0, 1.5, 3.0, 4.5, 6.0]), (0.0, TAU));
    }
}
