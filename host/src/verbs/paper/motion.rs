//! The motion during a flight: integrated step by step, and in the closed forms of (7).

use kband::impact::TangentialSettings;

/// Way and velocity after `d` of a point that starts at 0 with `velocity` at phase `t`.
///
/// Classical Runge-Kutta rule in 4000 steps. Its error is of order `d^2 (d/4000)^4`, below 1e-10
/// for d < 40.
pub(super) fn integrated(
    t: f64,
    d: f64,
    velocity: f64,
    acceleration: impl Fn(f64) -> f64,
) -> (f64, f64) {
    const STEPS: u32 = 4000;
    let h = d / f64::from(STEPS);
    let (mut way, mut speed) = (0.0, velocity);
    for n in 0..STEPS {
        let tau = t + f64::from(n) * h;
        let early = acceleration(tau);
        let middle = acceleration(tau + 0.5 * h);
        let late = acceleration(tau + h);
        way += h * (speed + h * (early + 2.0 * middle) / 6.0);
        speed += h * (early + 4.0 * middle + late) / 6.0;
    }
    (way, speed)
}

/// Height and velocity after `d` by (2a), integrated.
pub(super) fn rise(k: f64, t: f64, psi: f64, d: f64) -> (f64, f64) {
    integrated(t, d, psi, |tau| tau.sin() - k)
}

/// Way and velocity along the track after `d` by (2b), integrated.
pub(super) fn slide(along: &TangentialSettings, k: f64, t: f64, phi: f64, d: f64) -> (f64, f64) {
    let (eta, gamma, pull) = (
        along.amplitude_ratio,
        along.phase_lead,
        k * along.incline_tangent,
    );
    integrated(t, d, phi, |tau| eta * (tau + gamma).sin() - pull)
}

/// u'(d) as printed in (7a).
pub(super) fn velocity(k: f64, t: f64, psi: f64, d: f64) -> f64 {
    -k * d + t.cos() + psi - (t + d).cos()
}

/// u(d) as printed in (7b) and (8).
pub(super) fn height(k: f64, t: f64, psi: f64, d: f64) -> f64 {
    (t.cos() + psi) * d - 0.5 * k * d * d - ((t + d).sin() - t.sin())
}

/// v'(d) by (7c), corrected.
pub(super) fn velocity_along(along: &TangentialSettings, k: f64, t: f64, phi: f64, d: f64) -> f64 {
    let gamma = along.phase_lead;
    let change = (t + d + gamma).cos() - (t + gamma).cos();
    phi - along.amplitude_ratio * change - k * along.incline_tangent * d
}

/// v'(d) as printed in (7c).
pub(super) fn printed_velocity_along(
    along: &TangentialSettings,
    k: f64,
    t: f64,
    phi: f64,
    d: f64,
) -> f64 {
    let gamma = along.phase_lead;
    let change = (t + d + gamma).cos() - (t + gamma).cos();
    -along.amplitude_ratio * (change - k * along.incline_tangent * d + phi)
}
