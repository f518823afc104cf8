//! One part on the track: the impact map, with the amplitude that the track has when it is thrown.

use core::f64::consts::TAU;

use super::drive::Swing;
use crate::impact::{Contact, Kernel, Map, State};

const TURN: f64 = 4_294_967_296.0;

/// A part's motion between two events.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Motion {
    /// Lying on the track.
    Resting,
    /// In flight until a time in steps of 2^-32 turns of the drive, arriving at a speed in m/s.
    Flying { until: u64, arrival: f64 },
    /// In a chatter too short to hear, until it rests.
    Chattering { until: u64 },
}

/// An impact of a part on the track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strike {
    /// Time in steps of 2^-32 turns of the drive.
    pub time: u64,
    /// Arrival speed relative to the track in m/s.
    pub speed: f64,
    /// Phase of the track in rad, 0..2 pi.
    pub phase: f64,
}

/// One part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    restitution: f64,
    motion: Motion,
}

/// What a part needs to know of the track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// g cos(alpha) in m/s^2.
    pub pull: f64,
    /// Angular frequency of the drive in rad/s.
    pub angular: f64,
}

impl Part {
    /// A part at rest on the track.
    #[must_use]
    pub fn at_rest(restitution: f64) -> Self {
        Self {
            restitution,
            motion: Motion::Resting,
        }
    }

    /// Changes its restitution from the next impact on.
    pub fn set_restitution(&mut self, restitution: f64) {
        self.restitution = restitution;
    }

    /// Time of its next event, in steps of 2^-32 turns of the drive; `None` at rest.
    #[inline]
    #[must_use]
    pub fn next(&self) -> Option<u64> {
        match self.motion {
            Motion::Resting => None,
            Motion::Flying { until, .. } | Motion::Chattering { until } => Some(until),
        }
    }

    /// Throws a resting part where the track's downward acceleration exceeds the pull; `swing` is the
    /// track at `time`.
    pub fn throw(&mut self, swing: Swing, track: &Track, time: u64) {
        let amplitude = f64::from(swing.amplitude);
        let k = track.pull / (amplitude * track.angular * track.angular);
        let Ok(map) = Map::build(k, self.restitution) else {
            return;
        };
        let Some(lift_off) = Contact::new(&map).lift_off() else {
            return;
        };
        // The sample comes up to one sample late; the throw itself is at arcsin k.
        let late = turned(swing.phase.radians() - lift_off);
        let start = time.saturating_sub((late / TAU * TURN) as u64);
        let mut state = State {
            phase: lift_off,
            velocity: 0.0,
        };
        let mut impact = map.impact(state);
        if impact.flight <= 0.0 {
            // arcsin k rounded down: the next double after it is thrown.
            state.phase += 1e-12;
            impact = map.impact(state);
        }
        self.fly(
            &map,
            impact.flight,
            impact.next.velocity,
            amplitude,
            track,
            start,
        );
    }

    /// Takes the event that is due: the strike, if it is one, and the part's next motion. `swing` is
    /// the track at the event.
    pub fn event(&mut self, swing: Swing, track: &Track) -> Option<Strike> {
        let (time, arrival) = match self.motion {
            Motion::Resting => return None,
            Motion::Chattering { .. } => {
                self.motion = Motion::Resting;
                return None;
            }
            Motion::Flying { until, arrival } => (until, arrival),
        };
        let phase = swing.phase.radians();
        let strike = Strike {
            time,
            speed: arrival,
            phase,
        };
        let amplitude = f64::from(swing.amplitude);
        let k = track.pull / (amplitude * track.angular * track.angular);
        let Ok(map) = Map::build(k, self.restitution) else {
            self.motion = Motion::Resting;
            return Some(strike);
        };
        // Launch speed in the unit that the track has now.
        let velocity = self.restitution * arrival / (amplitude * track.angular);
        let state = State { phase, velocity };
        if let Some(chatter) = Contact::new(&map).time_to_rest(state) {
            self.motion = Motion::Chattering {
                until: time + (chatter / TAU * TURN) as u64,
            };
            return Some(strike);
        }
        let impact = map.impact(state);
        if impact.flight <= 0.0 {
            self.motion = Motion::Resting;
            return Some(strike);
        }
        self.fly(
            &map,
            impact.flight,
            impact.next.velocity,
            amplitude,
            track,
            time,
        );
        Some(strike)
    }

    fn fly(
        &mut self,
        map: &Map,
        flight: f64,
        launch: f64,
        amplitude: f64,
        track: &Track,
        start: u64,
    ) {
        let arrival = if map.restitution() > 0.0 {
            launch / map.restitution()
        } else {
            0.0
        };
        self.motion = Motion::Flying {
            until: start + (flight / TAU * TURN) as u64,
            arrival: arrival * amplitude * track.angular,
        };
    }
}

fn turned(angle: f64) -> f64 {
    angle - TAU * libm::floor(angle / TAU)
}
