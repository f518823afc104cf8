//! Equations (1) to (11): motion, flight, impact.

use std::f64::consts::TAU;

use kband::impact::{Kernel, Map, Tangential, TangentialSettings};

use super::row::{Cases, Row, Verdict, Work, Worst, integrated};
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
        Row {
            place: 10,
            equation: "(1)".into(),
            subject: "motion in the laboratory",
            printed: "not transcribed".into(),
            recomputed: "free flight between impacts, seen from the shaken track".into(),
            verdict: Verdict::Step,
            residual: normal.value,
            tolerance,
            printed_error: None,
            cases: normal.cases,
        },
        Row {
            place: 20,
            equation: "(2)".into(),
            subject: "equations of motion",
            printed: "u'' = sin τ − k; v'' with −k + g(α)".into(),
            recomputed: "u'' = sin τ − k; v'' = η sin(τ+γ) − k tan α".into(),
            verdict: Verdict::Corrected,
            residual: along.value,
            tolerance,
            printed_error: Some(printed_pull.value),
            cases: along.cases,
        },
        Row {
            place: 30,
            equation: "(3)".into(),
            subject: "scaling",
            printed: "v = x/a".into(),
            recomputed: "v = x/b: both coordinates in units of the normal amplitude".into(),
            verdict: Verdict::Corrected,
            residual: scale.value,
            tolerance,
            printed_error: Some(printed_scale.value),
            cases: scale.cases,
        },
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
    let step = |place, equation: &str, subject, recomputed: &str, worst: Worst| Row {
        place,
        equation: equation.into(),
        subject,
        printed: "not transcribed".into(),
        recomputed: recomputed.into(),
        verdict: Verdict::Step,
        residual: worst.value,
        // The integration's own error for flights of up to 60.
        tolerance: 1e-8,
        printed_error: None,
        cases: worst.cases,
    };
    Ok(vec![
        step(
            40,
            "(4)",
            "impact, normal",
            "u'(after) = −R u'(before)",
            normal,
        ),
        step(
            50,
            "(5)",
            "impact, along the track",
            "v'(after) = Rt v'(before)",
            along,
        ),
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
    Ok(vec![Row {
        place: 60,
        equation: "(6)".into(),
        subject: "from impact to impact",
        printed: "not transcribed".into(),
        recomputed: "the next impact is the FIRST d > 0 with u(d) = 0; none is missed".into(),
        verdict: Verdict::Step,
        residual: earlier.value,
        // Rounding of heights of up to 60.
        tolerance: 1e-12,
        printed_error: None,
        cases: earlier.cases,
    }])
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
        Row {
            place: 70,
            equation: "(7b)".into(),
            subject: "height during a flight",
            printed: "u = (cos t + ψ) d − k d²/2 − [sin(t+d) − sin t]".into(),
            recomputed: "the same".into(),
            verdict: Verdict::Agrees,
            residual: normal.value,
            tolerance,
            printed_error: None,
            cases: normal.cases,
        },
        Row {
            place: 71,
            equation: "(7c)".into(),
            subject: "velocity along the track in flight",
            printed: "η multiplies the whole bracket".into(),
            recomputed: "v' = φ − η [cos(t+d+γ) − cos(t+γ)] − k tan α d".into(),
            verdict: Verdict::Corrected,
            residual: along.value,
            tolerance,
            printed_error: Some(printed.value),
            cases: along.cases,
        },
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
        Row {
            place: 80,
            equation: "(8)".into(),
            subject: "flight time",
            printed: "u(d) = 0 with (7b)".into(),
            recomputed: "the same; the map's root solves it".into(),
            verdict: Verdict::Agrees,
            residual: root.value,
            // A few roundings of its terms.
            tolerance: 4.0 * f64::EPSILON,
            printed_error: None,
            cases: root.cases,
        },
        Row {
            place: 81,
            equation: "(8) in f64".into(),
            subject: "flight time of chatter, ψ = 2e-7",
            printed: "as printed: all digits cancel".into(),
            recomputed: "u/d = ψ + d {sin t C(d) − k/2 + d cos t S(d)}, relative error".into(),
            verdict: Verdict::Corrected,
            residual: deflated.value,
            tolerance: 1e-12,
            printed_error: Some(printed.value),
            cases: deflated.cases,
        },
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
        Row {
            place: 90,
            equation: "(9)".into(),
            subject: "launch velocity after an impact",
            printed: "ψ' = R s, s the arrival speed".into(),
            recomputed: "the same".into(),
            verdict: Verdict::Agrees,
            residual: normal.value,
            tolerance,
            printed_error: None,
            cases: normal.cases,
        },
        Row {
            place: 100,
            equation: "(10)".into(),
            subject: "velocity along the track after an impact",
            printed: "η multiplies the whole bracket".into(),
            recomputed: "φ' = Rt {φ − η [cos(t+d+γ) − cos(t+γ)] − k tan α d}".into(),
            verdict: Verdict::Corrected,
            residual: along.value,
            tolerance,
            printed_error: Some(printed.value),
            cases: along.cases,
        },
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
        let kept = Tangential::build(flight.k, settings)?.way(flight.launch, &flight.impact, phi);
        worst.see((kept - way) / d);
    }
    Ok(vec![Row {
        place: 110,
        equation: "(11)".into(),
        subject: "mean velocity in a flight",
        printed: "W = φ + η cos(t+γ) − (k/2) tan α d − (η/d)[sin(t+d+γ) − sin(t+γ)]".into(),
        recomputed: "the same".into(),
        verdict: Verdict::Agrees,
        residual: worst.value,
        tolerance: 1e-8,
        printed_error: None,
        cases: worst.cases,
    }])
}
