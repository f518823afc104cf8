//! Equations (20) to (25): what locked parts are conveyed, and (11) written out.

use kband::impact::{Contact, Kernel, Map, Orbit, Tangential, TangentialSettings};
use kband::regime::Lock;
use kband::transport::{Conveying, locked};

use super::flight::settings;
use super::lock::{bands, lock};
use super::row::{Cases, Row, Work, Worst};
use crate::refusal::Refusal;

pub(super) const ROWS: &[Work] = &[conveying, phase_lead, written_out];

/// Time mean of a locked part, measured on the map after it has settled.
fn measured(
    k: f64,
    lock: &Lock,
    restitution: f64,
    settings: TangentialSettings,
) -> Result<f64, Refusal> {
    let map = Map::build(k, restitution)?;
    let tangential = Tangential::build(k, settings)?;
    let mut conveying = Conveying::new(tangential, Contact::new(&map));
    let mut orbit = Orbit::new(&map, lock.state());
    orbit.watch(300, &mut conveying);
    conveying.restart();
    orbit.watch(20, &mut conveying);
    Ok(conveying.conveyed().time_mean().unwrap_or(f64::NAN))
}

/// (20) to (23): locked conveying.
fn conveying() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(8);
    let (mut general, mut in_phase, mut critical, mut written) = (
        Worst::default(),
        Worst::default(),
        Worst::default(),
        Worst::default(),
    );
    for (restitution, order, low, high) in bands()? {
        let k = low + cases.within(0.05, 0.95) * (high - low);
        let lock = lock(k, restitution, order)?;
        let mut settings = TangentialSettings {
            restitution: cases.within(0.0, 0.9),
            amplitude_ratio: cases.within(0.2, 3.0),
            phase_lead: cases.within(-3.0, 3.0),
            incline_tangent: cases.within(-0.3, 0.3),
        };
        let velocity = measured(k, &lock, restitution, settings)?;
        general.see(velocity - locked::velocity(&lock, k, &settings));
        let TangentialSettings {
            restitution: rt,
            amplitude_ratio: eta,
            phase_lead: gamma,
            incline_tangent: tangent,
        } = settings;
        let flight = std::f64::consts::PI * f64::from(order) * k;
        let loss = (1.0 - restitution) / (1.0 + restitution);
        let printed = flight * (eta * gamma.cos() * loss - tangent * (1.0 + rt) / (1.0 - rt))
            - eta * gamma.sin() * (1.0 - (flight * loss).powi(2)).sqrt();
        written.see(velocity - printed);
        settings.phase_lead = 0.0;
        let closed = locked::velocity_in_phase(order, k, restitution, &settings);
        in_phase.see(measured(k, &lock, restitution, settings)? - closed);
        settings.incline_tangent = locked::critical_slope_in_phase(restitution, &settings);
        critical.see(measured(k, &lock, restitution, settings)?);
    }
    // Velocities of up to 30 on orbits known to 1e-12.
    let tolerance = 1e-10;
    Ok(vec![
        Row::new(200, "(20)", "velocity of locked parts")
            .agrees(
                "W = η cos(τ₀+γ) − π r k tan α (1+Rt)/(1−Rt)",
                "the same",
            )
            .within(general, tolerance),
        Row::new(210, "(21)", "velocity of locked parts, γ = 0")
            .agrees(
                "W = π r k {η (1−R)/(1+R) − tan α (1+Rt)/(1−Rt)}",
                "the same; W b ω does not depend on the amplitude",
            )
            .within(in_phase, tolerance),
        Row::new(220, "(22)", "critical slope, γ = 0")
            .agrees(
                "αₑ = A tg{η (1−R)(1−Rt)/((1+R)(1+Rt))}",
                "the same (A tg is arctan, αₑ the α_c of (37)): there W = 0",
            )
            .within(critical, tolerance),
        Row::new(230, "(23)", "velocity of locked parts, written out")
            .agrees(
                "W = π r k[η cos γ (1−R)/(1+R) − tan α (1+Rt)/(1−Rt)] − η sin γ [1 − π²k²r²((1−R)/(1+R))²]^(1/2)",
                "the same: it is (20) with (14b)",
            )
            .within(written, tolerance),
    ])
}

/// (24), (25): the mean velocity in a flight, written out in cos(gamma) and sin(gamma).
fn written_out() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(13);
    let (mut split, mut rooted) = (Worst::default(), Worst::default());
    for _ in 0..1200 {
        let flight = cases.flight()?;
        let settings = settings(&mut cases);
        let phi = cases.within(-2.0, 2.0);
        let (t, psi, d) = (
            flight.launch.phase,
            flight.launch.velocity,
            flight.impact.flight,
        );
        let (eta, gamma) = (settings.amplitude_ratio, settings.phase_lead);
        let pull = flight.k * settings.incline_tangent;
        let way =
            Tangential::build(flight.k, settings)?.distance(flight.launch, &flight.impact, phi);
        let sines = eta * gamma.cos() / d * ((t + d).sin() - t.sin());
        let cosines = eta * gamma.sin() / d * ((t + d).cos() - t.cos());
        split.see(eta * (t + gamma).cos() - 0.5 * pull * d + phi - sines - cosines - way / d);
        let rest =
            phi - eta * gamma.cos() * psi + d * (0.5 * eta * flight.k * gamma.cos() - 0.5 * pull);
        rooted.see(rest - eta * gamma.sin() * t.sin() - cosines - way / d);
    }
    Ok(vec![
        Row::new(240, "(24)", "(11) in cos γ and sin γ")
            .agrees(
                "Wₙ = η cos(τₙ+γ) − (k/2) tan α d + φₙ − (η cos γ/d)[sin τₙ₊₁ − sin τₙ] \
                 − (η sin γ/d)[cos τₙ₊₁ − cos τₙ]",
                "the same; it rewrites (11), not (10)",
            )
            // Terms of up to 3/d, d down to 0.05.
            .within(split, 1e-11),
        Row::new(250, "(25)", "(24) with (8) put into it")
            .agrees(
                "Wₙ = [φₙ − η cos γ ψₙ] + d[(η k/2) cos γ − (k/2) tan α] − η sin γ sin τₙ \
                 − (η sin γ/d)[cos τₙ₊₁ − cos τₙ]",
                "the same",
            )
            // The flight's rounding over d^2 of the shortest hops.
            .within(rooted, 1e-10),
    ])
}

/// What a phase lead does to locked conveying.
fn phase_lead() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(9);
    let (mut critical, mut best) = (Worst::default(), Worst::default());
    for (restitution, order, low, high) in bands()? {
        let k = low + cases.within(0.05, 0.95) * (high - low);
        let lock = lock(k, restitution, order)?;
        let mut settings = TangentialSettings {
            restitution: cases.within(0.0, 0.9),
            amplitude_ratio: cases.within(0.2, 3.0),
            phase_lead: cases.within(-1.5, 1.5),
            incline_tangent: cases.within(0.0, 0.2),
        };
        let t0 = lock.state().phase;
        let at = |phase_lead: f64| {
            measured(
                k,
                &lock,
                restitution,
                TangentialSettings {
                    phase_lead,
                    ..settings
                },
            )
        };
        // No lead beside -t0 conveys more.
        let top = at(-t0)?;
        best.see((at(-t0 + 0.01)?.max(at(-t0 - 0.01)?) - top).max(0.0));
        settings.incline_tangent = locked::critical_slope(&lock, k, &settings);
        if settings.incline_tangent.abs() <= 2.0 {
            critical.see(measured(k, &lock, restitution, settings)?);
        }
    }
    Ok(vec![
        Row::new(902, "finding", "critical slope, any γ")
            .found("tan α_c = η cos(t₀+γ)(1−Rt)/(π r k (1+Rt)): there W = 0")
            .within(critical, 1e-10),
        Row::new(903, "finding", "the γ that conveys most")
            .found("γ = −t₀, for locked parts")
            .within(best, 1e-10),
    ])
}
