//! Events on changes of the load: a dead band around the last reported value, and a rate limit.

use super::load::Load;
use crate::state::Event;

/// Minimum time between two events, in s: the log of a board holds 64 of all kinds.
const MIN_EVENT_INTERVAL: f32 = 10.0;
/// Relative change of mass or flow, against the last reported value, that triggers an event.
const MIN_RELATIVE_CHANGE: f32 = 0.1;

#[derive(Clone, Copy, Debug, Default)]
pub struct LoadEvents {
    reported_load: Option<Load>,
    /// Drive cycles until the next event is allowed.
    wait: f32,
}

impl LoadEvents {
    /// Compares the load of one drive cycle with the last reported one; `frequency` in Hz.
    pub fn cycle(&mut self, load: Option<Load>, frequency: f32) -> Option<Event> {
        if self.wait > 0.0 {
            self.wait -= 1.0;
            return None;
        }
        let differs = |old: f32, new: f32| (new - old).abs() > MIN_RELATIVE_CHANGE * old.abs();
        let event = match (self.reported_load, load) {
            (Some(old), Some(new))
                if !(differs(old.mass, new.mass) || differs(old.flow, new.flow)) =>
            {
                return None;
            }
            (None, None) => return None,
            (_, Some(_)) => Event::Weighed,
            (Some(_), None) => Event::NotWeighed,
        };
        (self.reported_load, self.wait) = (load, MIN_EVENT_INTERVAL * frequency);
        Some(event)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn load(mass: f32) -> Option<Load> {
        Some(Load {
            mass,
            speed: 80.0,
            flow: 0.16 * mass,
        })
    }

    /// Events with their cycle, for loads by cycle at 50 Hz.
    fn reported(cycles: u32, weighed: impl Fn(u32) -> Option<Load>) -> Vec<(u32, Event)> {
        let mut weighing = LoadEvents::default();
        let event = |cycle| Some((cycle, weighing.cycle(weighed(cycle), 50.0)?));
        (0..cycles).filter_map(event).collect()
    }

    #[test]
    fn first_last_and_changed_mass_are_reported() {
        let steps = |cycle| match cycle {
            0..100 => None,
            100..2000 => load(500.0),
            // Within a tenth, then beyond it.
            2000..4000 => load(545.0),
            4000..6000 => load(560.0),
            _ => None,
        };
        let expected = [
            (100, Event::Weighed),
            (4000, Event::Weighed),
            (6000, Event::NotWeighed),
        ];
        assert_eq!(reported(9000, steps), expected);
        // Only the flow changes, as with the speed.
        let faster = |cycle| {
            let flow = if cycle < 1000 { 80.0 } else { 89.0 };
            load(500.0).map(|load| Load { flow, ..load })
        };
        let expected = [(0, Event::Weighed), (1000, Event::Weighed)];
        assert_eq!(reported(3000, faster), expected);
    }

    /// A mass that flickers or jumps does not fill the log: one record in ten seconds.
    #[test]
    fn the_rate_is_bounded() {
        let leaps = reported(50_000, |cycle| load(100.0 + f32::from(cycle as u8)));
        let flickers = reported(50_000, |cycle| load(500.0).filter(|_| cycle % 3 > 0));
        for events in [&leaps, &flickers] {
            assert!((20..=100).contains(&events.len()), "{}", events.len());
            let intervals = events.windows(2).map(|pair| pair[1].0 - pair[0].0);
            assert!(intervals.min() > Some(500));
        }
        // A shorter loss gives no event.
        let short = reported(3000, |cycle| {
            load(500.0).filter(|_| !(100..300).contains(&cycle))
        });
        assert_eq!(short, [(0, Event::Weighed)]);
    }
}
