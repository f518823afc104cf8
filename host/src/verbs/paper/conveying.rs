//! Equations (20) to (25): what locked parts are conveyed.

use kband::impact::{Contact, Kernel, Map, Orbit, Tangential, TangentialSettings};
use kband::regime::Lock;
use kband::transport::{Conveying, locked};

use super::lock::{bands, lock};
use super::row::{Cases, Row, Work, Worst};
use crate::refusal::Refusal;

pub(super) const ROWS: &[Work] = &[conveying, phase_lead];

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

/// (20) to (22): locked conveying in phase.
fn conveying() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(8);
    let (mut general, mut in_phase, mut critical) =
        (Worst::default(), Worst::default(), Worst::default());
    for (restitution, order, low, high) in bands()? {
        let k = low + cases.within(0.05, 0.95) * (high - low);
        let lock = lock(k, restitution, order)?;
        let mut settings = TangentialSettings {
            restitution: cases.within(0.0, 0.9),
            amplitude_ratio: cases.within(0.2, 3.0),
            phase_lead: cases.within(-3.0, 3.0),
            incline_tangent: cases.within(-0.3, 0.3),
        };
        general.see(
            measured(k, &lock, restitution, settings)? - locked::velocity(&lock, k, &settings),
        );
        settings.phase_lead = 0.0;
        let closed = locked::velocity_in_phase(order, k, restitution, &settings);
        in_phase.see(measured(k, &lock, restitution, settings)? - closed);
        settings.incline_tangent = locked::critical_slope_in_phase(restitution, &settings);
        critical.see(measured(k, &lock, restitution, settings)?);
    }
    // Velocities of up to 30 on orbits known to 1e-12.
    Ok(vec![
        Row::new(200, "(20)", "velocity of locked parts")
            .agrees("W = η cos(t₀+γ) − π r k tan α (1+Rt)/(1−Rt)", "the same")
            .within(general, 1e-10),
        Row::new(210, "(21)", "in phase, γ = 0")
            .agrees(
                "W = π r k {η (1−R)/(1+R) − tan α (1+Rt)/(1−Rt)}",
                "the same; W b ω does not depend on the amplitude",
            )
            .within(in_phase, 1e-10),
        Row::new(220, "(22)", "critical slope, γ = 0")
            .corrected(
                "\"A tg\"",
                "α_c = arctan[η (1−R)(1−Rt)/((1+R)(1+Rt))]: there W = 0",
            )
            .within(critical, 1e-10),
    ])
}

/// (23) to (25): locked conveying with a phase lead.
fn phase_lead() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(9);
    let (mut critical, mut lead, mut best) = (Worst::default(), Worst::default(), Worst::default());
    for (restitution, order, low, high) in bands()? {
        let k = low + cases.within(0.05, 0.95) * (high - low);
        let lock = lock(k, restitution, order)?;
        let mut settings = TangentialSettings {
            restitution: cases.within(0.0, 0.9),
            amplitude_ratio: cases.within(0.2, 3.0),
            phase_lead: cases.within(-1.5, 1.5),
            incline_tangent: cases.within(0.0, 0.2),
        };
        // The gamma part alone: what a lead adds to the velocity in phase, from equation (11).
        let gamma = settings.phase_lead;
        let with = measured(k, &lock, restitution, settings)?;
        let without = measured(
            k,
            &lock,
            restitution,
            TangentialSettings {
                phase_lead: 0.0,
                ..settings
            },
        )?;
        let t0 = lock.state().phase;
        let eta = settings.amplitude_ratio;
        lead.see(with - without - eta * ((gamma.cos() - 1.0) * t0.cos() - gamma.sin() * t0.sin()));
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
        Row::new(230, "(23)", "critical slope, any γ")
            .agrees(
                "tan α_c = η cos(t₀+γ)(1−Rt)/(π r k (1+Rt))",
                "the same: there W = 0",
            )
            .within(critical, 1e-10),
        Row::new(240, "(24)", "the γ part")
            .corrected(
                "signs and terms misprinted",
                "W(γ) − W(0) = η [(cos γ − 1) cos t₀ − sin γ sin t₀], from (11)",
            )
            .within(lead, 1e-10),
        Row::new(250, "(25)", "the best γ")
            .corrected(
                "signs and terms misprinted",
                "γ = −t₀ conveys most, from (11)",
            )
            .within(best, 1e-10),
    ])
}
