//! The stream of events of one part on one track.

use super::{Contact, Impact, Kernel, Map, State};

/// What happens to a part next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// It flew and struck the track.
    Impact(Impact<State>),
    /// It chattered to rest: the duration from the last impact to rest, in rad, and the phase then.
    Rest {
        /// Duration of the chatter that the closure summed, in rad.
        chatter: f64,
        /// Phase at rest, in rad, 0..2 pi.
        phase: f64,
    },
    /// It rested and was thrown off with velocity 0 at `arcsin k`.
    LiftOff {
        /// Time at rest, in rad.
        wait: f64,
        /// Phase of lift-off in rad.
        phase: f64,
    },
}

/// The orbit of one part: an endless iterator of events, ended only by rest for ever (k >= 1).
#[derive(Clone, Copy, Debug)]
pub struct Orbit<'a> {
    map: &'a Map,
    contact: Contact,
    state: State,
    resting: bool,
}

impl<'a> Orbit<'a> {
    /// The orbit that begins just after an impact with `start`.
    #[must_use]
    pub fn new(map: &'a Map, start: State) -> Self {
        Self {
            map,
            contact: Contact::new(map),
            state: start,
            resting: false,
        }
    }

    /// The orbit that begins at rest; it lifts off at `arcsin k`.
    #[must_use]
    pub fn from_rest(map: &'a Map) -> Self {
        Self {
            map,
            contact: Contact::new(map),
            state: State {
                phase: 0.0,
                velocity: 0.0,
            },
            resting: true,
        }
    }

    /// The state after the last event.
    #[must_use]
    pub fn state(&self) -> State {
        self.state
    }
}

impl Iterator for Orbit<'_> {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        if self.resting {
            let wait = self.contact.wait(self.state.phase)?;
            self.resting = false;
            let phase = if wait > 0.0 {
                self.contact.lift_off()?
            } else {
                self.state.phase
            };
            self.state = State {
                phase,
                velocity: 0.0,
            };
            return Some(Event::LiftOff { wait, phase });
        }
        if let Some(chatter) = self.contact.time_to_rest(self.map, self.state) {
            let State { phase, .. } = Map::state(self.state.phase + chatter, 0.0).ok()?;
            self.resting = true;
            self.state = State {
                phase,
                velocity: 0.0,
            };
            return Some(Event::Rest { chatter, phase });
        }
        let impact = self.map.impact(self.state);
        self.state = impact.next;
        Some(Event::Impact(impact))
    }
}
