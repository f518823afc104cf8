//! The exact impact map of a part on a vibrating track (Hongler & Figour 1989, equations 7 to 10).
//!
//! A part launched at phase t with velocity psi relative to the track, in units of `b w`, flies for
//! the FIRST d > 0 with
//! `u(d) = (cos t + psi) d - k d^2 / 2 - [sin(t + d) - sin t] = 0` and leaves again with
//! `psi' = R s`, where `s = -u'(d)` is its arrival speed.

#[cfg(test)]
mod accuracy;
mod anchor;
pub mod batch;
mod contact;
mod double;
mod exact;
mod flight;
mod hybrid;
mod integer;
mod observe;
mod orbit;
mod set_up;
mod single;
mod tangent;
mod tangential;

pub use contact::Contact;
pub use double::Map;
pub use exact::{Exact, Refined};
pub use flight::search::Envelope;
pub use hybrid::{Hybrid, HybridState};
pub use integer::Integer;
pub use observe::{Count, Observer};
pub use orbit::{Ended, Event, Orbit, Skips};
pub use single::{Single, SingleState};
pub use tangent::{Growth, Tangent};
pub use tangential::{Tangential, TangentialSettings};

use crate::feeder::OutOfRange;

/// Where an orbit stands just after an impact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Phase of the drive (symbol t) in rad, 0..2 pi.
    pub phase: f64,
    /// Velocity relative to the track (symbol psi) in units of `b w`, at least 0.
    pub velocity: f64,
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
