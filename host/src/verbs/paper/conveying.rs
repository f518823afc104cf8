//! Equations (20) to (25): the velocity of locked parts, and (11) written out.

use std::f64::consts::PI;

use kband::impact::{Contact, Kernel, Map, Orbit, Tangential, TangentialSettings};
use kband::regime::Lock;
use kband::transport::{Conveying, locked};

use super::engine::{Cases, Check, Ledger};
use super::lock::{Band, bands, lock};
use crate::refusal::Refusal;

pub(super) const CHECKS: &[Check] = &[velocity, phase_lead, written_out];

/// A lock at a k in its band, and settings along the track.
struct Locked {
    restitution: f64,
    order: u32,
    k: f64,
    lock: Lock,
    along: TangentialSettings,
}

impl Locked {
    /// Draws k and the settings, with a phase lead of at most `lead` rad and `inclines`.
    fn draw(
        cases: &mut Cases,
        band: Band,
        lead: f64,
        inclines: (f64, f64),
    ) -> Result<Self, Refusal> {
        let k = band.low + cases.within(0.05, 0.95) * (band.high - band.low);
        Ok(Self {
            restitution: band.restitution,
            order: band.order,
            k,
            lock: lock(k, band.restitution, band.order)?,
            along: TangentialSettings {
                restitution: cases.within(0.0, 0.9),
                amplitude_ratio: cases.within(0.2, 3.0),
                phase_lead: cases.within(-lead, lead),
                incline_tangent: cases.within(inclines.0, inclines.1),
            },
        })
    }

    /// Time mean of the velocity, measured on the map after the part has settled.
    fn measure(&self) -> Result<f64, Refusal> {
        let map = Map::build(self.k, self.restitution)?;
        let tangential = Tangential::build(self.k, self.along)?;
        let mut conveying = Conveying::new(tangential, Contact::new(&map));
        let mut orbit = Orbit::new(&map, self.lock.state());
        orbit.watch(300, &mut conveying);
        conveying.restart();
        orbit.watch(20, &mut conveying);
        Ok(conveying.conveyed().time_mean().unwrap_or(f64::NAN))
    }

    /// (23) as printed.
    fn written_out(&self) -> f64 {
        let TangentialSettings {
            restitution: rt,
            amplitude_ratio: eta,
            phase_lead: gamma,
            incline_tangent: tangent,
        } = self.along;
        let flight = PI * f64::from(self.order) * self.k;
        let loss = (1.0 - self.restitution) / (1.0 + self.restitution);
        flight * (eta * gamma.cos() * loss - tangent * (1.0 + rt) / (1.0 - rt))
            - eta * gamma.sin() * (1.0 - (flight * loss).powi(2)).sqrt()
    }
}

/// (20) to (23): the velocity of locked parts.
fn velocity(rows: &mut Ledger) -> Result<(), Refusal> {
    let mut cases = Cases::new(8);
    for band in bands()? {
        let mut case = Locked::draw(&mut cases, band, 3.0, (-0.3, 0.3))?;
        let velocity = case.measure()?;
        rows.compare(
            "(20)",
            locked::velocity(&case.lock, case.k, &case.along),
            velocity,
        );
        rows.compare("(23)", case.written_out(), velocity);
        case.along.phase_lead = 0.0;
        let closed = locked::velocity_in_phase(case.order, case.k, case.restitution, &case.along);
        rows.compare("(21)", closed, case.measure()?);
        let slope = locked::critical_slope_in_phase(case.restitution, &case.along);
        case.along.incline_tangent = slope;
        rows.compare("(22)", case.measure()?, 0.0);
    }
    Ok(())
}

/// Critical slope and best phase lead of locked parts.
fn phase_lead(rows: &mut Ledger) -> Result<(), Refusal> {
    let mut cases = Cases::new(9);
    for band in bands()? {
        let mut case = Locked::draw(&mut cases, band, 1.5, (0.0, 0.2))?;
        let (drawn, best) = (case.along.phase_lead, -case.lock.state().phase);
        let mut velocity = |lead: f64| {
            case.along.phase_lead = lead;
            case.measure()
        };
        let beside = velocity(best + 0.01)?.max(velocity(best - 0.01)?);
        rows.at_most("finding lead", beside, velocity(best)?);
        case.along.phase_lead = drawn;
        case.along.incline_tangent = locked::critical_slope(&case.lock, case.k, &case.along);
        if case.along.incline_tangent.abs() <= 2.0 {
            rows.compare("finding slope", case.measure()?, 0.0);
        }
    }
    Ok(())
}

/// (24), (25): the mean velocity in a flight, written out in cos(gamma) and sin(gamma).
fn written_out(rows: &mut Ledger) -> Result<(), Refusal> {
    let mut cases = Cases::new(13);
    for _ in 0..1200 {
        let flight = cases.flight()?;
        let along = cases.settings();
        let phi = cases.within(-2.0, 2.0);
        let (t, psi, d) = flight.parts();
        let (eta, gamma) = (along.amplitude_ratio, along.phase_lead);
        let pull = flight.k * along.incline_tangent;
        let mean =
            Tangential::build(flight.k, along)?.distance(flight.launch, &flight.impact, phi) / d;
        let sines = eta * gamma.cos() / d * ((t + d).sin() - t.sin());
        let cosines = eta * gamma.sin() / d * ((t + d).cos() - t.cos());
        let split = eta * (t + gamma).cos() - 0.5 * pull * d + phi - sines - cosines;
        rows.compare("(24)", split, mean);
        let rest =
            phi - eta * gamma.cos() * psi + d * (0.5 * eta * flight.k * gamma.cos() - 0.5 * pull);
        rows.compare("(25)", rest - eta * gamma.sin() * t.sin() - cosines, mean);
    }
    Ok(())
}
