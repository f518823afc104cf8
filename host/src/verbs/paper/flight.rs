//! Equations (1) to (11): motion, flight, impact.

use std::f64::consts::TAU;

use kband::impact::{Kernel, Map, Tangential, TangentialSettings};

use super::row::{Cases, Row, Work, Worst, integrated};
use crate::refusal::Refusal;

pub(super) const ROWS: &[Work] = &[
    laboratory,
    laws_of_impact,
    first_return,
    trajectories,
    flight_time,
    maps,
    mean_velocity,
];

fn settings(cases: &mut Cases) -> TangentialSettings {
    TangentialSettings {
        restitution: cases.within(0.0, 0.95),
        amplitude_ratio: cases.within(0.2, 3.0),
        phase_lead: cases.within(-3.0, 3.0),
        incline_tangent: cases.within(-0.3, 0.3),
    }
}

/// (1) to (3): a part and a track in the laboratory, in SI units, against the dimensionless equations.
fn laboratory() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(1);
    let (mut normal, mut along, mut scale) = (Worst::default(), Worst::default(), Worst::default());
    let (mut printed_pull, mut printed_scale) = (Worst::default(), Worst::default());
    for _ in 0..300 {
        let settings = settings(&mut cases);
        let frequency = cases.within(10.0, 200.0);
        let (w, incline) = (TAU * frequency, settings.incline_tangent.atan());
        let k = cases.within(0.1, 1.5);
        let gravity = 9.81;
        let b = gravity * incline.cos() / (k * w * w);
        let (t, d) = (cases.within(0.0, TAU), cases.within(0.1, 12.0));
        let (psi, phi) = (cases.within(0.1, 3.0), cases.within(-2.0, 2.0));
        // Free flight in the laboratory from the track at time 0, seen from the track at time d/w.
        let time = d / w;
        let a = settings.amplitude_ratio * b;
        let gamma = settings.phase_lead;
        let thrown = b * w * (psi + t.cos());
        let height = thrown * time
            - 0.5 * gravity * incline.cos() * time * time
            - b * ((t + d).sin() - t.sin());
        let pushed = b * w * phi + a * w * (t + gamma).cos();
        let advance = pushed * time
            - 0.5 * gravity * incline.sin() * time * time
            - a * ((t + d + gamma).sin() - (t + gamma).sin());
        let (u, _) = integrated(t, d, psi, |tau| tau.sin() - k);
        normal.see(height / b - u);
        let push = |tau: f64| settings.amplitude_ratio * (tau + gamma).sin();
        let (v, _) = integrated(t, d, phi, |tau| push(tau) - k * settings.incline_tangent);
        along.see(advance / b - v);
        // Read as an angle added instead of a tangent multiplied.
        let (added, _) = integrated(t, d, phi, |tau| push(tau) - k + incline);
        printed_pull.see(advance / b - added);
        scale.see(advance / b - v);
        printed_scale.see(advance / a - v);
    }
    // Rounding of ways of up to 100 and the rule's own error.
    let tolerance = 1e-9;
    Ok(vec![
        Row::new(10, "(1)", "motion in the laboratory")
            .step("free flight between impacts, seen from the shaken track")
            .within(normal, tolerance),
        Row::new(20, "(2)", "equations of motion")
            .corrected(
                "u'' = sin τ − k; v'' with −k + g(α)",
                "u'' = sin τ − k; v'' = η sin(τ+γ) − k tan α",
            )
            .within(along, tolerance)
            .off(printed_pull.value),
        Row::new(30, "(3)", "scaling")
            .corrected(
                "v = x/a",
                "v = x/b: both coordinates in units of the normal amplitude",
            )
            .within(scale, tolerance)
            .off(printed_scale.value),
    ])
}

/// (4), (5): what an impact does to both velocities.
fn laws_of_impact() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(2);
    let (mut normal, mut along) = (Worst::default(), Worst::default());
    for _ in 0..300 {
        let flight = cases.flight()?;
        let settings = settings(&mut cases);
        let tangential = Tangential::build(flight.k, settings)?;
        let phi = cases.within(-2.0, 2.0);
        let (t, d) = (flight.launch.phase, flight.impact.flight);
        let (_, fall) = integrated(t, d, flight.launch.velocity, |tau| tau.sin() - flight.k);
        normal.see(flight.impact.next.velocity + flight.restitution * fall);
        let (_, slide) = integrated(t, d, phi, |tau| {
            settings.amplitude_ratio * (tau + settings.phase_lead).sin()
                - flight.k * settings.incline_tangent
        });
        let after = tangential.after(flight.launch, &flight.impact, phi);
        along.see(after - settings.restitution * slide);
    }
    Ok(vec![
        Row::new(40, "(4)", "impact, normal")
            .step("u'(after) = −R u'(before)")
            // The integration's own error for flights of up to 60.
            .within(normal, 1e-8),
        Row::new(50, "(5)", "impact, along the track")
            .step("v'(after) = Rt v'(before)")
            // The integration's own error for flights of up to 60.
            .within(along, 1e-8),
    ])
}

/// (6): the next impact is the first return. A fine scan of the height finds no earlier touch.
fn first_return() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(3);
    let mut earlier = Worst::default();
    for _ in 0..400 {
        let flight = cases.flight()?;
        let (t, psi, d) = (
            flight.launch.phase,
            flight.launch.velocity,
            flight.impact.flight,
        );
        let steps = (d / 0.002) as u32;
        let deepest = (1..steps)
            .map(|n| height(flight.k, t, psi, d * f64::from(n) / f64::from(steps)))
            .fold(f64::INFINITY, f64::min);
        earlier.see((-deepest).max(0.0));
    }
    Ok(vec![
        Row::new(60, "(6)", "from impact to impact")
            .step("the next impact is the FIRST d > 0 with u(d) = 0; none is missed")
            // Rounding of heights of up to 60.
            .within(earlier, 1e-12),
    ])
}

/// u(d) as printed in (8).
fn height(k: f64, t: f64, psi: f64, d: f64) -> f64 {
    (t.cos() + psi) * d - 0.5 * k * d * d - ((t + d).sin() - t.sin())
}

/// (7): both coordinates during a flight.
fn trajectories() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(4);
    let (mut normal, mut along, mut printed) =
        (Worst::default(), Worst::default(), Worst::default());
    for _ in 0..300 {
        let settings = settings(&mut cases);
        let (k, t, d) = (
            cases.within(0.1, 1.5),
            cases.within(0.0, TAU),
            cases.within(0.1, 12.0),
        );
        let (psi, phi) = (cases.within(0.1, 3.0), cases.within(-2.0, 2.0));
        let (u, _) = integrated(t, d, psi, |tau| tau.sin() - k);
        normal.see(height(k, t, psi, d) - u);
        let (eta, gamma) = (settings.amplitude_ratio, settings.phase_lead);
        let pull = k * settings.incline_tangent;
        let (_, velocity) = integrated(t, d, phi, |tau| eta * (tau + gamma).sin() - pull);
        let change = (t + d + gamma).cos() - (t + gamma).cos();
        along.see(phi - eta * change - pull * d - velocity);
        printed.see(phi - eta * (change + pull * d) - velocity);
    }
    let tolerance = 1e-9;
    Ok(vec![
        Row::new(70, "(7b)", "height during a flight")
            .agrees(
                "u = (cos t + ψ) d − k d²/2 − [sin(t+d) − sin t]",
                "the same",
            )
            .within(normal, tolerance),
        Row::new(71, "(7c)", "velocity along the track in flight")
            .corrected(
                "η multiplies the whole bracket",
                "v' = φ − η [cos(t+d+γ) − cos(t+γ)] − k tan α d",
            )
            .within(along, tolerance)
            .off(printed.value),
    ])
}

/// (8): the equation of the flight time, and what its printed form leaves of it when hops are short.
fn flight_time() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(5);
    let mut root = Worst::default();
    for _ in 0..2000 {
        let flight = cases.flight()?;
        let (t, psi, d) = (
            flight.launch.phase,
            flight.launch.velocity,
            flight.impact.flight,
        );
        // In units of what the terms of (8) are made of.
        let scale = (1.0 + psi) * d + flight.k * d * d + 2.0;
        root.see(height(flight.k, t, psi, d) / scale);
    }
    // A hop of chatter: half way, the height is psi d/4, which the printed form has to find as a
    // difference of terms of order d.
    let (mut deflated, mut printed) = (Worst::default(), Worst::default());
    for _ in 0..200 {
        let (k, t, psi) = (0.9, cases.within(3.3, 6.0), 2e-7);
        let d = psi / (k - t.sin());
        // The cubic of the hop is 1e-7 of it, the next term 1e-14.
        let exact = d * (psi - 0.5 * d * (k - t.sin()) + d * d * t.cos() / 6.0);
        let half = 0.5 * d;
        let versine = 0.5 * (half.sin() / half).powi(2);
        let sagitta = (1.0 - d * d / 20.0) / 6.0;
        let kept = d * (psi + d * (t.sin() * versine - 0.5 * k + d * t.cos() * sagitta));
        deflated.see(kept / exact - 1.0);
        printed.see(height(k, t, psi, d) / exact - 1.0);
    }
    Ok(vec![
        Row::new(80, "(8)", "flight time")
            .agrees("u(d) = 0 with (7b)", "the same; the map's root solves it")
            // A few roundings of its terms.
            .within(root, 4.0 * f64::EPSILON),
        Row::new(81, "(8) in f64", "flight time of chatter, ψ = 2e-7")
            .corrected(
                "as printed: all digits cancel",
                "u/d = ψ + d {sin t C(d) − k/2 + d cos t S(d)}, relative error",
            )
            .within(deflated, 1e-12)
            .off(printed.value),
    ])
}

/// (9), (10): the map of both velocities over many impacts, against the integrated motion.
fn maps() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(6);
    let (mut normal, mut along, mut printed) =
        (Worst::default(), Worst::default(), Worst::default());
    for _ in 0..60 {
        let settings = settings(&mut cases);
        let k = cases.within(0.1, 1.5);
        let restitution = cases.within(0.1, 0.9);
        let (map, tangential) = (Map::build(k, restitution)?, Tangential::build(k, settings)?);
        let mut launch = Map::state(cases.within(0.0, TAU), cases.within(0.5, 3.0))?;
        let (eta, gamma) = (settings.amplitude_ratio, settings.phase_lead);
        let pull = k * settings.incline_tangent;
        let mut phi = 0.0;
        for _ in 0..5 {
            let impact = map.impact(launch);
            let (t, d) = (launch.phase, impact.flight);
            if d < 1e-3 {
                break;
            }
            let (_, fall) = integrated(t, d, launch.velocity, |tau| tau.sin() - k);
            normal.see(impact.next.velocity + restitution * fall);
            let (_, slide) = integrated(t, d, phi, |tau| eta * (tau + gamma).sin() - pull);
            let after = tangential.after(launch, &impact, phi);
            along.see(after - settings.restitution * slide);
            let change = (t + d + gamma).cos() - (t + gamma).cos();
            let whole = settings.restitution * (phi - eta * (change + pull * d));
            printed.see(whole - settings.restitution * slide);
            (phi, launch) = (after, impact.next);
        }
    }
    let tolerance = 1e-8;
    Ok(vec![
        Row::new(90, "(9)", "launch velocity after an impact")
            .agrees("ψ' = R s, s the arrival speed", "the same")
            .within(normal, tolerance),
        Row::new(100, "(10)", "velocity along the track after an impact")
            .corrected(
                "η multiplies the whole bracket",
                "φ' = Rt {φ − η [cos(t+d+γ) − cos(t+γ)] − k tan α d}",
            )
            .within(along, tolerance)
            .off(printed.value),
    ])
}

/// (11): the mean velocity during a flight.
fn mean_velocity() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(7);
    let mut worst = Worst::default();
    for _ in 0..300 {
        let flight = cases.flight()?;
        let settings = settings(&mut cases);
        let phi = cases.within(-2.0, 2.0);
        let (t, d) = (flight.launch.phase, flight.impact.flight);
        let (eta, gamma) = (settings.amplitude_ratio, settings.phase_lead);
        let pull = flight.k * settings.incline_tangent;
        let (way, _) = integrated(t, d, phi, |tau| eta * (tau + gamma).sin() - pull);
        let printed = phi + eta * (t + gamma).cos()
            - 0.5 * pull * d
            - eta / d * ((t + d + gamma).sin() - (t + gamma).sin());
        worst.see(printed - way / d);
        let kept =
            Tangential::build(flight.k, settings)?.distance(flight.launch, &flight.impact, phi);
        worst.see((kept - way) / d);
    }
    Ok(vec![
        Row::new(110, "(11)", "mean velocity in a flight")
            .agrees(
                "W = φ + η cos(t+γ) − (k/2) tan α d − (η/d)[sin(t+d+γ) − sin(t+γ)]",
                "the same",
            )
            .within(worst, 1e-8),
    ])
}
