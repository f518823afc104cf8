//! Motion along the track with a tangential restitution (equations 10 and 11;
//! docs/theory-transport.md#t8.1).

use super::along::{Along, ContactMotion, accept_motion};
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
    settings: TangentialSettings,
    wave: Wave,
    /// `k tan(alpha)`, gravity along the track in units of `b w^2`.
    gravity: f64,
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
            settings,
            wave: *wave,
            gravity: k * incline_tangent,
        })
    }

    /// Distance along the track of a flight, in units of b, positive up the incline.
    ///
    /// The part leaves `launch` with `velocity` (symbol phi) along the track: `W d` of equation 11.
    /// The form `phi d + d^2 { eta [sin(t+gamma) (1-cos d)/d^2 + cos(t+gamma) (d - sin d)/d^2] -
    /// (k/2) tan(alpha) }` keeps its digits for the shortest hops.
    pub fn distance(&self, launch: PartState, impact: &Impact, velocity: f64) -> f64 {
        let d = impact.flight;
        let lead = launch.phase + self.settings.phase_lead;
        let terms = self.wave.tones().map(|(n, tone)| {
            let (sine, cosine) = libm::sincos(n * lead + tone.angle);
            let x = n * d;
            n * n * tone.amplitude * (sine * versine(x) + cosine * x * sagitta(x))
        });
        let push = self.settings.amplitude_ratio * terms.sum::<f64>() - 0.5 * self.gravity;
        d * (velocity + d * push)
    }

    /// Velocity along the track just after the impact (symbol phi', equation 10).
    pub fn velocity_after_impact(&self, launch: PartState, impact: &Impact, velocity: f64) -> f64 {
        self.settings.restitution * self.velocity_before_impact(launch, impact, velocity)
    }

    fn velocity_before_impact(&self, launch: PartState, impact: &Impact, velocity: f64) -> f64 {
        let d = impact.flight;
        let lead = launch.phase + self.settings.phase_lead;
        // S'(t+d+gamma) - S'(t+gamma), without cancellation.
        let changes = self.wave.tones().map(|(n, tone)| {
            let half = 0.5 * n * d;
            let middle = n * lead + tone.angle + half;
            -2.0 * n * tone.amplitude * libm::sin(middle) * libm::sin(half)
        });
        velocity - self.settings.amplitude_ratio * changes.sum::<f64>() - self.gravity * d
    }
}

/// At rest the velocity is 0: the infinitely many impacts of the chatter use it up.
impl Along for Tangential {
    const REST_ERASES_HISTORY: bool = true;

    #[inline]
    fn move_in_flight(&self, launch: PartState, impact: &Impact, velocity: f64) -> (f64, f64) {
        let after = self.velocity_after_impact(launch, impact, velocity);
        (self.distance(launch, impact, velocity), after)
    }

    fn arrive(&self, launch: PartState, flight: &Impact, velocity: f64) -> (f64, f64) {
        let arriving = self.velocity_before_impact(launch, flight, velocity);
        (self.distance(launch, flight, velocity), arriving)
    }

    fn rebound(&self, _: PartState, _: &Impact, v: f64, _: f64, [_, free]: [f64; 2]) -> f64 {
        self.settings.restitution * v + free
    }

    fn push(&self, phase: f64) -> f64 {
        let acceleration = self.wave.motion(phase + self.settings.phase_lead)[2];
        self.settings.amplitude_ratio * acceleration - self.gravity
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
            2.0 * last.velocity / (pull * (1.0 - restitution * self.settings.restitution))
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

/// `(1 - cos d) / d^2`.
fn versine(d: f64) -> f64 {
    versine_from_half(0.5 * d, libm::sin(0.5 * d))
}

/// The same from half of d and the sine of that half.
pub(super) fn versine_from_half(half: f64, sine: f64) -> f64 {
    if half == 0.0 {
        return 0.5;
    }
    let half = sine / half;
    0.5 * half * half
}

/// `(d - sin d) / d^3`, by its series below 0.5.
pub(super) fn sagitta(d: f64) -> f64 {
    if d >= 0.5 {
        return (d - libm::sin(d)) / (d * d * d);
    }
    let x = d * d;
    let mut sum = 0.0;
    for n in [19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0] {
        sum = (1.0 - x * sum) / ((n - 1.0) * n);
    }
    (1.0 - x * sum) / 6.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sagitta_series_meets_the_closed_form() {
        for n in 1..=1000 {
            let d = 1e-4 * f64::from(n);
            let x = d * d;
            let series = 1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0 * (1.0 - x / 110.0)));
            let series = series / 6.0;
            assert!((sagitta(d) / series - 1.0).abs() < 1e-15, "{d}");
        }
        let (below, above) = (sagitta(0.5 - 1e-9), sagitta(0.5));
        assert!((above / below - 1.0).abs() < 1e-9, "{below} {above}");
    }
}
