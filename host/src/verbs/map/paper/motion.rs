//! The motion during a flight: integrated step by step, and in the closed forms of (7).

use kband::impact::{Impact, PartState, TangentialSettings};

/// Distance and velocity after `d` of a point that starts at 0 with `velocity` at phase `t`.
///
/// Classical Runge-Kutta method in 4000 steps. Its error is of order `d^2 (d/4000)^4`, below 1e-10
/// for d < 40.
pub(super) fn integrated(
    t: f64,
    d: f64,
    velocity: f64,
    acceleration: impl Fn(f64) -> f64,
) -> (f64, f64) {
    const STEPS: u32 = 4000;
    let h = d / f64::from(STEPS);
    let (mut distance, mut speed) = (0.0, velocity);
    for n in 0..STEPS {
        let tau = t + f64::from(n) * h;
        let early = acceleration(tau);
        let middle = acceleration(tau + 0.5 * h);
        let late = acceleration(tau + h);
        distance += h * (speed + h * (early + 2.0 * middle) / 6.0);
        speed += h * (early + 4.0 * middle + late) / 6.0;
    }
    (distance, speed)
}

/// A flight of duration `d` from phase `t` with velocity `psi`; its initial velocity along the
/// track is `phi`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flight {
    pub k: f64,
    pub t: f64,
    pub psi: f64,
    pub d: f64,
}

impl Flight {
    pub(super) fn new(k: f64, launch: PartState, impact: &Impact<PartState>) -> Self {
        Self {
            k,
            t: launch.phase,
            psi: launch.velocity,
            d: impact.flight,
        }
    }

    pub(super) fn launch(&self) -> PartState {
        PartState::new(self.t, self.psi)
    }

    /// Height and velocity at its end, integrated by (2a).
    pub(super) fn rise(&self) -> (f64, f64) {
        integrated(self.t, self.d, self.psi, |tau| tau.sin() - self.k)
    }

    /// Distance and velocity along the track at its end, integrated by (2b).
    pub(super) fn slide(&self, along: &TangentialSettings, phi: f64) -> (f64, f64) {
        let (eta, gamma) = (along.amplitude_ratio, along.phase_lead);
        let pull = self.k * along.incline_tangent;
        integrated(self.t, self.d, phi, |tau| eta * (tau + gamma).sin() - pull)
    }

    /// u'(d) as printed in (7a).
    pub(super) fn velocity(&self) -> f64 {
        let Self { k, t, psi, d } = *self;
        -k * d + t.cos() + psi - (t + d).cos()
    }

    /// u(d) as printed in (7b) and (8).
    pub(super) fn height(&self) -> f64 {
        let Self { k, t, psi, d } = *self;
        (t.cos() + psi) * d - 0.5 * k * d * d - ((t + d).sin() - t.sin())
    }

    /// v'(d) by (7c): corrected, and as printed.
    pub(super) fn velocities_along(&self, along: &TangentialSettings, phi: f64) -> [f64; 2] {
        let Self { k, t, d, .. } = *self;
        let (eta, gamma) = (along.amplitude_ratio, along.phase_lead);
        let change = (t + d + gamma).cos() - (t + gamma).cos();
        let pull = k * along.incline_tangent;
        [
            phi - eta * change - pull * d,
            -eta * (change - pull * d + phi),
        ]
    }
}
