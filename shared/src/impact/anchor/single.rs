//! The impact map in f32, with an integer phase.

use super::approach::{Approach, fall};
use super::candidate::{Candidate, candidate};
use super::flight::{Ballistic, Launch, Local, STEPS_PER_RADIAN, Track, larger, smaller, steps_to};
use super::search::search;
use super::settle::{Settled, settle, settle_carefully};
use super::sine_track::SineTrack;
use super::solve::Found;
use crate::arithmetic::{Phase, sine_cosine_single};
use crate::impact::kernel::{Landing, MAX_VELOCITY};

/// A state of [`Single`](super::Single): 8 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SingleState {
    /// Phase of the drive (symbol t), steps of 2^-32 turns.
    pub phase: Phase,
    /// Velocity relative to the track (symbol psi) in units of `b w`.
    pub velocity: f32,
}

impl SineTrack {
    #[inline(always)]
    pub(super) fn land(&self, state: SingleState, restitution: f32) -> Landing<SingleState> {
        let state = SingleState {
            velocity: smaller(state.velocity, MAX_VELOCITY as f32),
            ..state
        };
        let (sine, cosine) = sine_cosine_single(state.phase);
        let phase = state.phase.bits();
        let flight = Ballistic {
            track: self,
            phase,
            height: sine,
            rise: state.velocity + cosine,
        };
        if let Some(approach) = fall(self, phase, flight.height, flight.rise) {
            return land_near(phase, &approach, restitution);
        }
        let throws = self.throws(phase);
        if state.velocity == 0.0 && !throws {
            return Landing::at_rest(state);
        }
        let mut pull = self.gravity.k - sine;
        // The difference loses its digits near an end of a hump.
        if pull < 1e-3 && pull > -1e-3 {
            pull = self.pull_near_ends(phase);
        }
        // At lift-off itself rounding must not change the sign of the pull, nor make it 0.
        let launch = Launch {
            phase,
            velocity: state.velocity,
            sine,
            cosine,
            pull: if throws {
                smaller(pull, -1e-20)
            } else {
                larger(pull, 1e-20)
            },
        };
        self.land_low(&{ flight }, &{ launch }, restitution)
    }

    #[inline(never)]
    fn land_low(
        &self,
        flight: &Ballistic<'_, SineTrack>,
        launch: &Launch,
        restitution: f32,
    ) -> Landing<SingleState> {
        match candidate(self, launch) {
            Some(Candidate::Hop { flight, arrival }) => {
                return land_short(launch.phase, flight, arrival, restitution, false);
            }
            Some(Candidate::Near(approach)) => {
                let phase = flight.phase;
                let landing = land_near(phase, &approach, restitution);
                if self.ends(phase, landing.steps)
                    || self.clears(phase, flight.rise, launch.pull, landing.steps)
                {
                    return landing;
                }
            }
            None => {}
        }
        land_by_search(*flight, *launch, restitution)
    }
}

#[inline(never)]
fn land_by_search(
    flight: Ballistic<'_, SineTrack>,
    launch: Launch,
    restitution: f32,
) -> Landing<SingleState> {
    let (root, grazes) = search(&launch, &flight);
    land_found(&flight, restitution, root, grazes)
}

/// The impact that the search found, settled.
#[inline(always)]
pub(super) fn land_found<T: Track>(
    flight: &Ballistic<'_, T>,
    restitution: f32,
    root: Found,
    grazes: bool,
) -> Landing<SingleState> {
    let (k, phase) = (flight.track.gravity().k, flight.phase);
    match root {
        Found::Short {
            flight: time,
            arrival,
        } => land_short(phase, time, arrival, restitution, grazes),
        Found::Near {
            node,
            offset,
            simple,
        } => {
            let impact_at = |local: &Local, settled: Settled, grazes: bool| {
                let speed = settled.speed_gain - local.slope;
                let steps = steps_near(phase, node, settled.offset);
                landing(phase, steps, speed, restitution, grazes)
            };
            let local = flight.local(node);
            if simple && let Some(settled) = settle::<T>(k, &local, offset) {
                return impact_at(&local, settled, grazes);
            }
            let (settled, doubtful) = settle_carefully(k, local, offset);
            let grazes = grazes || doubtful;
            // At a graze the arrival speed may round below 0.
            if settled.speed_gain <= local.slope {
                let steps = steps_near(phase, node, settled.offset).max(0);
                return landing(phase, steps, 0.0, restitution, true);
            }
            impact_at(&local, settled, grazes)
        }
    }
}

#[inline(always)]
pub(super) fn land_short(
    phase: u32,
    flight: f32,
    arrival: f32,
    restitution: f32,
    grazes: bool,
) -> Landing<SingleState> {
    let steps = (flight * STEPS_PER_RADIAN) as u32;
    landing(phase, i64::from(steps), arrival, restitution, grazes)
}

#[inline(always)]
pub(super) fn landing(
    phase: u32,
    steps: i64,
    speed: f32,
    restitution: f32,
    grazes: bool,
) -> Landing<SingleState> {
    Landing {
        steps,
        next: SingleState {
            phase: Phase::from_bits(phase.wrapping_add(steps as u32)),
            velocity: speed * restitution,
        },
        grazes,
    }
}

#[inline(always)]
pub(super) fn land_near(phase: u32, approach: &Approach, restitution: f32) -> Landing<SingleState> {
    let steps = steps_near(phase, approach.node, approach.step);
    landing(phase, steps, approach.arrival(), restitution, false)
}

/// Time after launch at `offset` rad from a node, in steps.
#[inline(always)]
fn steps_near(phase: u32, node: i32, offset: f32) -> i64 {
    steps_to(phase, node) + i64::from((offset * STEPS_PER_RADIAN) as i32)
}
