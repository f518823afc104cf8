//! Motion of parts along the track: the contact law of an observed orbit.

use crate::feeder::{OutOfRange, accept_in};
use crate::impact::contact_time::ContactTime;
use crate::impact::kernel::{Impact, PartState};

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
    /// Whether rest erases the history of a part, so that its orbit repeats after lift-off.
    const REST_ERASES_HISTORY: bool;

    /// Distance in b and velocity after `impact`, for a launch with `velocity` along the track.
    fn move_in_flight(&self, launch: PartState, impact: &Impact, velocity: f64) -> (f64, f64);

    /// The same if the impact takes time, of a part with this restitution: distance in b and
    /// velocity after flight and contact (docs/theory-real-parts.md#t10.6).
    fn move_through_contact(
        &self,
        launch: PartState,
        impact: &Impact,
        velocity: f64,
        contact: ContactTime,
        restitution: f64,
    ) -> (f64, f64) {
        let touch = Impact {
            flight: impact.flight - contact.radians(),
            ..*impact
        };
        let (distance, arriving) = self.arrive(launch, &touch, velocity);
        let (c, free) = (contact.radians(), contact.gain_along(restitution));
        let gains = [c - free, free].map(|gain| gain * self.push(impact.next.phase));
        let after = self.rebound(launch, &touch, arriving, c, gains);
        let carried = 0.5 * (arriving + after) * c;
        (distance + carried, after)
    }

    /// Distance in b and velocity along the track at the end of a flight, before the impact.
    fn arrive(&self, launch: PartState, flight: &Impact, velocity: f64) -> (f64, f64);

    /// Velocity along the track after an impact of `c` rad that a part meets with `v`. A free part
    /// gains `gains`, during the force and after it.
    fn rebound(&self, from: PartState, touch: &Impact, v: f64, c: f64, gains: [f64; 2]) -> f64;

    /// Acceleration of a free part along the track, relative to it, in `b w^2`.
    fn push(&self, phase: f64) -> f64;

    /// The infinitely many hops of `chatter` rad that bring a part to rest after `last`, on a track
    /// with this k and with this restitution.
    fn move_in_chatter(
        &self,
        part: [f64; 2],
        last: PartState,
        chatter: f64,
        velocity: f64,
    ) -> ContactMotion;

    /// A contact from `phase` on for `wait` rad.
    fn move_in_contact(&self, phase: f64, wait: f64, velocity: f64) -> ContactMotion;

    fn can_be_steady(&self) -> bool {
        true
    }

    /// One drive cycle of a part that never leaves the track; `None` without steady motion.
    fn steady_cycle(&self) -> Option<ContactMotion>;
}
