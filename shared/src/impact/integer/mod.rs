//! The impact map in integers alone, for a CPU without an FPU (Cortex-M0+, M3).
//!
//! The same search as in the kernels with an FPU, on exact heights: the phase is an integer, so a
//! flight to a table node or to the end of a hump has an exact time, and its height follows from 64-bit
//! products. No 64-bit division, and 32-bit ones only by a reciprocal from a table.

mod approach;
mod ballistic;
mod search;
mod settle;
mod short;

use super::set_up::SetUp;
use super::{HybridState, Impact, Kernel, Landing, State};
use crate::arithmetic::fixed::{high, wide};
use crate::arithmetic::{Phase, Velocity, node, sine_cosine_integer};
use crate::feeder::{OutOfRange, accept};
use ballistic::Ballistic;
use short::Start;

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
/// No wrong impact among them. The first impact is the right one down to a gap of 1e-7 over a hump (times
/// the flight time, where that is above 1); nearer it is flagged. About 2100 instructions an impact on a
/// Cortex-M0, at most 3363 on any locked or chaotic orbit tried.
///
/// State and range as [`Hybrid`](super::Hybrid), but for the velocity: 0..=29. An impact may leave faster
/// (by at most 2.5, and only with a restitution above 0.93): its velocity is then right,
/// `Integer::state` refuses it, [`Kernel::flies`] tells it, and a launch from it is held at 29.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Integer {
    /// Phase where a hump begins, and its length.
    entry: u32,
    hump: u32,
    /// k, steps of 2^-28, and steps of 2^-30 modulo 4.
    k: i32,
    threshold: i32,
    /// Slope of the sine at the entry of a hump, steps of 2^-26.
    flank: i32,
    /// k pi, steps of 2^-48.
    half_turn_fall: u64,
    /// 1 / (2 pi k), steps of 2^-24.
    inverse: u32,
    /// The least square of the speed at height 0 of a high flight, steps of 2^-27.
    high: i32,
    /// Restitution, steps of 2^-32, 1 as 2^32 - 1.
    restitution: u32,
}

const TOP: f64 = 29.0;
const TOP_BITS: u32 = 29 << 26;
const ONE: i32 = 1 << 30;
/// An arrival at less than 1/64, steps of 2^-26, may be a graze within rounding.
const SLOW: i32 = 1 << 20;
/// A flight of 1/16 rad in steps of a phase: shorter ones have a form that keeps every digit.
const SHORT: i64 = 42_722_829;
/// Half a rad in steps of a phase.
const HALF: i64 = 8 * SHORT;
/// 2 pi, steps of 2^-28.
const TURN: i32 = 1_686_629_713;
/// 1 / (2 pi), steps of 2^-32: turns in a radian.
const TURNS: i32 = 683_565_276;
/// A turn in steps of a phase.
const WHOLE: i64 = 1 << 32;
/// The farthest that the expansion about a node is used: 1/40 rad in steps of 2^-34.
const REACH: i32 = ((1_i64 << 34) / 40) as i32;
/// Distance of two nodes, steps of 2^-34 rad.
const SPACING: i32 = (node::SPACING * 17_179_869_184.0) as i32;

impl Integer {
    /// One flight and the impact that ends it. A resting part stays: flight 0.
    #[must_use]
    pub fn land(&self, state: HybridState) -> Landing<HybridState> {
        let state = state.held_below(TOP_BITS);
        let (sine, cosine) = sine_cosine_integer(state.phase);
        let phase = state.phase.bits();
        let velocity = state.velocity.bits();
        let flight = Ballistic {
            kernel: self,
            phase,
            sine,
            cosine,
            velocity,
            rise: (i64::from(velocity) << 22) + (i64::from(cosine) << 18),
        };
        if let Some((node, offset)) = flight.fall() {
            let settled = flight.settle(node, flight.local(node), offset);
            // The steps may have led back to launch, where the part rises over the track.
            if settled.converged && settled.speed > 0 && settled.steps > 0 {
                return flight.landing(settled.steps, settled.speed as u32, false);
            }
        }
        let throws = phase.wrapping_sub(self.entry) < self.hump;
        if velocity == 0 && !throws {
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
            && flight.steps_to(node) <= self.limit(flight.phase) + (1 << 23)
        {
            let settled = flight.settle(node, flight.local(node), offset);
            if settled.converged && settled.speed > SLOW && self.ends(flight.phase, settled.steps) {
                return flight.landing(settled.steps, settled.speed as u32, false);
            }
        }
        let (clears, skims) = match flight.start(throws) {
            Start::Hop {
                flight: d,
                arrival,
                grazes,
            } => {
                let steps = (high(d, TURNS) + 2) >> 2;
                return flight.landing(i64::from(steps), arrival.max(0) as u32, grazes);
            }
            Start::Clears { grazes } => (true, grazes),
            Start::Open => (false, false),
        };
        let (bracket, grazes) = flight.segment(throws, clears);
        let (node, local, offset) = flight.solve(bracket);
        let settled = flight.settle(node, local, offset);
        flight.arrival(&settled, grazes || skims)
    }

    /// Whether a down-crossing `steps` after launch at `phase` comes before the end of the next hump, and
    /// not so soon that it is settled with more digits as a short hop.
    #[inline(always)]
    fn ends(&self, phase: u32, steps: i64) -> bool {
        steps >= SHORT && steps <= self.limit(phase)
    }

    /// Steps from `phase` to the end of the next hump, and no fewer than 1 to its entry.
    #[inline(always)]
    fn limit(&self, phase: u32) -> i64 {
        let to_entry = self.entry.wrapping_sub(phase).wrapping_sub(1);
        i64::from(to_entry) + i64::from(self.hump)
    }
}

impl Ballistic<'_> {
    /// The state after an impact at `speed`, steps of 2^-26.
    #[inline(always)]
    pub(super) fn landing(&self, steps: i64, speed: u32, grazes: bool) -> Landing<HybridState> {
        let product = wide(speed, self.kernel.restitution) + (1 << 31);
        let velocity = (product >> 32) as u32;
        Landing {
            steps,
            next: HybridState {
                phase: Phase::from_bits(self.phase.wrapping_add(steps as u32)),
                velocity: Velocity::from_bits(velocity),
            },
            grazes,
        }
    }
}

impl Kernel for Integer {
    type State = HybridState;

    const NAME: &'static str = "integer";

    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        let set_up = SetUp::build(k, restitution)?;
        let pi = core::f64::consts::PI;
        Ok(Self {
            entry: set_up.entry.bits(),
            hump: set_up.hump,
            k: libm::round(k * 268_435_456.0) as i32,
            threshold: libm::round(k * 1_073_741_824.0) as u64 as i32,
            flank: libm::round(set_up.flank * 67_108_864.0) as i32,
            half_turn_fall: libm::round(k * pi * 281_474_976_710_656.0) as u64,
            inverse: libm::round(16_777_216.0 / (2.0 * pi * k)) as u32,
            high: libm::round(set_up.high() * 134_217_728.0) as i32,
            restitution: libm::round(restitution * 4_294_967_296.0) as u32,
        })
    }

    fn state(phase: f64, velocity: f64) -> Result<HybridState, OutOfRange> {
        accept("phase", phase, phase.is_finite(), "any finite angle in rad")?;
        Ok(HybridState {
            phase: Phase::from_radians(phase),
            velocity: Velocity::build(velocity, TOP, "0..29 (units of b w)")?,
        })
    }

    #[inline]
    fn flies(state: HybridState) -> bool {
        state.velocity.bits() <= TOP_BITS
    }

    fn observe(state: HybridState) -> State {
        State {
            phase: state.phase.radians(),
            velocity: state.velocity.value(),
        }
    }

    #[inline]
    fn impact(&self, state: HybridState) -> Impact<HybridState> {
        let landing = self.land(state);
        Impact {
            flight: landing.flight(),
            next: landing.next,
            grazes: landing.grazes,
        }
    }
}
