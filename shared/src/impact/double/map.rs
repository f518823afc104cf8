//! The impact map in f64: state in, next state out.

use super::first::first_impact;
use super::launch::{Launch, Track};
use super::step::build_impact;
use crate::feeder::{OutOfRange, accept_in};
use crate::impact::kernel::{Impact, Kernel, PartState, accept_phase};
use crate::impact::wave::in_turn;

/// The impact map in f64 for one k and one restitution.
///
/// Each flight is expanded about a node of a sine table, so no impact needs a trigonometric call.
/// Closed forms or a certified search select the interval of the track (docs/theory-impacts.md#t3).
/// The flight time is the root of `u` to rounding. The shortest hops keep the relative accuracy of
/// flight and arrival speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Map {
    track: Track<f64>,
    restitution: f64,
}

impl Map {
    /// k of this map.
    #[inline]
    pub fn k(&self) -> f64 {
        self.track.k
    }

    /// Checks `k` and `restitution` without the set-up of a map.
    pub(crate) fn accepts(k: f64, restitution: f64) -> Result<(), OutOfRange> {
        accept_in("k", k, 1e-3..=1e3, "0.001..1000")?;
        accept_in("restitution", restitution, 0.0..=1.0, "0..1")?;
        Ok(())
    }

    #[inline]
    pub(in crate::impact) fn track(&self) -> &Track<f64> {
        &self.track
    }

    /// Phase where a resting part is thrown off (`arcsin k`) in rad; `None` if it rests for ever
    /// (k >= 1).
    pub fn lift_off(&self) -> Option<f64> {
        (self.track.k < 1.0).then_some(self.track.lift_off)
    }

    /// Restitution of this map.
    #[inline]
    pub fn restitution(&self) -> f64 {
        self.restitution
    }
}

impl Kernel for Map {
    type State = PartState;

    const NAME: &'static str = "f64";

    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        Self::accepts(k, restitution)?;
        Ok(Self {
            track: Track::new(k),
            restitution,
        })
    }

    fn state(phase: f64, velocity: f64) -> Result<PartState, OutOfRange> {
        accept_phase(phase)?;
        accept_in("velocity", velocity, 0.0..=1e3, "0..1000 (units of b w)")?;
        Ok(PartState::new(in_turn(phase), velocity))
    }

    fn observe(state: PartState) -> PartState {
        state
    }

    #[inline]
    fn impact(&self, state: PartState) -> Impact {
        let launch = Launch::new(state.phase, state.velocity);
        build_impact(self.restitution, state, first_impact(&self.track, &launch))
    }
}
