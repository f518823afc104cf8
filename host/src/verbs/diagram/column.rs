//! The impacts of one column of a diagram, reduced to the printed or drawn data.
//!
//! Cycle detection in the last bit of the state (Brent 1980) ends the simulation of an orbit that
//! repeats. Heights are in `b w` or rad.

use std::sync::Arc;

use kband::impact::{Impact, OrbitEvent, PartState};
use kband::regime::classify::Regime;

use crate::ending::{Endings, SEEN, Seen};

/// Kept data of the impacts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Keep {
    /// Their number.
    Count,
    /// Their heights in the diagram.
    Heights,
    /// All states.
    States,
}

/// The impacts of one column.
#[derive(Clone, Debug)]
pub(super) struct Impacts {
    pub(super) count: usize,
    /// Lowest and highest drawn height; `None` without impacts.
    pub(super) span: Option<(f64, f64)>,
    kept: Kept,
}

#[derive(Clone, Debug)]
enum Kept {
    Count,
    /// Heights, with their numbers of impacts.
    Heights(Arc<[(f32, u32)]>),
    /// The first states; those of a repeating orbit end after its first period.
    States {
        states: Vec<PartState>,
        period: Option<usize>,
    },
}

impl Impacts {
    /// From the first states of `count` impacts. If there are fewer states, the last `period` of
    /// them repeat.
    pub(super) fn new(
        states: Vec<PartState>,
        period: Option<usize>,
        count: usize,
        keep: Keep,
        height: impl Fn(PartState) -> f64,
    ) -> Self {
        let heights = states.iter().map(|state| height(*state));
        let span = heights.fold(None, |span: Option<(f64, f64)>, y| {
            let (low, high) = span.unwrap_or((y, y));
            Some((low.min(y), high.max(y)))
        });
        let kept = match keep {
            Keep::Count => Kept::Count,
            Keep::Heights => Kept::Heights(heights_of(&states, period, count, height)),
            Keep::States => Kept::States { states, period },
        };
        Self { count, span, kept }
    }

    /// All states in order; none if they were not kept.
    pub(super) fn states(&self) -> impl Iterator<Item = PartState> + '_ {
        let (states, period) = match &self.kept {
            Kept::States { states, period } => (states.as_slice(), period.unwrap_or(1)),
            _ => (&[][..], 1),
        };
        let count = if states.is_empty() { 0 } else { self.count };
        (0..count).map(move |n| match n.checked_sub(states.len()) {
            None => states[n],
            Some(beyond) => states[states.len() - period + beyond % period],
        })
    }

    /// Drawn heights, with their numbers of impacts.
    pub(super) fn heights(&self, height: impl Fn(PartState) -> f64) -> Arc<[(f32, u32)]> {
        match &self.kept {
            Kept::Count => Arc::new([]),
            Kept::Heights(heights) => Arc::clone(heights),
            Kept::States { states, period } => heights_of(states, *period, self.count, height),
        }
    }
}

fn heights_of(
    states: &[PartState],
    period: Option<usize>,
    count: usize,
    height: impl Fn(PartState) -> f64,
) -> Arc<[(f32, u32)]> {
    let repeats_from = period.map_or(count, |period| states.len() - period);
    let times = |n: usize| match period {
        Some(period) if n >= repeats_from => (count - n).div_ceil(period) as u32,
        _ => 1,
    };
    let heights = states.iter().enumerate();
    heights
        .map(|(n, state)| (height(*state) as f32, times(n)))
        .collect()
}

/// Simulated impacts of one column, and their regime.
pub(super) struct Flown {
    /// The first states.
    pub(super) states: Vec<PartState>,
    /// Number of the last states that repeat.
    pub(super) period: Option<usize>,
    /// Number of all impacts.
    pub(super) count: usize,
    /// Regime, decided over [`classified_impacts`] impacts.
    pub(super) regime: Regime,
    /// Order of the gear on which chaos depends ([`Seen::gear`]).
    pub(super) gear: Option<u32>,
}

/// Number of impacts that decide the regime of a column, from the numbers of settling and drawn
/// ones.
pub(super) fn classified_impacts(settle: usize, impacts: usize) -> usize {
    (settle + impacts).max(SEEN)
}

/// Simulates `impacts` impacts of one column after `settle` others, from `state`, or from rest for
/// `None`. The final state replaces `state`, `None` after a rest for ever.
///
/// An orbit that returns to a state in every bit repeats from there and is not simulated again. The
/// same impacts classify the column.
pub(super) fn flown(
    endings: &Endings,
    state: &mut Option<PartState>,
    settle: usize,
    impacts: usize,
) -> Flown {
    let mut orbit = endings.orbit(*state);
    let mut seen = Seen::new(endings, classified_impacts(settle, impacts));
    let total = settle + impacts;
    let mut struck = Vec::with_capacity(impacts.min(SEEN));
    // A state kept at powers of two of the count is beyond every transient (Brent 1980).
    let (mut kept, mut kept_at): (Option<PartState>, usize) = (None, 0);
    let mut period = None;
    let mut cycle: Vec<Impact<PartState>> = Vec::new();
    let mut count = 0;
    for event in orbit.by_ref() {
        seen.take(&event);
        let OrbitEvent::Impact(impact) = event else {
            continue;
        };
        let landed = impact.next;
        count += 1;
        if count > settle {
            struck.push(landed);
        }
        if count == total {
            break;
        }
        if let Some(period) = period {
            cycle.push(impact);
            if cycle.len() == period {
                break;
            }
        } else if kept == Some(landed) {
            period = Some(count - kept_at);
        } else if count.is_power_of_two() {
            (kept, kept_at) = (Some(landed), count);
        }
    }
    let closed = period.filter(|period| cycle.len() == *period);
    let regime = match closed {
        // The orbit repeats.
        Some(_) => {
            let mut again = cycle.iter().cycle();
            while seen.ending().is_none()
                && let Some(impact) = again.next()
            {
                seen.impact(impact);
            }
            seen.ending()
        }
        // The decision may need more impacts than are drawn.
        None => {
            while seen.ending().is_none()
                && let Some(event) = orbit.next()
            {
                seen.take(&event);
            }
            seen.ending()
        }
    };
    let regime = regime.unwrap_or(Regime::Rest);
    let gear = seen.gear();
    let Some(period) = closed else {
        // All impacts are simulated, or the part rests for ever.
        *state = struck.last().copied().filter(|_| count == total);
        return Flown {
            count: struck.len(),
            states: struck,
            period: None,
            regime,
            gear,
        };
    };
    // Impacts beyond `count` continue the cycle after its last impact.
    let mut beyond = (count.max(settle)..total).map(|n| cycle[(n - count) % period].next);
    while struck.len() < period {
        match beyond.next() {
            Some(landed) => struck.push(landed),
            None => break,
        }
    }
    *state = Some(cycle[(total - 1 - count) % period].next);
    let period = (struck.len() < impacts).then_some(period);
    Flown {
        states: struck,
        period,
        count: impacts,
        regime,
        gear,
    }
}

#[cfg(test)]
mod tests {
    use kband::impact::{ContactTime, Map, Orbit};

    use super::*;

    /// The impacts, each simulated.
    fn each_flown(map: &Map, state: Option<PartState>, total: usize) -> Vec<PartState> {
        let orbit = match state {
            Some(state) => Orbit::new(map, state),
            None => Orbit::from_rest(map),
        };
        let landed = |event| match event {
            OrbitEvent::Impact(impact) => Some(impact.next),
            _ => None,
        };
        orbit.filter_map(landed).take(total).collect()
    }

    #[test]
    fn repeated_impacts_equal_simulated_ones() {
        let start = PartState {
            phase: 0.4,
            velocity: 0.5,
        };
        let mut repeated = 0;
        // Locked, doubled, chaotic, hops and rests, rests for ever.
        for n in 0..120 {
            let k = 0.3 + 0.0061 * f64::from(n);
            let endings = Endings::seen(k, 0.2, ContactTime::INSTANT).unwrap();
            let map = endings.map();
            for (from, settle, impacts) in [
                (None, 0, 400),
                (Some(start), 0, 400),
                (Some(start), 500, 100),
                (None, 500, 3),
                (Some(start), 37, 1),
            ] {
                let all = each_flown(map, from, settle + impacts);
                let wanted = all.get(settle..).unwrap_or(&[]);
                let mut state = from;
                let Flown {
                    states,
                    period,
                    count,
                    ..
                } = flown(&endings, &mut state, settle, impacts);
                repeated += usize::from(period.is_some());
                assert_eq!(count, wanted.len(), "{k} {settle}");
                let last = wanted.last().copied();
                assert_eq!(state, last.filter(|_| count == impacts), "{k} {settle}");
                let height = |state: PartState| state.velocity;
                let heights = Impacts::new(states.clone(), period, count, Keep::Heights, height);
                let kept = Impacts::new(states, period, count, Keep::States, height);
                assert!(kept.states().eq(wanted.iter().copied()), "{k} {settle}");
                let mut drawn: Vec<f32> = Vec::new();
                for (y, times) in heights.heights(height).iter() {
                    drawn.extend((0..*times).map(|_| *y));
                }
                let mut each: Vec<f32> = wanted.iter().map(|s| s.velocity as f32).collect();
                drawn.sort_by(f32::total_cmp);
                each.sort_by(f32::total_cmp);
                assert_eq!(drawn, each, "{k} {settle}");
                assert_eq!(heights.heights(height), kept.heights(height));
            }
        }
        assert!(repeated > 150, "{repeated}");
    }
}
