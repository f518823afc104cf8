//! Motion of parts along the track: the contact law that an orbit is watched with.

use super::contact::Contact;
use crate::feeder::{OutOfRange, accept_in};
use crate::impact::kernel::{Impact, PartState};

/// Refuses a motion out of range: `k`, `eta`, gamma in rad, or the tangent of the incline.
pub(super) fn accept_motion(
    k: f64,
    amplitude_ratio: f64,
    phase_lead: f64,
    incline_tangent: f64,
) -> Result<(), OutOfRange> {
    const TURN: f64 = core::f64::consts::TAU;
    accept_in("k", k, 1e-3..=1e3, "0.001..1000")?;
    accept_in("amplitude_ratio", amplitude_ratio, 0.0..=100.0, "0..100")?;
    accept_in("phase_lead", phase_lead, -TURN..=TURN, "-2 pi..2 pi rad")?;
    accept_in("incline_tangent", incline_tangent, -2.0..=2.0, "-2..2")?;
    Ok(())
}

/// Motion of a part during a contact.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactMotion {
    /// Distance along the track in units of b.
    pub distance: f64,
    /// Velocity along the track at the end in units of `b w`.
    pub velocity: f64,
    /// Sliding time up the track in rad.
    pub forward: f64,
    /// Sliding time down the track in rad.
    pub backward: f64,
}

/// A law of motion along the track: [`Tangential`](super::Tangential) or
/// [`Friction`](super::Friction).
pub trait Along: Copy {
    /// Whether rest erases the history of a part, so that its orbit repeats from lift-off to
    /// lift-off.
    const REST_ERASES_HISTORY: bool;

    /// Distance in b and velocity after `impact`, for a launch with `velocity` along the track.
    fn move_in_flight(
        &self,
        launch: PartState,
        impact: &Impact<PartState>,
        velocity: f64,
    ) -> (f64, f64);

    /// The infinitely many hops of `chatter` rad that bring a part to rest after `last`.
    fn move_in_chatter(
        &self,
        contact: &Contact,
        last: PartState,
        chatter: f64,
        velocity: f64,
    ) -> ContactMotion;

    /// A contact from `phase` on for `wait` rad.
    fn move_in_contact(&self, phase: f64, wait: f64, velocity: f64) -> ContactMotion;

    /// Whether a steady motion along the track is possible.
    fn can_be_steady(&self) -> bool {
        true
    }

    /// One drive cycle of a part that never leaves the track; `None` without motion or without a
    /// steady one.
    fn steady_cycle(&self) -> Option<ContactMotion>;
}
