//! Motion along the track with a tangential restitution (equations 10 and 11;
//! docs/theory-transport.md#t8.1).

use super::along::{Along, ContactMotion, accept_motion};
use super::push::Push;
use crate::feeder::{OutOfRange, Track, accept_in};
use crate::impact::kernel::{Impact, PartState};
use crate::impact::wave::Wave;

/// Parameters of the motion along the track besides k.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TangentialSettings {
    /// Restitution along the track (symbol Rt, R_par in the paper), 0..1; at 1 no speed is steady.
    pub restitution: f64,
    /// Amplitude parallel to the track over the amplitude normal to it (symbol eta), 0..=100.
    pub amplitude_ratio: f64,
    /// Phase lead of the parallel motion (symbol gamma) in rad, -2 pi..=2 pi.
    pub phase_lead: f64,
    /// Tangent of the incline, -2..=2, positive where parts climb.
    pub incline_tangent: f64,
}

impl TangentialSettings {
    /// The settings of parts with a tangential restitution on `track`.
    pub fn on(track: &Track, restitution: f64) -> Self {
        Self {
            restitution,
            amplitude_ratio: track.amplitude_ratio(),
            phase_lead: track.phase_lead(),
            incline_tangent: track.incline_tangent(),
        }
    }
}

/// The motion along the track for one k. Velocities relative to the track in units of `b w`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tangential {
    restitution: f64,
    /// Acceleration of a free part relative to the track.
    free: Push,
}

impl Tangential {
    /// The motion along a sinusoidal track of these settings at `k`, 0.001..=1000; an error names
    /// the parameter out of range.
    pub fn build(k: f64, settings: TangentialSettings) -> Result<Self, OutOfRange> {
        Self::on(&Wave::sine(), k, settings)
    }

    /// The motion along a track of several tones: `eta` times the normal one, led by gamma.
    pub fn on(wave: &Wave, k: f64, settings: TangentialSettings) -> Result<Self, OutOfRange> {
        let (restitution, incline_tangent) = (settings.restitution, settings.incline_tangent);
        let (eta, lead) = (settings.amplitude_ratio, settings.phase_lead);
        accept_motion(k, eta, lead, incline_tangent)?;
        let accepted = "0..1, 1 itself excluded: without loss the speed never settles";
        accept_in("tangential restitution", restitution, 0.0..1.0, accepted)?;
        Ok(Self {
            restitution,
            free: Push::new(wave, eta, lead, k * incline_tangent),
        })
    }

    /// Distance along the track in b, positive up the incline, and velocity after the impact in
    /// `b w`.
    ///
    /// The part leaves `launch` with `velocity` (symbol phi) along the track: `W d` of equation 11,
    /// and phi' of equation 10. The distance is `phi d + d^2 { eta [sin(t+gamma) (1-cos d)/d^2 +
    /// cos(t+gamma) (d - sin d)/d^2] - (k/2) tan(alpha) }`. This form keeps its digits for the
    /// shortest hops. Largest error 3.4e-16 of the sum of the terms' sizes, RMS 1e-16, over 6000
    /// flights of 1e-8 to 2e6 rad in 40 digits.
    pub fn move_in_flight(&self, launch: PartState, impact: &Impact, velocity: f64) -> (f64, f64) {
        let (distance, arriving) = self.arrive(launch, impact, velocity);
        (distance, self.restitution * arriving)
    }
}

/// At rest the velocity is 0: the infinitely many impacts of the chatter use it up.
impl Along for Tangential {
    const REST_ERASES_HISTORY: bool = true;

    #[inline]
    fn move_in_flight(&self, launch: PartState, impact: &Impact, velocity: f64) -> (f64, f64) {
        Self::move_in_flight(self, launch, impact, velocity)
    }

    fn arrive(&self, launch: PartState, flight: &Impact, velocity: f64) -> (f64, f64) {
        self.free.advance(launch.phase, flight.flight, velocity)
    }

    fn rebound(&self, _: PartState, _: &Impact, v: f64, _: f64, [_, free]: [f64; 2]) -> f64 {
        self.restitution * v + free
    }

    fn push(&self, phase: f64) -> f64 {
        self.free.at(phase)
    }

    /// The velocity decays geometrically over hops that shrink geometrically: the distance is `2
    /// phi psi / (A (1 - R Rt))`, to first order in psi. The drive's effect is of second order in a
    /// chatter of at most 1e-4 rad.
    fn move_in_chatter(
        &self,
        [k, restitution]: [f64; 2],
        last: PartState,
        _: f64,
        velocity: f64,
    ) -> ContactMotion {
        let pull = k - libm::sin(last.phase);
        let reach = if pull > 0.0 && last.velocity > 0.0 {
            2.0 * last.velocity / (pull * (1.0 - restitution * self.restitution))
        } else {
            0.0
        };
        ContactMotion {
            distance: velocity * reach,
            ..ContactMotion::default()
        }
    }

    fn move_in_contact(&self, _: f64, _: f64, _: f64) -> ContactMotion {
        ContactMotion::default()
    }

    fn steady_cycle(&self) -> Option<ContactMotion> {
        None
    }
}
