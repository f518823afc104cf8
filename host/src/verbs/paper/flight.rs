//! Equations (1) to (12): motion, impact, flight.

use std::f64::consts::TAU;

use kband::impact::{Contact, Kernel, Map, Tangential, TangentialSettings};

use super::row::{Cases, Row, Work, Worst, integrated};
use crate::refusal::Refusal;

pub(super) const ROWS: &[Work] = &[
    laboratory,
    laws_of_impact,
    sides,
    trajectories,
    flight_time,
    maps,
    mean_velocity,
    first_return,
];

pub(super) fn settings(cases: &mut Cases) -> TangentialSettings {
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
    let (mut fall, mut push) = (Worst::default(), Worst::default());
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
        // (1) in metres and seconds, with F = N = 0.
        let (y, _) = integrated(t / w, time, b * w * psi, |s| {
            b * w * w * (w * s).sin() - gravity * incline.cos()
        });
        fall.see((height - y) / b);
        let (x, _) = integrated(t / w, time, b * w * phi, |s| {
            a * w * w * (w * s + gamma).sin() - gravity * incline.sin()
        });
        push.see((advance - x) / b);
        // At rest y = 0, so N = m (g cos(alpha) - b w^2 sin(w t)), which is zero where the track throws.
        if let Some(lift_off) = Contact::build(k, 0.5)?.lift_off() {
            let force = gravity * incline.cos() - b * w * w * lift_off.sin();
            fall.see(force / (b * w * w));
        }
        let (u, _) = integrated(t, d, psi, |tau| tau.sin() - k);
        normal.see(height / b - u);
        let push = |tau: f64| settings.amplitude_ratio * (tau + gamma).sin();
        let (v, _) = integrated(t, d, phi, |tau| push(tau) - k * settings.incline_tangent);
        along.see(advance / b - v);
        // g(alpha) read as tg(alpha).
        let (added, _) = integrated(t, d, phi, |tau| push(tau) - k + settings.incline_tangent);
        printed_pull.see(advance / b - added);
        scale.see(advance / b - v);
        printed_scale.see(advance / a - v);
    }
    // Rounding of ways of up to 100 and the rule's own error.
    let tolerance = 1e-9;
    Ok(vec![
        Row::new(10, "(1a)", "Newton's law along the track")
            .agrees(
                "m x'' = m a ω² sin(ωt+γ) − m g sin α + F",
                "the same, x riding on the track; in flight F = 0",
            )
            .within(push, tolerance),
        Row::new(11, "(1b)", "Newton's law normal to the track")
            .agrees(
                "m y'' = m b ω² sin ωt − m g cos α + N",
                "the same, N ≥ 0 and N y = 0: it throws where N reaches 0",
            )
            .within(fall, tolerance),
        Row::new(20, "(2a)", "motion normal to the track")
            .agrees("u'' = sin τ − k", "the same")
            .within(normal, tolerance),
        Row::new(21, "(2b)", "motion along the track")
            .corrected("v'' = η sin(τ+γ) − k + g(α)", "v'' = η sin(τ+γ) − k tan α")
            .within(along, tolerance)
            .off(printed_pull.value),
        Row::new(30, "(3)", "scaling")
            .corrected(
                "k = g cos α/(b ω²), η = a/b, τ = ω t, u = y/b, v = x/a",
                "v = x/b: both coordinates in units of the normal amplitude",
            )
            .within(scale, tolerance)
            .off(printed_scale.value),
    ])
}

/// (4), (5): what an impact does to both velocities.
fn laws_of_impact() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(2);
    let (mut normal, mut along, mut range) = (Worst::default(), Worst::default(), Worst::default());
    for n in 0..300 {
        let mut flight = cases.flight()?;
        // Both ends of (5), too.
        if n < 2 {
            flight.restitution = f64::from(n);
            flight.impact = Map::build(flight.k, flight.restitution)?.impact(flight.launch);
        }
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
        // Within (5) no impact gives the part speed.
        range.see((flight.impact.next.velocity - fall.abs()).max(0.0));
        range.see((after.abs() - slide.abs()).max(0.0));
    }
    // The integration's own error for flights of up to 60.
    let tolerance = 1e-8;
    Ok(vec![
        Row::new(40, "(4a)", "impact, normal to the track")
            .agrees("u'(τₙ+ε) = −R u'(τₙ−ε)", "the same")
            .within(normal, tolerance),
        Row::new(41, "(4b)", "impact, along the track")
            .agrees("v'(τₙ+ε) = Rt v'(τₙ−ε)", "the same")
            .within(along, tolerance),
        Row::new(50, "(5)", "range of the restitutions")
            .agrees(
                "0 ≤ R ≤ 1 and 0 ≤ Rt ≤ 1",
                "the same: no impact gives speed; (15) needs R < 1, (31) and (34) Rt < 1",
            )
            .within(range, tolerance),
    ])
}

/// (6): on which side of the impact the velocities are taken.
fn sides() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(12);
    let (mut after, mut before) = (Worst::default(), Worst::default());
    for _ in 0..300 {
        let flight = cases.flight()?;
        let (k, next) = (flight.k, flight.impact.next);
        let (_, arrival) = integrated(
            flight.launch.phase,
            flight.impact.flight,
            flight.launch.velocity,
            |tau| tau.sin() - k,
        );
        // The velocity half a cycle after the impact, by (7a) with psi from either side.
        let half = 0.5 * TAU;
        let (_, speed) = integrated(next.phase, half, next.velocity, |tau| tau.sin() - k);
        let by = |psi: f64| velocity(k, next.phase, psi, half);
        after.see(by(next.velocity) - speed);
        before.see(by(arrival) - speed);
    }
    Ok(vec![
        Row::new(60, "(6)", "velocities at an impact")
            .corrected(
                "ψₙ = u' and φₙ = v' at τ = τₙ",
                "at τₙ+ε, just after the impact: only then do (7) to (11) follow (printed error: just before it)",
            )
            .within(after, 1e-9)
            .off(before.value),
    ])
}

/// u'(d) as printed in (7a).
fn velocity(k: f64, t: f64, psi: f64, d: f64) -> f64 {
    -k * d + t.cos() + psi - (t + d).cos()
}

/// u(d) as printed in (7b) and (8).
fn height(k: f64, t: f64, psi: f64, d: f64) -> f64 {
    (t.cos() + psi) * d - 0.5 * k * d * d - ((t + d).sin() - t.sin())
}

/// (7): both coordinates during a flight.
fn trajectories() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(4);
    let (mut speed, mut normal) = (Worst::default(), Worst::default());
    let (mut along, mut printed) = (Worst::default(), Worst::default());
    for _ in 0..300 {
        let settings = settings(&mut cases);
        let (k, t, d) = (
            cases.within(0.1, 1.5),
            cases.within(0.0, TAU),
            cases.within(0.1, 12.0),
        );
        let (psi, phi) = (cases.within(0.1, 3.0), cases.within(-2.0, 2.0));
        let (u, rise) = integrated(t, d, psi, |tau| tau.sin() - k);
        speed.see(velocity(k, t, psi, d) - rise);
        normal.see(height(k, t, psi, d) - u);
        let (eta, gamma) = (settings.amplitude_ratio, settings.phase_lead);
        let pull = k * settings.incline_tangent;
        let (_, advance) = integrated(t, d, phi, |tau| eta * (tau + gamma).sin() - pull);
        let change = (t + d + gamma).cos() - (t + gamma).cos();
        along.see(phi - eta * change - pull * d - advance);
        printed.see(-eta * (change - pull * d + phi) - advance);
    }
    let tolerance = 1e-9;
    Ok(vec![
        Row::new(70, "(7a)", "normal velocity in flight")
            .agrees("u' = −k(τ−τₙ) + cos τₙ + ψₙ − cos τ", "the same")
            .within(speed, tolerance),
        Row::new(71, "(7b)", "height in flight")
            .agrees(
                "u = −(k/2)(τ−τₙ)² + [(cos τₙ+ψₙ)(τ−τₙ) − [sin τ − sin τₙ]]",
                "the same",
            )
            .within(normal, tolerance),
        Row::new(72, "(7c)", "velocity along the track in flight")
            .corrected(
                "v' = −η[cos(τ+γ) − cos(τₙ+γ) − k tan α (τ−τₙ) + φₙ]",
                "v' = −η[cos(τ+γ) − cos(τₙ+γ)] − k tan α (τ−τₙ) + φₙ",
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
            .agrees(
                "−(k/2) d² + [cos τₙ + ψₙ] d = sin τₙ₊₁ − sin τₙ",
                "the same, with the FIRST root d > 0",
            )
            // A few roundings of its terms.
            .within(root, 4.0 * f64::EPSILON),
        Row::new(900, "finding", "(8) in f64 for chatter, ψ = 2e-7")
            .found(
                "(8) loses all its digits; u/d = ψ + d {sin t c₂(d) − k/2 + d cos t c₃(d)} keeps them",
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
            let literal = restitution * -velocity(k, t, launch.velocity, d);
            normal.see(impact.next.velocity - literal);
            let (_, slide) = integrated(t, d, phi, |tau| eta * (tau + gamma).sin() - pull);
            let after = tangential.after(launch, &impact, phi);
            along.see(after - settings.restitution * slide);
            let change = (t + d + gamma).cos() - (t + gamma).cos();
            let whole = settings.restitution * (-eta * (change - pull * d + phi));
            printed.see(whole - settings.restitution * slide);
            (phi, launch) = (after, impact.next);
        }
    }
    let tolerance = 1e-8;
    Ok(vec![
        Row::new(90, "(9)", "launch velocity after an impact")
            .agrees("ψₙ₊₁ = R{k d + cos τₙ₊₁ − cos τₙ − ψₙ}", "the same")
            .within(normal, tolerance),
        Row::new(100, "(10)", "velocity along the track after an impact")
            .corrected(
                "φₙ₊₁ = Rt{−η[cos(τₙ₊₁+γ) − cos(τₙ+γ) − k tan α d + φₙ]}",
                "φₙ₊₁ = Rt{−η[cos(τₙ₊₁+γ) − cos(τₙ+γ)] − k tan α d + φₙ}",
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
                "Wₙ = (1/d) ∫ v' dτ = [η cos(τₙ+γ) + φₙ] − (k/2) tan α d − (η/d)[sin(τₙ₊₁+γ) − sin(τₙ+γ)]",
                "the same",
            )
            .within(worst, 1e-8),
    ])
}

/// (12): the next impact is a function of the last. A fine scan of the height finds no earlier touch.
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
    // f1 jumps: launches a hundredth apart, either side of one that grazes the track, fly by half a cycle longer.
    let map = Map::build(0.2, 0.5)?;
    let mut jumps = 0;
    for phase in 0..40 {
        let mut last = None;
        for velocity in 0..100 {
            let launch = Map::state(0.15 * f64::from(phase), 0.01 * f64::from(velocity))?;
            let flight = map.impact(launch).flight;
            let jump = last.is_some_and(|last: f64| (flight - last).abs() > 0.5 * TAU);
            jumps += u32::from(jump);
            last = Some(flight);
        }
    }
    // No jump seen would refute the restriction.
    earlier.see(if jumps > 0 { 0.0 } else { 1.0 });
    Ok(vec![
        Row::new(120, "(12a,b)", "from impact to impact")
            .agrees(
                "τₙ₊₁ = f₁(τₙ, ψₙ), ψₙ₊₁ = f₂(τₙ, ψₙ)",
                "the same, with a restriction: f₁ jumps across the grazing launches, and ψ = 0 with sin τ < k \
                 is followed by rest",
            )
            // Rounding of heights of up to 60.
            .within(earlier, 1e-12),
    ])
}
