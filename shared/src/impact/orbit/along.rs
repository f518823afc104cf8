//! What carries parts along the track: the law of contact that an orbit is watched with.

use super::contact::Contact;
use crate::feeder::{OutOfRange, accept};
use crate::impact::kernel::{Impact, PartState};

/// What every law asks of the track's motion: `k`, `eta`, gamma in rad, and the tangent of the incline.
pub(super) fn accept_motion(
    k: f64,
    amplitude_ratio: f64,
    phase_lead: f64,
    incline_tangent: f64,
) -> Result<(), OutOfRange> {
    const TURN: f64 = core::f64::consts::TAU;
    accept("k", k, (1e-3..=1e3).contains(&k), "0.001..1000")?;
    accept(
        "amplitude_ratio",
        amplitude_ratio,
        (0.0..=100.0).contains(&amplitude_ratio),
        "0..100",
    )?;
    accept(
        "phase_lead",
        phase_lead,
        (-TURN..=TURN).contains(&phase_lead),
        "-2 pi..2 pi rad",
    )?;
    accept(
        "incline_tangent",
        incline_tangent,
        (-2.0..=2.0).contains(&incline_tangent),
        "-2..2",
    )?;
    Ok(())
}

/// What a part did while it lay on the track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lain {
    /// Way along the track in units of b.
    pub distance: f64,
    /// Velocity along the track at the end in units of `b w`.
    pub velocity: f64,
    /// Time in which it slid up the track, in rad.
    pub forward: f64,
    /// Time in which it slid down the track, in rad.
    pub backward: f64,
}

/// A law of motion along the track: [`Tangential`](super::Tangential), the paper's restitution along it, or
/// [`Friction`](super::Friction). These two alone: what a law owes an orbit may change with any version.
pub trait Along: AlongLaw {}

impl<L: AlongLaw> Along for L {}

/// What a law of motion along the track owes an orbit.
pub trait AlongLaw: Copy {
    /// Whether a part at rest has forgotten how it came there, so that its orbit repeats from lift-off to lift-off.
    const FORGETS: bool;

    /// The flight of `impact` from `launch`, left with `velocity` along the track: way in b and velocity after the impact.
    fn fly(&self, launch: PartState, impact: &Impact<PartState>, velocity: f64) -> (f64, f64);

    /// The endless hops of `chatter` rad that bring a part to rest after `last`.
    fn chatter(&self, contact: &Contact, last: PartState, chatter: f64, velocity: f64) -> Lain;

    /// The part lies on the track from `phase` on for `wait` rad.
    fn lie(&self, phase: f64, wait: f64, velocity: f64) -> Lain;

    /// Whether any motion along the track can be steady.
    fn is_held(&self) -> bool {
        true
    }

    /// One drive cycle of a part that lies there for ever; `None` where it does not move, or not steadily.
    fn stay(&self) -> Option<Lain>;
}
