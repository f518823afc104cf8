//! The phase portrait of an orbit.

use std::f64::consts::TAU;

use super::Arguments;
use crate::picture::{Axis, Panel, Picture};
use crate::report::{number, when};

/// Largest number of drawn states.
const MAX_DRAWN: usize = 1 << 17;

/// Phase and velocity of the state after each impact, or after every 2nd, 4th... of many.
pub(super) struct States {
    kept: Vec<(f64, f64)>,
    every: u64,
    impacts: u64,
}

impl States {
    pub fn new() -> Self {
        Self {
            kept: Vec::new(),
            every: 1,
            impacts: 0,
        }
    }

    pub fn add(&mut self, state: (f64, f64)) {
        if self.impacts.is_multiple_of(self.every) {
            if self.kept.len() == MAX_DRAWN {
                self.every *= 2;
                let mut n = 0;
                self.kept.retain(|_| {
                    n += 1;
                    n % 2 == 1
                });
            }
            self.kept.push(state);
        }
        self.impacts += 1;
    }
}

/// The phase portrait: the state after each impact, with axes that fit the states.
pub(super) fn portrait(arguments: &Arguments, drive_text: &str, states: States) -> Picture {
    let States {
        kept: mut states,
        every,
        impacts,
    } = states;
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
    // The axis includes 0 unless all velocities are far above.
    let foot = if slowest > 0.3 * fastest {
        slowest - room
    } else {
        0.0
    };
    let panel = Panel::new(
        Axis::new("phase t of the drive after the impact", "rad", first, last).in_pi(),
        Axis::new("velocity ψ after the impact", "b·ω", foot, fastest + room),
    )
    .height(460.0);
    let map = match arguments.restitution {
        Some(r) => format!(
            "{drive_text}, R = {}{}; ",
            number(r, 6),
            arguments.contact.words()
        ),
        None => String::new(),
    };
    let drawn = when(every > 1, || format!(", every {every}th of them drawn"));
    Picture::new("Phase portrait")
        .caption(format!("{map}{impacts} impacts{drawn}"))
        .panel(panel.markers("impacts", 0, states))
}

/// Interval of phases with all states and a margin. It starts at or below 0 if it contains 0.
///
/// It is the turn without its widest gap, or the whole turn if no gap is wider than a third of it.
fn occupied(states: &[(f64, f64)]) -> (f64, f64) {
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
        let of = |phases: &[f64]| {
            let states: Vec<_> = phases.iter().map(|phase| (*phase, 1.0)).collect();
            occupied(&states)
        };
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
    #[test]
    fn of_many_states_evenly_spaced_ones_are_drawn() {
        let mut states = States::new();
        let count = 3 * MAX_DRAWN as u64 + 1;
        for n in 0..count {
            states.add((n as f64, 1.0));
        }
        assert_eq!((states.every, states.impacts), (4, count));
        let drawn = states.kept.iter().enumerate();
        assert!(
            drawn
                .into_iter()
                .all(|(n, state)| state.0 == 4.0 * n as f64)
        );
        assert_eq!(states.kept.len() as u64, count.div_ceil(4));
    }
}
