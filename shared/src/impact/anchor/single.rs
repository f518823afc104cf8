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
use crate::feeder::{OutOfRange, accept};
use crate::impact::kernel::{Impact, Kernel, Landing, PartState, accept_phase};
use crate::impact::set_up::SetUp;

/// A state of [`Single`]: 8 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SingleState {
    /// Phase of the drive (symbol t), steps of 2^-32 turns.
    pub phase: Phase,
    /// Velocity relative to the track (symbol psi) in units of `b w`.
    pub velocity: f32,
}

/// The impact map in f32, for displays and pictures (`f32`).
///
/// The phase is an integer, so it never drifts. Everything else is f32. The resolution of f32 at
/// the flight time limits the error. Measured against the f64 map from the same 400 000 states, k
/// 0.02..0.98:
///
/// | velocities | phase error: median | p99 | max (rad) | velocity: max |
/// |---|---|---|---|---|
/// | 0..20 | 1.8e-6 | 5.3e-5 | 3.4e-4 | 2.5e-4 |
/// | 0..3 | 2.2e-7 | 8.6e-6 | 8.6e-5 | 4.7e-5 |
/// | 3e-7..3, logarithmic | 6e-9 | 3.1e-6 | 3.9e-4 | 6.9e-5 |
///
/// The first impact is the right one down to a gap of 1e-5 over a hump, times the flight time above
/// 1 rad. Nearer ones are flagged. An impact takes about 170 instructions on a Cortex-M4F, at
/// most 281 on any locked or chaotic orbit tried.
///
/// Range: k 0.005..=4, restitution 0..=1, velocity 0..=60. With a restitution above 0.96 an impact
/// may leave faster, by at most 2.5. Its velocity is then right. `Single::state` refuses it,
/// [`Kernel::is_in_range`] returns false, and a launch from it is limited to 60.
///
/// ```
/// use kband::impact::{Kernel, Map, Single};
///
/// let (single, map) = (Single::build(0.34, 0.2)?, Map::build(0.34, 0.2)?);
/// let start = Single::state(0.7, 0.36)?;
/// let expected = map.impact(Single::observe(start)).flight;
/// assert!((single.land(start).flight() - expected).abs() < 1e-5);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Single {
    track: SineTrack,
    restitution: f32,
}

/// Largest accepted launch velocity in `b w`.
pub(super) const MAX_VELOCITY: f64 = 60.0;

impl Single {
    /// One flight and the impact that ends it. A resting part stays: flight 0.
    #[inline(always)]
    pub fn land(&self, state: SingleState) -> Landing<SingleState> {
        let state = SingleState {
            velocity: smaller(state.velocity, MAX_VELOCITY as f32),
            ..state
        };
        let (sine, cosine) = sine_cosine_single(state.phase);
        let phase = state.phase.bits();
        let flight = Ballistic {
            k: self.track.k,
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
        if let Some(approach) = fall::<Ballistic>(
            &self.track,
            phase,
            launch.sine,
            launch.velocity + launch.cosine,
        ) {
            let steps = steps_after(phase, &approach);
            return self.landing(phase, steps, approach.arrival(), false);
        }
        let throws = self.track.throws(phase);
        if state.velocity == 0.0 && !throws {
            return Landing {
                steps: 0,
                next: state,
                grazes: false,
            };
        }
        let mut pull = self.track.k - sine;
        // The difference loses its digits near an end of a hump.
        if pull < 1e-3 && pull > -1e-3 {
            pull = self.track.pull_near_ends(phase);
        }
        // At lift-off itself rounding must not change the sign of the pull, nor make it 0.
        launch.pull = if throws {
            smaller(pull, -1e-20)
        } else {
            larger(pull, 1e-20)
        };
        self.land_low(&{ flight }, &{ launch })
    }

    /// [`Single::land`] with another restitution, 0..=1, at the impact.
    #[inline]
    pub(super) fn land_at(&self, state: SingleState, restitution: f32) -> Landing<SingleState> {
        Self {
            restitution,
            ..*self
        }
        .land(state)
    }

    /// Whether a part that rests at `phase` is thrown off there.
    pub(super) fn throws(&self, phase: Phase) -> bool {
        self.track.throws(phase.bits())
    }

    /// Phase at which the track throws a resting part; `None` where it never does.
    pub(super) fn lift_off(&self) -> Option<Phase> {
        (self.track.hump > 0).then(|| Phase::from_bits(self.track.lift_off))
    }

    #[inline(never)]
    fn land_low(&self, flight: &Ballistic, launch: &Launch) -> Landing<SingleState> {
        match candidate::<Ballistic>(&self.track, launch) {
            Candidate::Hop { flight, arrival } => {
                return self.land_short(launch, flight, arrival, false);
            }
            Candidate::Final(approach) => {
                let steps = steps_after(flight.phase, &approach);
                if self.track.ends::<Ballistic>(flight.phase, steps)
                    || self
                        .track
                        .clears(flight.phase, flight.rise, launch.pull, steps)
                {
                    return self.landing(flight.phase, steps, approach.arrival(), false);
                }
            }
            Candidate::Near { .. } | Candidate::Unknown => {}
        }
        self.land_by_search(*flight, *launch)
    }

    #[inline(always)]
    fn land_short(
        &self,
        launch: &Launch,
        flight: f32,
        arrival: f32,
        grazes: bool,
    ) -> Landing<SingleState> {
        land_short(launch.phase, flight, arrival, self.restitution, grazes)
    }

    #[inline(never)]
    fn land_by_search(&self, flight: Ballistic, launch: Launch) -> Landing<SingleState> {
        let (found, grazes) = search(&self.track, &launch, &flight);
        land_found(
            self.track.k,
            self.restitution,
            launch.phase,
            &flight,
            found,
            grazes,
        )
    }

    #[inline(always)]
    fn landing(&self, phase: u32, steps: i64, speed: f32, grazes: bool) -> Landing<SingleState> {
        landing(phase, steps, speed, self.restitution, grazes)
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

impl Kernel for Single {
    type State = SingleState;

    const NAME: &'static str = "f32";

    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        let set_up = SetUp::build(k, restitution)?;
        Ok(Self {
            track: SineTrack::new(&set_up),
            restitution: restitution as f32,
        })
    }

    fn state(phase: f64, velocity: f64) -> Result<SingleState, OutOfRange> {
        accept_phase(phase)?;
        accept(
            "velocity",
            velocity,
            (0.0..=MAX_VELOCITY).contains(&velocity),
            "0..60 (units of b w)",
        )?;
        Ok(SingleState {
            phase: Phase::from_radians(phase),
            velocity: velocity as f32,
        })
    }

    #[inline]
    fn is_in_range(state: SingleState) -> bool {
        state.velocity <= MAX_VELOCITY as f32
    }

    fn observe(state: SingleState) -> PartState {
        PartState::new(state.phase.radians(), f64::from(state.velocity))
    }

    #[inline]
    fn impact(&self, state: SingleState) -> Impact<SingleState> {
        self.land(state).impact()
    }
}
