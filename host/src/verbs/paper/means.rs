//! Equations (26) to (29) and (34): sums and means over the impacts of orbits, and what follows from them.

use std::f64::consts::TAU;

use kband::impact::{
    Contact, Impact, Kernel, Map, Observer, Orbit, PartState, Tangential, TangentialSettings,
};
use kband::regime::band;
use kband::transport::stationary::{self, PhaseMeans};
use kband::transport::{Conveyed, Conveying};

use super::chaos::{CHAOS, largest_launch};
use super::flight::settings;
use super::row::{Cases, Row, Work, Worst};
use crate::refusal::Refusal;

pub(super) const ROWS: &[Work] = &[sums, means, with_lead, moments, energy];

/// Hopping regimes in which the stationary means are checked.
const HOPPING: [(f64, f64); 6] = [
    (0.05, 0.9),
    (0.1, 0.95),
    (0.2, 0.9),
    (0.34, 0.2),
    (0.36, 0.2),
    (0.43, 0.2),
];

/// Impacts of one run.
const IMPACTS: u64 = 4000;

/// Runs a part of `settings` in every hopping regime, `also` watching, and gives what it conveyed to `see` with k and
/// R; a run in which the part came to rest, as wide chaos does now and then, has no impact mean and is left out.
fn hop<O: Observer>(
    settings: TangentialSettings,
    also: impl Fn(f64, Tangential, f64) -> O,
    mut see: impl FnMut(f64, f64, &Conveyed, &O),
) -> Result<(), Refusal> {
    for (k, restitution) in HOPPING {
        let map = Map::build(k, restitution)?;
        let tangential = Tangential::build(k, settings)?;
        for run in 0..6 {
            let mut conveying = Conveying::new(tangential, Contact::new(&map));
            let mut orbit = Orbit::new(&map, Map::state(0.45 + 1e-3 * f64::from(run), 0.45)?);
            orbit.watch(200, &mut conveying);
            let phi = conveying.velocity();
            conveying.restart();
            let mut also = also(k, tangential, phi);
            orbit.watch(IMPACTS, &mut (&mut conveying, &mut also));
            let conveyed = conveying.conveyed();
            if conveyed.rests == 0 {
                see(k, restitution, &conveyed, &also);
            }
        }
    }
    Ok(())
}

/// What the two ends of a run may leave of a sum that telescopes, per impact: at most twice the size of its terms.
fn ends(k: f64, restitution: f64) -> f64 {
    2.0 * (4.0 + largest_launch(k, restitution) + 2.0 * 3.0) / IMPACTS as f64
}

/// (26) to (28): both velocities after n impacts, as sums over all before.
fn sums() -> Result<Vec<Row>, Refusal> {
    let mut cases = Cases::new(14);
    let (mut along, mut normal, mut printed) =
        (Worst::default(), Worst::default(), Worst::default());
    let (mut step, mut time) = (Worst::default(), Worst::default());
    for _ in 0..200 {
        let k = cases.within(0.1, 0.6);
        let r = cases.within(0.2, 0.9);
        let settings = TangentialSettings {
            restitution: cases.within(0.2, 0.9),
            phase_lead: 0.0,
            ..settings(&mut cases)
        };
        let (rt, eta) = (settings.restitution, settings.amplitude_ratio);
        let map = Map::build(k, r)?;
        let tangential = Tangential::build(k, settings)?;
        let start = Map::state(cases.within(0.0, TAU), cases.within(1.0, 3.0))?;
        let (mut launch, mut phi) = (start, cases.within(-1.0, 1.0));
        let (phi0, psi0) = (phi, launch.velocity);
        // tau_l counted on from the start, as (28) does.
        let mut times = vec![0.0];
        let mut clock = start.phase;
        for n in 1..=12_i32 {
            let impact = map.impact(launch);
            let d = impact.flight;
            if d < 1e-2 {
                break;
            }
            let delta = (clock + d).cos() - clock.cos();
            step.see(impact.next.velocity / r + launch.velocity - k * d - delta);
            clock += d;
            times.push(clock - start.phase);
            phi = tangential.after(launch, &impact, phi);
            launch = impact.next;
            let wrapped = (clock - launch.phase) / TAU;
            time.see((wrapped - wrapped.round()) * TAU);
            let sum = |base: f64, term: &dyn Fn(f64, f64) -> f64| -> f64 {
                let terms = times.windows(2).enumerate().map(|(l, pair)| {
                    let (before, after) = (start.phase + pair[0], start.phase + pair[1]);
                    base.powi(-(l as i32)) * term(pair[1] - pair[0], after.cos() - before.cos())
                });
                base.powi(n) * terms.sum::<f64>()
            };
            let pull = k * settings.incline_tangent;
            let slides = sum(rt, &|d, delta| -pull * d - eta * delta);
            along.see(rt.powi(n) * phi0 + slides - phi);
            let begun = (-r).powi(n) * psi0;
            normal.see(begun + sum(-r, &|d, delta| -(k * d + delta)) - launch.velocity);
            printed.see(begun + sum(-r, &|d, delta| k * d - delta) - launch.velocity);
        }
    }
    Ok(vec![
        Row::new(260, "(26a)", "velocity along the track after n impacts")
            .agrees(
                "φₙ = Rtⁿ φ₀ + Rtⁿ Σ_{l<n} Rt⁻ˡ[−k tan α (τₗ₊₁−τₗ) − η δ(τₗ)]",
                "the same at γ = 0; in general δ = cos(τₗ₊₁+γ) − cos(τₗ+γ)",
            )
            .within(along, 1e-10),
        Row::new(261, "(26b)", "launch velocity after n impacts")
            .corrected(
                "ψₙ = (−R)ⁿ ψ₀ + (−R)ⁿ Σ_{l<n} (−R)⁻ˡ[k(τₗ₊₁−τₗ) − δ(τₗ)]",
                "ψₙ = (−R)ⁿ ψ₀ − (−R)ⁿ Σ_{l<n} (−R)⁻ˡ[k(τₗ₊₁−τₗ) + δ(τₗ)]",
            )
            .within(normal, 1e-10)
            .off(printed.value),
        Row::new(270, "(27)", "what the track adds in a flight")
            .agrees("δ(τₗ) = cos τₗ₊₁ − cos τₗ", "the same: ψ'/R + ψ − k d")
            .within(step, 1e-10),
        Row::new(280, "(28)", "times of impact")
            .agrees("τₙ = Σ_{l<n} zₗ, τ₀ = 0", "the same, an identity")
            .within(time, 1e-10),
    ])
}

/// Sums over impacts that the derivation of (33) and (34) takes for zero.
#[derive(Default)]
struct Brackets {
    velocity: f64,
    cosine: f64,
}

impl Observer for Brackets {
    fn impact(&mut self, launch: PartState, impact: &Impact<PartState>) {
        self.velocity += launch.velocity;
        let (before, after) = (launch.phase, launch.phase + impact.flight);
        self.cosine += after.cos() - before.cos();
    }
}

/// (34): the impact mean of any hopping regime at gamma = 0.
fn means() -> Result<Vec<Row>, Refusal> {
    let count = IMPACTS as f64;
    let (mut launch, mut bracket, mut exact, mut printed) = (
        Worst::default(),
        Worst::default(),
        Worst::default(),
        Worst::default(),
    );
    hop(
        CHAOS,
        |_, _, _| Brackets::default(),
        |k, restitution, conveyed, brackets| {
            let ends = ends(k, restitution);
            let found = conveyed.impact_mean().unwrap_or(f64::NAN);
            let interval = conveyed.mean_interval().unwrap_or(f64::NAN);
            let expected = stationary::mean_velocity(k, restitution, interval);
            launch.see((brackets.velocity / count - expected) / ends);
            bracket.see(brackets.cosine / count / ends);
            let closed =
                stationary::impact_mean(k, restitution, &CHAOS, interval).unwrap_or(f64::NAN);
            exact.see((found - closed) / ends);
            let fall =
                CHAOS.incline_tangent * (1.0 + CHAOS.restitution) / (1.0 - CHAOS.restitution);
            printed.see((found - closed - k * interval * fall) / ends);
        },
    )?;
    // In units of what the ends of a finite run may differ by.
    Ok(vec![
        Row::new(340, "(34)", "impact mean of any hopping regime")
            .corrected(
                "⟨W⟩ ≈ (k Δ/2)[η(1−R)/(1+R) + tan α (1+Rt)/(1−Rt)]",
                "⟨W⟩ = (k Δ/2)[η(1−R)/(1+R) − tan α (1+Rt)/(1−Rt)], exact",
            )
            .within(exact, 1.0)
            .off(printed.value),
        Row::new(904, "finding", "the bracket {} of (33)")
            .found(
                "exactly zero in a stationary state, as ⟨cos τₗ₊₁⟩ = ⟨cos τₗ⟩: (34) is no approximation",
            )
            .within(bracket, 1.0),
        Row::new(905, "finding", "mean launch velocity")
            .found("⟨ψ⟩ = k Δ R/(1+R), exact when stationary")
            .within(launch, 1.0),
    ])
}

/// The means that stand in (29), flight by flight.
struct Stated {
    k: f64,
    tangential: Tangential,
    phi: f64,
    count: f64,
    along: f64,
    normal: f64,
    time: f64,
    sine: f64,
    chord: f64,
}

impl Stated {
    fn new(k: f64, tangential: Tangential, phi: f64) -> Self {
        Self {
            k,
            tangential,
            phi,
            count: 0.0,
            along: 0.0,
            normal: 0.0,
            time: 0.0,
            sine: 0.0,
            chord: 0.0,
        }
    }

    /// (29) as printed.
    fn mean(&self) -> f64 {
        let s = self.tangential.settings();
        let (eta, gamma) = (s.amplitude_ratio, s.phase_lead);
        let flight = 0.5 * self.k * (eta * gamma.cos() - s.incline_tangent);
        let sum = self.along - eta * gamma.cos() * self.normal + self.time * flight
            - eta * gamma.sin() * (self.sine + self.chord);
        sum / self.count
    }
}

impl Observer for Stated {
    fn impact(&mut self, launch: PartState, impact: &Impact<PartState>) {
        let (t, d) = (launch.phase, impact.flight);
        self.count += 1.0;
        self.along += self.phi;
        self.normal += launch.velocity;
        self.time += d;
        self.sine += t.sin();
        self.chord += ((t + d).cos() - t.cos()) / d;
        self.phi = self.tangential.after(launch, impact, self.phi);
    }
}

/// (29): the impact mean with a phase lead, from means over the impacts.
fn with_lead() -> Result<Vec<Row>, Refusal> {
    let leading = TangentialSettings {
        restitution: 0.3,
        amplitude_ratio: 1.7,
        phase_lead: 0.6,
        incline_tangent: 0.07,
    };
    let (mut stated, mut exact) = (Worst::default(), Worst::default());
    hop(
        leading,
        |k, tangential, phi| (Stated::new(k, tangential, phi), PhaseMeans::default()),
        |k, restitution, conveyed, (means, phases)| {
            let found = conveyed.impact_mean().unwrap_or(f64::NAN);
            stated.see(found - means.mean());
            let closed = phases
                .impact_mean(k, restitution, &leading)
                .unwrap_or(f64::NAN);
            exact.see((found - closed) / ends(k, restitution));
        },
    )?;
    Ok(vec![
        Row::new(290, "(29)", "impact mean from the means of its terms")
            .agrees(
                "⟨Wₙ⟩ = ⟨φₙ⟩ − η cos γ⟨ψₙ⟩ + Δ{(ηk/2) cos γ − (k/2) tan α} − η sin γ⟨sin τₙ⟩ \
                 − η sin γ⟨(cos τₙ₊₁−cos τₙ)/(τₙ₊₁−τₙ)⟩",
                "the same: the mean of (25)",
            )
            // Rounding of (25) in the shortest hops, of 1e-6 rad.
            .within(stated, 1e-9),
        Row::new(906, "finding", "impact mean at every γ")
            .found(
                "⟨W⟩ = (kΔ/2)[η cos γ(1−R)/(1+R) − tan α(1+Rt)/(1−Rt)] − η sin γ[⟨sin τ⟩ + ⟨(cos τ'−cos τ)/d⟩], \
                 exact when stationary",
            )
            .within(exact, 1.0),
    ])
}

/// `<d^2>` and `<(phi - eta psi) d>`, as sums.
struct Moments {
    tangential: Tangential,
    phi: f64,
    squares: f64,
    mixed: f64,
}

impl Observer for Moments {
    fn impact(&mut self, launch: PartState, impact: &Impact<PartState>) {
        let d = impact.flight;
        let eta = self.tangential.settings().amplitude_ratio;
        self.squares += d * d;
        self.mixed += (self.phi - eta * launch.velocity) * d;
        self.phi = self.tangential.after(launch, impact, self.phi);
    }
}

/// The time mean by moments of the flights.
fn moments() -> Result<Vec<Row>, Refusal> {
    let mut worst = Worst::default();
    hop(
        CHAOS,
        |_, tangential, phi| Moments {
            tangential,
            phi,
            squares: 0.0,
            mixed: 0.0,
        },
        |k, _, conveyed, moments| {
            let drive = 0.5 * k * (CHAOS.amplitude_ratio - CHAOS.incline_tangent);
            let by = (drive * moments.squares + moments.mixed) / conveyed.flying;
            worst.see(by - conveyed.time_mean().unwrap_or(f64::NAN));
        },
    )?;
    Ok(vec![
        Row::new(907, "finding", "time mean by moments, γ = 0")
            .found(
                "V = k(η − tan α)⟨d²⟩/(2⟨d⟩) + ⟨(φ − ηψ) d⟩/⟨d⟩: long flights weigh more, so it exceeds (37)",
            )
            .within(worst, 1e-10),
    ])
}

/// Sums of the energy identity.
#[derive(Default)]
struct Energy {
    squares: f64,
    mixed: f64,
}

impl Observer for Energy {
    fn impact(&mut self, launch: PartState, _: &Impact<PartState>) {
        self.squares += launch.velocity * launch.velocity;
        self.mixed += launch.velocity * launch.phase.cos();
    }
}

/// The energy identity, and the bounds that follow from it.
fn energy() -> Result<Vec<Row>, Refusal> {
    let count = IMPACTS as f64;
    let (mut identity, mut bound) = (Worst::default(), Worst::default());
    let share = |k: f64, r: f64, square: f64, interval: f64| {
        let launch = square.sqrt() / (2.0 * r / (1.0 - r));
        launch.max(interval / (2.0 / k * (1.0 + r) / (1.0 - r)))
    };
    hop(
        CHAOS,
        |_, _, _| Energy::default(),
        |k, r, conveyed, energy| {
            let highest = largest_launch(k, r);
            // Four sums telescope: psi^2, psi cos, cos^2 and 2 k sin, weighed by R^2/(1 - R^2).
            let ends = r * r / (1.0 - r * r)
                * (4.0 * k + 2.0 + 2.0 * highest * (highest / r + 2.0) / r)
                / count;
            let gain = 2.0 * r / (1.0 - r);
            identity.see((energy.squares - gain * energy.mixed) / count / ends);
            let interval = conveyed.mean_interval().unwrap_or(f64::NAN);
            bound.see((share(k, r, energy.squares / count, interval) - 1.0).max(0.0));
        },
    )?;
    // Equality at the birth of the lock, where cos t0 = 1.
    for n in 1..19 {
        let r = 0.05 * f64::from(n);
        let k = band::birth(r, 1)?;
        let psi = TAU * k * r / (1.0 + r);
        bound.see(share(k, r, psi * psi, TAU) - 1.0);
    }
    Ok(vec![
        Row::new(908, "finding", "energy identity")
            .found("⟨ψ²⟩ = (2R/(1−R))⟨ψ cos τ⟩, exact when stationary")
            .within(identity, 1.0),
        Row::new(909, "finding", "theorem behind (36) and (37)")
            .found(
                "rms ψ ≤ 2R/(1−R) and Δ ≤ (2/k)(1+R)/(1−R) in any stationary regime, equal only for the lock at k₁",
            )
            .within(bound, 1e-12),
    ])
}
