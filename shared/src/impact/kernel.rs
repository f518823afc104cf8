//! State of a part, its impact, and the impact map as a trait over the arithmetics.

use super::wave::Tone;
use crate::arithmetic::Phase;
use crate::feeder::{OutOfRange, accept_in};

/// State of a part just after an impact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartState {
    /// Phase of the drive (symbol t) in rad, 0..2 pi.
    pub phase: f64,
    /// Velocity relative to the track (symbol psi) in units of `b w`, at least 0.
    pub velocity: f64,
}

impl PartState {
    /// A state with this phase and velocity.
    #[inline(always)]
    pub const fn new(phase: f64, velocity: f64) -> Self {
        Self { phase, velocity }
    }
}

/// One flight and the impact that ends it, in the arithmetic of the state `S`; f64 by default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact<S = PartState> {
    /// Duration of the flight (symbol d) in rad of drive phase, at least 0.
    pub flight: f64,
    /// The state just after the impact.
    pub next: S,
    /// Whether an earlier or later touch is within rounding of this decision: the flight grazes.
    pub grazes: bool,
}

/// One flight on a microcontroller, with its time in exact steps of the phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Landing<S> {
    /// Flight time (symbol d) in steps of 2^-32 turns, at least 0. Launch phase plus this is
    /// exactly the phase of `next`.
    pub steps: i64,
    /// The state just after the impact.
    pub next: S,
    /// Whether the flight grazes within rounding of this arithmetic.
    pub grazes: bool,
}

impl<S> Landing<S> {
    /// The flight time in rad.
    pub fn flight(&self) -> f64 {
        self.steps as f64 * Phase::RADIANS_PER_STEP
    }

    #[inline(always)]
    pub(super) fn at_rest(next: S) -> Self {
        let (steps, grazes) = (0, false);
        Self {
            steps,
            next,
            grazes,
        }
    }

    #[inline(always)]
    pub(super) fn impact(self) -> Impact<S> {
        Impact {
            flight: self.flight(),
            next: self.next,
            grazes: self.grazes,
        }
    }
}

/// The impact map in one arithmetic: parameters in, set-up constants kept, one impact per call.
pub trait Kernel: Sized {
    /// The state in this arithmetic.
    type State: Copy + PartialEq + core::fmt::Debug;

    /// Its name on the command line and in JSON.
    const NAME: &'static str;

    /// The map for `k` and a restitution; an error names the parameter and its range here.
    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange>;

    /// The nearest state of this arithmetic to a phase in rad and a velocity in `b w`, or an error.
    fn state(phase: f64, velocity: f64) -> Result<Self::State, OutOfRange>;

    /// The state as phase in rad and velocity in `b w`.
    fn observe(state: Self::State) -> PartState;

    /// The first impact after `state`. A resting part (velocity 0 and `sin t < k`) stays, with
    /// flight 0.
    ///
    /// Near restitution 1 an impact may leave faster than [`Kernel::state`] accepts. Its state is
    /// right, but the next launch is limited to the highest accepted velocity.
    fn impact(&self, state: Self::State) -> Impact<Self::State>;
}

/// The impact map on a track of several tones, in one arithmetic.
pub trait WaveKernel: Kernel {
    /// The map on a track with this second and third harmonic, for `k` and a restitution.
    ///
    /// The microcontroller kernels round amplitudes to 2^-32 and angles to 2^-32 turns. Errors:
    /// `OutOfRange` with the parameter and the range of this arithmetic.
    fn on_tones(tones: [Tone; 2], k: f64, restitution: f64) -> Result<Self, OutOfRange>;
}

/// Largest accepted launch velocity of the kernels without f64, in `b w`.
pub(super) const MAX_VELOCITY: f64 = 60.0;

pub(super) fn accept_velocity(velocity: f64) -> Result<f64, OutOfRange> {
    let accepted = "0..60 (units of b w)";
    accept_in("velocity", velocity, 0.0..=MAX_VELOCITY, accepted)
}

/// Refuses a phase in rad whose last digit is coarser than 2^-32 turns: it is undefined.
pub(super) fn accept_phase(phase: f64) -> Result<f64, OutOfRange> {
    const MAX_PHASE: f64 = (1_u32 << 21) as f64 * core::f64::consts::TAU;
    let accepted = "-1.3e7..1.3e7 rad: 2^21 turns, 2^53 steps of the phase";
    accept_in("phase", phase, -MAX_PHASE..=MAX_PHASE, accepted)
}
