//! Equations (26), (27), (33), (34): means over impacts of any hopping regime.

use kband::impact::{Contact, Impact, Kernel, Map, Observer, Orbit, State, Tangential};
use kband::transport::{Conveying, stationary};

use super::chaos::{CHAOS, largest_launch};
use super::row::{Row, Work, Worst};
use crate::refusal::Refusal;

pub(super) const ROWS: &[Work] = &[means];

/// Hopping regimes in which the stationary means are checked.
const HOPPING: [(f64, f64); 6] = [
    (0.05, 0.9),
    (0.1, 0.95),
    (0.2, 0.9),
    (0.34, 0.2),
    (0.36, 0.2),
    (0.43, 0.2),
];

/// Sums over impacts that the derivation of (33) and (34) takes for zero.
#[derive(Default)]
struct Brackets {
    velocity: f64,
    cosine: f64,
}

impl Observer for Brackets {
    fn impact(&mut self, launch: State, impact: &Impact<State>) {
        self.velocity += launch.velocity;
        let (before, after) = (launch.phase, launch.phase + impact.flight);
        self.cosine += after.cos() - before.cos();
    }
}

/// (26), (27), (33), (34): the impact mean of any hopping regime.
fn means() -> Result<Vec<Row>, Refusal> {
    const IMPACTS: u64 = 4000;
    let count = IMPACTS as f64;
    let (mut mean, mut launch, mut bracket, mut exact, mut printed) = (
        Worst::default(),
        Worst::default(),
        Worst::default(),
        Worst::default(),
        Worst::default(),
    );
    for (k, restitution) in HOPPING {
        let map = Map::build(k, restitution)?;
        let tangential = Tangential::build(k, CHAOS)?;
        // The sums telescope: each is what the two ends of a run differ by, at most twice its size.
        let highest = largest_launch(k, restitution);
        let ends = 2.0 * (4.0 + highest + 2.0 * 3.0) / count;
        for run in 0..6 {
            let mut conveying = Conveying::new(tangential, Contact::new(&map));
            let mut orbit = Orbit::new(&map, Map::state(0.45 + 1e-3 * f64::from(run), 0.45)?);
            orbit.watch(200, &mut conveying);
            conveying.restart();
            let mut brackets = Brackets::default();
            let mut sum = FlightMeans::new(k, tangential, conveying.velocity());
            orbit.watch(IMPACTS, &mut (&mut conveying, &mut brackets, &mut sum));
            let conveyed = conveying.conveyed();
            // A run in which the part came to rest, as wide chaos does now and then, has no impact mean.
            let (Some(found), Some(interval)) = (conveyed.impact_mean(), conveyed.mean_interval())
            else {
                continue;
            };
            mean.see(found - sum.total / count);
            launch.see(
                (brackets.velocity / count - stationary::mean_velocity(k, restitution, interval))
                    / ends,
            );
            bracket.see(brackets.cosine / count / ends);
            let closed =
                stationary::impact_mean(k, restitution, &CHAOS, interval).unwrap_or(f64::NAN);
            exact.see((found - closed) / ends);
            let fall =
                CHAOS.incline_tangent * (1.0 + CHAOS.restitution) / (1.0 - CHAOS.restitution);
            printed.see((found - closed - k * interval * fall) / ends);
        }
    }
    // In units of what the ends of a finite run may differ by.
    Ok(vec![
        Row::new(260, "(26)", "impact mean")
            .step("⟨W⟩ = lim (1/N) Σ Wₙ; in wide chaos not the time mean")
            // The printed form of (11) cancels in the shortest hops, down to 1e-6 rad.
            .within(mean, 1e-10),
        Row::new(270, "(27)", "mean launch velocity")
            .step("⟨ψ⟩ = k D R/(1+R), exact when stationary")
            .within(launch, 1.0),
        Row::new(330, "(33)", "curly bracket")
            .corrected(
                "dropped as an approximation",
                "exactly zero in a stationary state, so nothing is lost",
            )
            .within(bracket, 1.0),
        Row::new(340, "(34)", "impact mean of any hopping")
            .corrected(
                "+ tan α",
                "⟨W⟩ = (k D/2){η (1−R)/(1+R) − tan α (1+Rt)/(1−Rt)}, exact",
            )
            .within(exact, 1.0)
            .off(printed.value),
    ])
}

/// The sum of W over flights, from equation (11) as printed.
struct FlightMeans {
    k: f64,
    tangential: Tangential,
    phi: f64,
    total: f64,
}

impl FlightMeans {
    fn new(k: f64, tangential: Tangential, phi: f64) -> Self {
        Self {
            k,
            tangential,
            phi,
            total: 0.0,
        }
    }
}

impl Observer for FlightMeans {
    fn impact(&mut self, launch: State, impact: &Impact<State>) {
        let settings = self.tangential.settings();
        let (t, d) = (launch.phase + settings.phase_lead, impact.flight);
        self.total += self.phi + settings.amplitude_ratio * t.cos()
            - 0.5 * self.k * settings.incline_tangent * d
            - settings.amplitude_ratio / d * ((t + d).sin() - t.sin());
        self.phi = self.tangential.after(launch, impact, self.phi);
    }
}
