//! Equations (1) to (12), (24) and (25): motion, impact, flight.

use std::f64::consts::{PI, TAU};

use kband::impact::{Impact, Kernel, Map, PartState, Tangential, TangentialSettings};

use super::engine::{Cases, Check, Ledger};
use crate::refusal::Result;

pub(super) const CHECKS: &[Check] = &[
    laboratory,
    impact_laws,
    sides,
    flight_time,
    maps,
    mean_velocity,
    first_return,
];

/// (1) to (3): motion of part and track in the laboratory, in SI units, against the dimensionless
/// equations; (7): both coordinates during a flight.
fn laboratory(rows: &mut Ledger) -> Result<()> {
    const GRAVITY: f64 = 9.81;
    let mut cases = Cases(1);
    for _ in 0..300 {
        let along = cases.settings();
        let w = TAU * cases.within(10.0, 200.0);
        let incline = along.incline_tangent.atan();
        let (g_normal, g_along) = (GRAVITY * incline.cos(), GRAVITY * incline.sin());
        let k = cases.within(0.1, 1.5);
        let b = g_normal / (k * w * w);
        let (t, d) = (cases.within(0.0, TAU), cases.within(0.1, 12.0));
        let (psi, phi) = (cases.within(0.1, 3.0), cases.within(-2.0, 2.0));
        let flight = Flight { k, t, psi, d };
        // Free flight from the track, in the laboratory from time 0 to d/w, relative to the track.
        let time = d / w;
        let (a, gamma) = (along.amplitude_ratio * b, along.phase_lead);
        let y = b * w * (psi + t.cos()) * time
            - 0.5 * g_normal * time * time
            - b * ((t + d).sin() - t.sin());
        let x = (b * w * phi + a * w * (t + gamma).cos()) * time
            - 0.5 * g_along * time * time
            - a * ((t + d + gamma).sin() - (t + gamma).sin());
        // (1) in metres and seconds, with F = N = 0.
        let normal_push = |s: f64| b * w * w * (w * s).sin() - g_normal;
        let along_push = |s: f64| a * w * w * (w * s + gamma).sin() - g_along;
        let (height, _) = integrated(t / w, time, b * w * psi, normal_push);
        let (distance, _) = integrated(t / w, time, b * w * phi, along_push);
        rows.compare_in("(1a)", x, distance, b);
        rows.compare_in("(1b)", y, height, b);
        // N = m (g cos(alpha) - b w^2 sin(w t)) at rest; it is zero at lift-off.
        if let Some(lift_off) = Map::build(k, 0.5)?.lift_off() {
            let force = g_normal - b * w * w * lift_off.sin();
            rows.compare_in("(1b)", force, 0.0, b * w * w);
        }
        let (u, rising) = flight.rise();
        let (v, sliding) = flight.slide(&along, phi);
        rows.compare("(2a)", y / b, u);
        rows.compare("(2b)", x / b, v);
        // g(alpha) read as tg(alpha).
        let literal =
            |tau: f64| along.amplitude_ratio * (tau + gamma).sin() - k + along.incline_tangent;
        rows.print("(2b)", integrated(t, d, phi, literal).0, x / b);
        rows.compare("(3)", x / b, v);
        rows.print("(3)", x / a, v);
        let [corrected, printed] = flight.velocities_along(&along, phi);
        rows.compare("(7a)", flight.velocity(), rising);
        rows.compare("(7b)", flight.height(), u);
        rows.compare("(7c)", corrected, sliding);
        rows.print("(7c)", printed, sliding);
    }
    Ok(())
}

/// (4), (5): both velocities before and after an impact.
fn impact_laws(rows: &mut Ledger) -> Result<()> {
    let mut cases = Cases(2);
    for n in 0..300 {
        let (mut flight, mut restitution, mut impact) = cases.flight()?;
        // The first two cases are the bounds of (5).
        if n < 2 {
            restitution = f64::from(n);
            impact = Map::build(flight.k, restitution)?.impact(flight.launch());
            flight.d = impact.flight;
        }
        let (along, phi) = (cases.settings(), cases.within(-2.0, 2.0));
        let (arrival, sliding) = (flight.rise().1, flight.slide(&along, phi).1);
        let next = impact.next.velocity;
        let tangential = Tangential::build(flight.k, along)?;
        let (_, after) = tangential.move_in_flight(flight.launch(), &impact, phi);
        rows.compare("(4a)", next, -restitution * arrival);
        rows.compare("(4b)", after, along.restitution * sliding);
        rows.at_most("(5)", next, arrival.abs());
        rows.at_most("(5)", after.abs(), sliding.abs());
    }
    Ok(())
}

/// (6): whether velocities are taken before or after the impact.
fn sides(rows: &mut Ledger) -> Result<()> {
    let mut cases = Cases(12);
    for _ in 0..300 {
        let (flight, _, impact) = cases.flight()?;
        // Velocity half a cycle after the impact, by (7a) with psi before and after it.
        let after = |psi| Flight {
            t: impact.next.phase,
            psi,
            d: PI,
            ..flight
        };
        let right = after(impact.next.velocity);
        rows.compare("(6)", right.velocity(), right.rise().1);
        rows.print("(6)", after(flight.rise().1).velocity(), right.rise().1);
    }
    Ok(())
}

/// (8): equation of the flight time, and the rounding error of its printed form in short hops.
fn flight_time(rows: &mut Ledger) -> Result<()> {
    let mut cases = Cases(5);
    for _ in 0..2000 {
        let (flight, ..) = cases.flight()?;
        let Flight { k, psi, d, .. } = flight;
        // Unit: the size of the terms of (8).
        let size = (1.0 + psi) * d + k * d * d + 2.0;
        rows.compare_in("(8)", flight.height(), 0.0, size);
    }
    // A hop of chatter: halfway the height is psi d/4, printed as a difference of terms of order d.
    for _ in 0..200 {
        let (k, t, psi) = (0.9, cases.within(3.3, 6.0), 2e-7);
        let d = psi / (k - t.sin());
        // The cubic term is 1e-7 of the hop, and the next one 1e-14.
        let exact = d * (psi - 0.5 * d * (k - t.sin()) + d * d * t.cos() / 6.0);
        let half = 0.5 * d;
        let versine = 0.5 * (half.sin() / half).powi(2);
        let sagitta = (1.0 - d * d / 20.0) / 6.0;
        let computed = d * (psi + d * (t.sin() * versine - 0.5 * k + d * t.cos() * sagitta));
        rows.compare("finding chatter", computed / exact, 1.0);
        let printed = Flight { k, t, psi, d }.height();
        rows.print("finding chatter", printed / exact, 1.0);
    }
    Ok(())
}

/// (9), (10): the map of both velocities over many impacts, compared with the integrated motion.
fn maps(rows: &mut Ledger) -> Result<()> {
    let mut cases = Cases(6);
    for _ in 0..60 {
        let along = cases.settings();
        let k = cases.within(0.1, 1.5);
        let r = cases.within(0.1, 0.9);
        let (map, tangential) = (Map::build(k, r)?, Tangential::build(k, along)?);
        let mut launch = Map::state(cases.within(0.0, TAU), cases.within(0.5, 3.0))?;
        let (rt, mut phi) = (along.restitution, 0.0);
        for _ in 0..5 {
            let impact = map.impact(launch);
            let flight = Flight::new(k, launch, &impact);
            if flight.d < 1e-3 {
                break;
            }
            let next = impact.next.velocity;
            rows.compare("(9)", next, -r * flight.rise().1);
            rows.compare("(9)", r * -flight.velocity(), next);
            let (_, after) = tangential.move_in_flight(launch, &impact, phi);
            let expected = rt * flight.slide(&along, phi).1;
            rows.compare("(10)", after, expected);
            let [_, printed] = flight.velocities_along(&along, phi);
            rows.print("(10)", rt * printed, expected);
            (phi, launch) = (after, impact.next);
        }
    }
    Ok(())
}

/// (11): mean velocity during a flight; (24), (25): expanded in cos(gamma) and sin(gamma).
fn mean_velocity(rows: &mut Ledger) -> Result<()> {
    let mut cases = Cases(13);
    for _ in 0..1200 {
        let (flight, _, impact) = cases.flight()?;
        let (along, phi) = (cases.settings(), cases.within(-2.0, 2.0));
        let Flight { k, t, psi, d } = flight;
        let (eta, gamma) = (along.amplitude_ratio, along.phase_lead);
        let pull = k * along.incline_tangent;
        let tangential = Tangential::build(k, along)?;
        let (distance, _) = tangential.move_in_flight(flight.launch(), &impact, phi);
        let mean = distance / d;
        rows.compare_in("(11)", distance, flight.slide(&along, phi).0, d);
        let printed = phi + eta * (t + gamma).cos()
            - 0.5 * pull * d
            - eta / d * ((t + d + gamma).sin() - (t + gamma).sin());
        rows.compare("(11)", printed, mean);
        let sines = eta * gamma.cos() / d * ((t + d).sin() - t.sin());
        let cosines = eta * gamma.sin() / d * ((t + d).cos() - t.cos());
        let split = eta * (t + gamma).cos() - 0.5 * pull * d + phi - sines - cosines;
        rows.compare("(24)", split, mean);
        let rest = phi - eta * gamma.cos() * psi + d * (0.5 * eta * k * gamma.cos() - 0.5 * pull);
        rows.compare("(25)", rest - eta * gamma.sin() * t.sin() - cosines, mean);
    }
    Ok(())
}

/// (12): the next impact is a function of the last one. A fine scan of the height finds no earlier
/// touch, and f1 has jumps.
fn first_return(rows: &mut Ledger) -> Result<()> {
    let mut cases = Cases(3);
    for _ in 0..400 {
        let (flight, ..) = cases.flight()?;
        let steps = (flight.d / 0.002) as u32;
        let height = |n| {
            let d = flight.d * f64::from(n) / f64::from(steps);
            Flight { d, ..flight }.height()
        };
        let deepest = (1..steps).map(height).fold(f64::INFINITY, f64::min);
        rows.at_most("(12a,b)", -deepest, 0.0);
    }
    // Launches 0.01 apart, before and after one that grazes, differ by more than half a cycle.
    let map = Map::build(0.2, 0.5)?;
    let mut jumps = false;
    for phase in 0..40 {
        let mut before: Option<f64> = None;
        for velocity in 0..100 {
            let launch = Map::state(0.15 * f64::from(phase), 0.01 * f64::from(velocity))?;
            let flight = map.impact(launch).flight;
            jumps |= before.is_some_and(|before| (flight - before).abs() > PI);
            before = Some(flight);
        }
    }
    rows.require("(12a,b)", jumps);
    Ok(())
}

/// Distance and velocity after `d` of a point that starts at 0 with `velocity` at phase `t`, by the
/// Runge-Kutta method. Its error is of order `d^2 (d/4000)^4`, below 1e-10 for d < 40.
fn integrated(t: f64, d: f64, velocity: f64, acceleration: impl Fn(f64) -> f64) -> (f64, f64) {
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

/// A flight of duration `d` from phase `t` with velocity `psi`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flight {
    pub k: f64,
    pub t: f64,
    pub psi: f64,
    pub d: f64,
}

impl Flight {
    pub fn new(k: f64, launch: PartState, impact: &Impact<PartState>) -> Self {
        Self {
            k,
            t: launch.phase,
            psi: launch.velocity,
            d: impact.flight,
        }
    }

    pub fn launch(&self) -> PartState {
        PartState::new(self.t, self.psi)
    }

    /// Height and velocity at its end, integrated by (2a).
    pub fn rise(&self) -> (f64, f64) {
        integrated(self.t, self.d, self.psi, |tau| tau.sin() - self.k)
    }

    /// Distance and velocity along the track at its end, integrated by (2b).
    pub fn slide(&self, along: &TangentialSettings, phi: f64) -> (f64, f64) {
        let (eta, gamma) = (along.amplitude_ratio, along.phase_lead);
        let pull = self.k * along.incline_tangent;
        integrated(self.t, self.d, phi, |tau| eta * (tau + gamma).sin() - pull)
    }

    /// u'(d) as printed in (7a).
    pub fn velocity(&self) -> f64 {
        let Self { k, t, psi, d } = *self;
        -k * d + t.cos() + psi - (t + d).cos()
    }

    /// u(d) as printed in (7b) and (8).
    pub fn height(&self) -> f64 {
        let Self { k, t, psi, d } = *self;
        (t.cos() + psi) * d - 0.5 * k * d * d - ((t + d).sin() - t.sin())
    }

    /// v'(d) by (7c): corrected, and as printed.
    pub fn velocities_along(&self, along: &TangentialSettings, phi: f64) -> [f64; 2] {
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
