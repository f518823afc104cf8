//! What the arithmetics have in common: the state of a part, its impact, and the map as a trait.

use crate::arithmetic::{Phase, Velocity};
use crate::feeder::OutOfRange;

/// Where an orbit stands just after an impact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Phase of the drive (symbol t) in rad, 0..2 pi.
    pub phase: f64,
    /// Velocity relative to the track (symbol psi) in units of `b w`, at least 0.
    pub velocity: f64,
}

/// A state of [`Hybrid`](super::Hybrid) and of [`Integer`](super::Integer): 8 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct HybridState {
    /// Phase of the drive (symbol t), steps of 2^-32 turns.
    pub phase: Phase,
    /// Velocity relative to the track (symbol psi), steps of 2^-26 `b w`.
    pub velocity: Velocity,
}

impl HybridState {
    /// The state with at most this velocity.
    #[inline(always)]
    pub(super) fn held_below(self, top: u32) -> Self {
        Self {
            velocity: Velocity::from_bits(self.velocity.bits().min(top)),
            ..self
        }
    }
}

/// One flight and the impact that ends it, in the arithmetic of the state `S`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact<S> {
    /// Duration of the flight (symbol d) in rad of drive phase, at least 0.
    pub flight: f64,
    /// The state just after the impact.
    pub next: S,
    /// Whether an earlier or later touch is within rounding of this decision: the flight grazes.
    pub grazes: bool,
}

/// One flight on a microcontroller: its time in exact steps of the phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Landing<S> {
    /// Flight time (symbol d) in steps of 2^-32 turns, at least 0; the phase of `next` is that of launch
    /// plus this, exactly.
    pub steps: i64,
    /// The state just after the impact.
    pub next: S,
    /// Whether the flight grazes within rounding of this arithmetic.
    pub grazes: bool,
}

impl<S> Landing<S> {
    /// The flight time in rad.
    #[must_use]
    pub fn flight(&self) -> f64 {
        self.steps as f64 * (core::f64::consts::TAU / 4_294_967_296.0)
    }
}

/// The impact map in one arithmetic: parameters in, set-up constants kept, one impact at a time.
pub trait Kernel: Sized {
    /// The state in this arithmetic.
    type State: Copy + PartialEq + core::fmt::Debug;

    /// Its name on the command line and in JSON.
    const NAME: &'static str;

    /// The map for `k` and a restitution; the refusal names the parameter and the range of this
    /// arithmetic.
    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange>;

    /// The nearest state of this arithmetic to a phase in rad and a velocity in `b w`; refused where
    /// the arithmetic cannot hold it.
    fn state(phase: f64, velocity: f64) -> Result<Self::State, OutOfRange>;

    /// Whether a launch from `state` is within the range of this arithmetic. An impact may leave faster
    /// where restitution is near 1: its state is right, but [`Kernel::impact`] flies it at the top velocity.
    #[must_use]
    fn flies(_state: Self::State) -> bool {
        true
    }

    /// The state as phase in rad and velocity in `b w`.
    fn observe(state: Self::State) -> State;

    /// The first impact after `state`. A resting part (velocity 0 where `sin t < k`) stays: flight 0.
    fn impact(&self, state: Self::State) -> Impact<Self::State>;
}
