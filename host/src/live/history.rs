//! History of the dashboard: cycles, states and events of the last half minute.

use std::collections::VecDeque;
use std::f64::consts::TAU;

use kband_control::{Event, State};

use super::source::Seen;

/// Length of the memory in s.
pub(super) const WINDOW: f64 = 30.0;

/// Largest number of kept events, as many as a tall terminal shows.
const MAX_EVENTS: usize = 100;

/// Averaging time of the conveying speed, in s.
const SPEED_INTERVAL: f64 = 1.0;

/// The last half minute of a source.
#[derive(Clone, Debug, Default)]
pub struct History {
    now: Option<Seen>,
    k: VecDeque<(f64, f64)>,
    states: VecDeque<(f64, State)>,
    strikes: VecDeque<(f64, f64)>,
    way: VecDeque<(f64, f64)>,
    said: VecDeque<(f64, String)>,
}

impl History {
    /// Adds a cycle.
    pub fn take(&mut self, seen: Seen) {
        let time = seen.time;
        if seen.telemetry.k.is_finite() {
            self.k.push_back((time, f64::from(seen.telemetry.k)));
        }
        if self
            .states
            .back()
            .is_none_or(|(_, state)| *state != seen.state())
        {
            self.states.push_back((time, seen.state()));
        }
        for strike in &seen.strikes {
            self.strikes.push_back((time, strike.rem_euclid(TAU)));
        }
        if let Some(way) = seen.way {
            self.way.push_back((time, way));
        }
        for event in &seen.events {
            let words = match (event, seen.fault()) {
                (Event::Faulted, Some(fault)) => {
                    format!("fault {}: {}", fault.number(), fault.name())
                }
                _ => event.name().to_string(),
            };
            self.said.push_back((time, words));
        }
        while self.k.front().is_some_and(|(then, _)| time - then > WINDOW) {
            self.k.pop_front();
        }
        // The state at the beginning of the window is kept.
        while self
            .states
            .get(1)
            .is_some_and(|(then, _)| time - then > WINDOW)
        {
            self.states.pop_front();
        }
        while self
            .way
            .get(1)
            .is_some_and(|(then, _)| time - then > SPEED_INTERVAL)
        {
            self.way.pop_front();
        }
        while self.strikes.len() > 48
            || self
                .strikes
                .front()
                .is_some_and(|(then, _)| time - then > 2.0)
        {
            self.strikes.pop_front();
        }
        while self.said.len() > MAX_EVENTS {
            self.said.pop_front();
        }
        self.now = Some(seen);
    }

    /// Adds a line of the desk's own to the events.
    pub fn say(&mut self, words: String) {
        self.said.push_back((self.time(), words));
    }

    /// The last cycle.
    pub fn now(&self) -> Option<&Seen> {
        self.now.as_ref()
    }

    /// Time of the last cycle in s.
    pub fn time(&self) -> f64 {
        self.now.as_ref().map_or(0.0, |seen| seen.time)
    }

    pub(super) fn k(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.k.iter().copied()
    }

    pub(super) fn strikes(&self) -> impl Iterator<Item = f64> + '_ {
        self.strikes.iter().map(|(_, phase)| *phase)
    }

    pub(super) fn said(&self) -> impl DoubleEndedIterator<Item = &(f64, String)> {
        self.said.iter()
    }

    /// The states that were held within the window.
    pub(super) fn states(&self) -> impl Iterator<Item = State> + '_ {
        self.states.iter().map(|(_, state)| *state)
    }

    /// The state at a time; `None` before the first.
    pub(super) fn state_at(&self, time: f64) -> Option<State> {
        let known = self.states.iter().rev().find(|(then, _)| *then <= time);
        known.map(|(_, state)| *state)
    }

    /// Conveying speed over the last second, in m/s.
    pub fn speed(&self) -> Option<f64> {
        let ((begin, from), (end, to)) = (self.way.front()?, self.way.back()?);
        (end > begin).then(|| (to - from) / (end - begin))
    }
}

#[cfg(test)]
mod tests {
    use kband_control::wire::Telemetry;

    use super::*;

    #[test]
    fn entries_older_than_the_window_are_dropped() {
        let mut history = History::default();
        for n in 0..5000 {
            history.take(Seen {
                time: f64::from(n) * 0.02,
                telemetry: Telemetry {
                    k: 0.43,
                    state: if n < 100 { 1 } else { 2 },
                    ..Telemetry::default()
                },
                strikes: vec![-1.0],
                way: Some(f64::from(n) * 0.002),
                events: Vec::new(),
            });
        }
        assert!(history.k().count() <= 1501);
        assert!((history.speed().unwrap() - 0.1).abs() < 1e-12);
        assert_eq!(history.state_at(80.0), Some(State::Holding));
        assert!(
            history
                .strikes()
                .all(|phase| (phase - (TAU - 1.0)).abs() < 1e-12)
        );
        assert_eq!(history.strikes().count(), 48);
    }
}
