//! The impact map in f32, with an integer phase.

use super::approach::{Approach, fall};
use super::candidate::{Candidate, candidate};
use super::flight::{
    Flight, Launch, Local, OverSine, RADIANS_PER_STEP, STEPS_PER_RADIAN, larger, node_from_near,
    smaller,
};
use super::search::search;
use super::settle::{Settled, settle, settle_carefully};
use super::sine_track::SineTrack;
use super::solve::Found;
use crate::arithmetic::{Phase, node, sine_cosine_single};
use crate::feeder::OutOfRange;
use crate::impact::kernel::{Landing, MAX_VELOCITY};
use crate::impact::set_up::SetUp;

/// A state of [`Single`](super::Single): 8 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SingleState {
    /// Phase of the drive (symbol t), steps of 2^-32 turns.
    pub phase: Phase,
    /// Velocity relative to the track (symbol psi) in units of `b w`.
    pub velocity: f32,
}

/// The impact map in f32 on a track of one tone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SineSingle(SineTrack);

impl SineSingle {
    pub(super) fn build(k: f64) -> Result<Self, OutOfRange> {
        Ok(Self(SineTrack::new(&SetUp::build(k, 0.0)?)))
    }

    /// One flight and the impact that ends it. A resting part stays: flight 0.
    #[inline(always)]
    pub(super) fn land(&self, state: SingleState, restitution: f32) -> Landing<SingleState> {
        let state = SingleState {
            velocity: smaller(state.velocity, MAX_VELOCITY as f32),
            ..state
        };
        let (sine, cosine) = sine_cosine_single(state.phase);
        let phase = state.phase.bits();
        let flight = Ballistic {
            k: self.0.k,
            phase,
            sine,
            rise: state.velocity + cosine,
        };
        let mut launch = Launch {
            phase,
            velocity: state.velocity,
            sine,
            cosine,
            pull: 0.0,
        };
        if let Some(approach) =
            fall::<Ballistic>(&self.0, phase, launch.sine, launch.velocity + launch.cosine)
        {
            let steps = steps_after(phase, &approach);
            return landing(phase, steps, approach.arrival(), restitution, false);
        }
        let throws = self.0.throws(phase);
        if state.velocity == 0.0 && !throws {
            return Landing {
                steps: 0,
                next: state,
                grazes: false,
            };
        }
        let mut pull = self.0.k - sine;
        // The difference loses its digits near an end of a hump.
        if pull < 1e-3 && pull > -1e-3 {
            pull = self.0.pull_near_ends(phase);
        }
        // At lift-off itself rounding must not change the sign of the pull, nor make it 0.
        launch.pull = if throws {
            smaller(pull, -1e-20)
        } else {
            larger(pull, 1e-20)
        };
        self.land_low(&{ flight }, &{ launch }, restitution)
    }

    /// Whether a part that rests at `phase` is thrown off there.
    pub(super) fn throws(&self, phase: Phase) -> bool {
        self.0.throws(phase.bits())
    }

    /// Phase at which the track throws a resting part; `None` where it never does.
    pub(super) fn lift_off(&self) -> Option<Phase> {
        (self.0.hump > 0).then(|| Phase::from_bits(self.0.lift_off))
    }

    #[inline(never)]
    fn land_low(
        &self,
        flight: &Ballistic,
        launch: &Launch,
        restitution: f32,
    ) -> Landing<SingleState> {
        match candidate::<Ballistic>(&self.0, launch) {
            Candidate::Hop { flight, arrival } => {
                return land_short(launch.phase, flight, arrival, restitution, false);
            }
            Candidate::Final(approach) => {
                let steps = steps_after(flight.phase, &approach);
                if self.0.ends::<Ballistic>(flight.phase, steps)
                    || self.0.clears(flight.phase, flight.rise, launch.pull, steps)
                {
                    return landing(flight.phase, steps, approach.arrival(), restitution, false);
                }
            }
            Candidate::Near { .. } | Candidate::Unknown => {}
        }
        self.land_by_search(*flight, *launch, restitution)
    }

    #[inline(never)]
    fn land_by_search(
        &self,
        flight: Ballistic,
        launch: Launch,
        restitution: f32,
    ) -> Landing<SingleState> {
        let (found, grazes) = search(&self.0, &launch, &flight);
        land_found(self.0.k, restitution, launch.phase, &flight, found, grazes)
    }
}

/// The impact that the search found, settled.
#[inline(always)]
pub(super) fn land_found<F: Flight>(
    k: f32,
    restitution: f32,
    phase: u32,
    flight: &F,
    found: Found,
    grazes: bool,
) -> Landing<SingleState> {
    match found {
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
                let steps =
                    steps_to(phase, node) + i64::from((settled.offset * STEPS_PER_RADIAN) as i32);
                landing(phase, steps, speed, restitution, grazes)
            };
            let local = flight.local(node);
            if simple && let Some(settled) = settle::<F>(k, &local, offset) {
                return impact_at(&local, settled, grazes);
            }
            let (settled, doubtful) = settle_carefully(k, local, offset);
            let grazes = grazes || doubtful;
            // At a graze the arrival speed may round below 0.
            if settled.speed_gain <= local.slope {
                let steps =
                    steps_to(phase, node) + i64::from((settled.offset * STEPS_PER_RADIAN) as i32);
                return landing(phase, steps.max(0), 0.0, restitution, true);
            }
            impact_at(&local, settled, grazes)
        }
    }
}

/// The impact at the end of a short hop.
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

/// The state after an impact at `speed`.
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
pub(super) fn steps_to(phase: u32, node: i32) -> i64 {
    (i64::from(node) << 24) - i64::from(phase)
}

#[inline(always)]
pub(super) fn steps_after(phase: u32, approach: &Approach) -> i64 {
    steps_to(phase, approach.node) + i64::from((approach.step * STEPS_PER_RADIAN) as i32)
}

/// A flight in f32.
#[derive(Clone, Copy)]
struct Ballistic {
    k: f32,
    phase: u32,
    sine: f32,
    rise: f32,
}

impl Flight for Ballistic {
    // Flight time in rad. Near the top of the track, other values give larger errors or wrong
    // impacts.
    const MAX_SHORT_FLIGHT: f32 = 0.25;
    // Step in rad: the remaining error is its cube.
    const MAX_LAST_STEP: f32 = 0.03;
    // Arrival speed in `b w` of a possible graze.
    const MAX_GRAZING_SPEED: f32 = 0.015;
    const APPROACH_IS_FINAL: bool = true;
    // Correction in rad: beyond it the careful way takes over.
    const MAX_LAST_CORRECTION: f32 = 5e-3;
    // Pull in `b w^2`: an ulp of 1.
    const PULL_ROUNDING: f32 = 1.2e-7;
    // Gap in b: some eighty ulps, the roundings of a height at 60 b w.
    // `grazing_flights_are_decided_down_to_rounding` tests it.
    const GAP_ROUNDING: f32 = 1e-5;
    // Gap in b per rad of flight: eight ulps.
    const GAP_ROUNDING_PER_RADIAN: f32 = 1e-6;

    #[inline(always)]
    fn node_of(phase: u32, x: f32) -> (i32, f32) {
        node_from_near(phase, x)
    }

    #[inline(always)]
    fn local(&self, node: i32) -> Local {
        let steps = steps_to(self.phase, node);
        // Whole turns and the rest, each rounded once.
        let turns = ((steps + (1 << 31)) >> 32) as i32;
        let time = steps as i32 as f32 * RADIANS_PER_STEP + turns as f32 * core::f32::consts::TAU;
        let [sine, cosine] = node::SINE_COSINE_SINGLE[(node & 255) as usize];
        Local {
            height: (self.sine - sine) + time * (self.rise - 0.5 * self.k * time),
            slope: self.rise - self.k * time - cosine,
            push: sine,
            surge: cosine,
            bend: sine,
        }
    }
}

impl OverSine for Ballistic {
    #[inline(always)]
    fn above_k(&self, _: i64, nearly: f32) -> f32 {
        nearly
    }
}
