//! The impact map in integers, by kind of flight.

use super::ballistic::Ballistic;
use super::constants::{Constants, MAX_GRAZING_SPEED, TURNS_PER_RADIAN};
use super::settle::{arrival, landing, settle, solve};
use super::short::ShortFlight;
use crate::arithmetic::Velocity;
use crate::arithmetic::fixed::Fixed;
use crate::arithmetic::trigonometry::sine_cosine_narrow;
use crate::feeder::OutOfRange;
use crate::impact::kernel::{HybridState, Impact, Kernel, Landing, PartState};
use crate::impact::set_up::SetUp;

/// The impact map in integers (`integer`).
///
/// Measured against the f64 map from the same 400 000 states, k 0.02..0.98:
///
/// | velocities | phase error: median | p99 | max (rad) | velocity: max |
/// |---|---|---|---|---|
/// | 0..20 | 1.6e-9 | 3.2e-8 | 1.2e-6 | 2.9e-7 |
/// | 0..3 | 2.2e-9 | 4.6e-8 | 3.3e-6 | 3.1e-7 |
/// | 3e-7..3, logarithmic | 1.2e-9 | 4.4e-7 | 2.0e-5 | 3.7e-7 |
/// | launches within 0.1 rad of lift-off | 1.4e-9 | 5.1e-8 | 3.5e-5 | 5.3e-7 |
///
/// No wrong impact among them. The first impact is the right one down to a gap of 1e-7 over a hump,
/// times the flight time above 1 rad. Nearer ones are flagged. An impact takes about 1700
/// instructions on a Cortex-M0, at most 2912 on any locked or chaotic orbit tried.
///
/// State and range as [`Hybrid`](crate::impact::Hybrid), but velocity 0..=29. With a restitution
/// above 0.93 an impact may leave faster, by at most 2.5. Its velocity is then right.
/// `Integer::state` refuses it, [`Kernel::is_in_range`] returns false, and a launch from it is limited
/// to 29.
///
/// ```
/// use kband::impact::{Integer, Kernel, Map};
///
/// let (integer, map) = (Integer::build(0.34, 0.2)?, Map::build(0.34, 0.2)?);
/// let start = Integer::state(0.7, 0.36)?;
/// let expected = map.impact(Integer::observe(start)).flight;
/// assert!((integer.land(start).flight() - expected).abs() < 5e-8);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Integer(Constants);

const MAX_VELOCITY: f64 = 29.0;
const MAX_FIXED_VELOCITY: Fixed<26, u32> = Fixed::<26, u32>::from_constant(MAX_VELOCITY);

impl Integer {
    /// One flight and the impact that ends it. A resting part stays: flight 0.
    #[inline(always)]
    pub fn land(&self, state: HybridState) -> Landing<HybridState> {
        let state = state.limited_to(MAX_FIXED_VELOCITY);
        let [sine, cosine] = sine_cosine_narrow(state.phase);
        let phase = state.phase.bits();
        let velocity = state.velocity.fixed();
        let constants = &self.0;
        let flight = Ballistic {
            constants,
            phase,
            sine,
            cosine,
            velocity,
            rise: Fixed::<26, i64>(i64::from(velocity.0)).to::<48>()
                + Fixed::<30, i64>(i64::from(cosine.0)).to(),
        };
        if let Some((node, offset)) = flight.fall() {
            let settled = settle(&flight, node, flight.local(node), offset);
            // The steps may have led back to launch, where the part rises over the track.
            if settled.converged && settled.speed > Fixed::<26>::ZERO && settled.steps > 0 {
                return landing(&flight, settled.steps, settled.speed, false);
            }
        }
        let throws = phase.wrapping_sub(constants.lift_off) < constants.hump;
        if state.velocity == Velocity::ZERO && !throws {
            return Landing {
                steps: 0,
                next: state,
                grazes: false,
            };
        }
        self.low(&flight, throws)
    }

    #[inline(never)]
    fn low(&self, flight: &Ballistic<'_>, throws: bool) -> Landing<HybridState> {
        if let Some((node, offset)) = flight.candidate()
            && flight.steps_to(node) <= self.0.limit(flight.phase) + (1 << 23)
        {
            let settled = settle(flight, node, flight.local(node), offset);
            if settled.converged
                && settled.speed > MAX_GRAZING_SPEED
                && self.0.ends(flight.phase, settled.steps)
            {
                return landing(flight, settled.steps, settled.speed, false);
            }
        }
        let (clears, skims) = match flight.short_flight(throws) {
            ShortFlight::Hop {
                flight: d,
                arrival: speed,
                grazes,
            } => {
                let turns: Fixed<34> = d.times(TURNS_PER_RADIAN);
                let steps = i64::from((turns + Fixed::<34>(2)).to::<32>().0);
                return landing(flight, steps, speed.max(Fixed::<26>::ZERO), grazes);
            }
            ShortFlight::Clears { grazes } => (true, grazes),
            ShortFlight::Open => (false, false),
        };
        let (bracket, grazes) = flight.find_bracket(throws, clears);
        let (node, local, offset) = solve(flight, bracket);
        let settled = settle(flight, node, local, offset);
        arrival(flight, &settled, grazes || skims)
    }
}

impl Kernel for Integer {
    type State = HybridState;

    const NAME: &'static str = "integer";

    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        let set_up = SetUp::build(k, restitution)?;
        Ok(Self(Constants::new(&set_up)))
    }

    fn state(phase: f64, velocity: f64) -> Result<HybridState, OutOfRange> {
        HybridState::build(phase, velocity, MAX_VELOCITY, "0..29 (units of b w)")
    }

    #[inline]
    fn is_in_range(state: HybridState) -> bool {
        state.velocity.fixed() <= MAX_FIXED_VELOCITY
    }

    fn observe(state: HybridState) -> PartState {
        state.to_part_state()
    }

    #[inline]
    fn impact(&self, state: HybridState) -> Impact<HybridState> {
        self.land(state).impact()
    }
}
