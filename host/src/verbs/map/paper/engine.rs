//! The engine of the comparison: the table of rows, the evidence for each, and seeded cases.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use kband::feeder::OutOfRange;
use kband::impact::{
    Impact, Kernel, Map, Observer, Orbit, PartState, Tangential, TangentialSettings,
};
use kband::transport::{Conveyed, Effort, SampleMean, measure};
use serde::Deserialize;
use toml::Spanned;

use super::flight::Flight;
use crate::desk::Desk;
use crate::refusal::{Refusal, Result};
use crate::report::number;

/// Texts, verdicts and tolerances of all rows, in the order of the page.
const TABLE: &str = include_str!("rows.toml");

/// One equation, number or claim, with its numerical evidence.
#[derive(Clone, Debug, Deserialize)]
pub(super) struct Row {
    /// Number of the equation as printed, or `example`, `claim`, `finding`.
    #[serde(skip)]
    pub equation: String,
    pub subject: String,
    #[serde(default)]
    pub printed: String,
    pub recomputed: String,
    /// `agrees`, `corrected`, `refuted` or `own finding`.
    pub verdict: String,
    pub tolerance: f64,
    #[serde(skip)]
    pub evidence: Evidence,
}

impl Row {
    /// Whether the residual is within the tolerance.
    pub fn holds(&self) -> bool {
        self.evidence.residual <= self.tolerance
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct Evidence {
    /// Largest deviation of the recomputed form from its reference, over all cases.
    pub residual: f64,
    /// Largest deviation of the printed form in the same measure, if it can be evaluated.
    pub printed_error: Option<f64>,
    pub cases: u64,
    values: Vec<String>,
}

/// Larger of two deviations; NaN counts as the largest.
fn max_or_nan(largest: f64, deviation: f64) -> f64 {
    let deviation = deviation.abs();
    let is_larger = deviation.is_nan() || deviation > largest;
    if is_larger { deviation } else { largest }
}

pub(super) type Check = fn(&mut Ledger) -> Result<()>;

#[derive(Clone, Debug, Default)]
pub(super) struct Ledger {
    evidence: BTreeMap<&'static str, Evidence>,
    /// Relative error added to each recomputed value; zero except in the test of the checks.
    error: f64,
}

impl Ledger {
    fn row(&mut self, key: &'static str) -> &mut Evidence {
        self.evidence.entry(key).or_default()
    }

    pub(super) fn deviation(&mut self, key: &'static str, deviation: f64) {
        let row = self.row(key);
        row.residual = max_or_nan(row.residual, deviation);
        row.cases += 1;
    }

    pub(super) fn compare(&mut self, key: &'static str, ours: f64, reference: f64) {
        self.compare_in(key, ours, reference, 1.0);
    }

    /// Compares a recomputed value with its reference, in multiples of `unit`.
    pub(super) fn compare_in(&mut self, key: &'static str, ours: f64, reference: f64, unit: f64) {
        let ours = ours + self.error * (1.0 + ours.abs());
        self.deviation(key, (ours - reference) / unit);
    }

    /// Records by how much a value exceeds its bound.
    pub(super) fn at_most(&mut self, key: &'static str, value: f64, bound: f64) {
        let excess = value - bound;
        self.deviation(key, if excess <= 0.0 { 0.0 } else { excess });
    }

    /// Records a condition; a false one fails the row.
    pub(super) fn require(&mut self, key: &'static str, holds: bool) {
        self.deviation(key, if holds { 0.0 } else { f64::INFINITY });
    }

    /// Compares the literal print with the reference.
    pub(super) fn print(&mut self, key: &'static str, printed: f64, reference: f64) {
        let row = self.row(key);
        let largest = row.printed_error.unwrap_or(0.0);
        row.printed_error = Some(max_or_nan(largest, printed - reference));
    }

    /// Sets the numbers in the row's text, each with its number of digits.
    pub(super) fn fill(&mut self, key: &'static str, values: &[(f64, usize)]) {
        let text = |(value, digits): &(f64, usize)| number(*value, *digits);
        self.row(key).values = values.iter().map(text).collect();
    }

    /// Sets the number of cases, if one deviation summarizes many.
    pub(super) fn count(&mut self, key: &'static str, cases: u64) {
        self.row(key).cases = cases;
    }
}

/// Runs the checks on the desk's threads and fills the table, in the order of the page.
pub(super) fn recompute(checks: &[Check], error: f64, desk: &Desk) -> Result<Vec<Row>> {
    let table: BTreeMap<String, Spanned<Row>> = toml::from_str(TABLE)
        .map_err(|error| Refusal::new(format!("table of the paper: {error}"), "report this"))?;
    let ledgers = desk.try_map("the paper", checks.len(), |n| {
        let mut ledger = Ledger {
            error,
            ..Ledger::default()
        };
        checks[n](&mut ledger).map(|()| ledger)
    })?;
    let mut all = Ledger::default();
    for ledger in ledgers {
        all.evidence.extend(ledger.evidence);
    }
    let mut sections: Vec<_> = table.into_iter().collect();
    sections.sort_by_key(|(_, row)| row.span().start);
    let complete = |(key, row): (String, Spanned<Row>)| {
        let mut row = row.into_inner();
        // Without evidence a row fails.
        row.evidence = all.evidence.remove(&*key).unwrap_or(Evidence {
            residual: f64::NAN,
            ..Evidence::default()
        });
        for (value, n) in row.evidence.values.iter().zip(1..) {
            let place = format!("{{{n}}}");
            row.printed = row.printed.replace(&place, value);
            row.recomputed = row.recomputed.replace(&place, value);
        }
        row.equation = key.split(' ').next().unwrap_or(&key).into();
        // For an agreeing row the recomputed form is the printed form.
        if row.verdict == "agrees" {
            row.evidence.printed_error = Some(row.evidence.residual);
        }
        row
    };
    let rows = sections.into_iter().map(complete).collect();
    debug_assert!(all.evidence.is_empty(), "no rows: {:?}", all.evidence);
    Ok(rows)
}

/// Seeded random cases, equal in every run.
pub(super) use crate::random::SplitMix as Cases;

impl Cases {
    pub(super) fn settings(&mut self) -> TangentialSettings {
        let (rt, eta) = (self.within(0.0, 0.95), self.within(0.2, 3.0));
        along(rt, eta, self.within(-3.0, 3.0), self.within(-0.3, 0.3))
    }

    /// A flight short enough to integrate, its restitution, and its impact.
    pub(super) fn flight(&mut self) -> Result<(Flight, f64, Impact<PartState>), OutOfRange> {
        let k = self.within(0.1, 1.5);
        let restitution = self.within(0.0, 1.0);
        let launch = Map::state(self.within(0.0, TAU), self.within(0.05, 3.0))?;
        let impact = Map::build(k, restitution)?.impact(launch);
        Ok((Flight::new(k, launch, &impact), restitution, impact))
    }
}

/// The motion along the track by the symbols of the paper: Rt, eta, gamma and tan(alpha).
pub(super) const fn along(rt: f64, eta: f64, gamma: f64, tangent: f64) -> TangentialSettings {
    TangentialSettings {
        restitution: rt,
        amplitude_ratio: eta,
        phase_lead: gamma,
        incline_tangent: tangent,
    }
}

/// The flights of an orbit: launch and impact of each.
#[derive(Default)]
pub(super) struct Flights(pub Vec<(PartState, Impact<PartState>)>);

impl Observer for Flights {
    fn impact(&mut self, launch: PartState, impact: &Impact<PartState>) {
        self.0.push((launch, *impact));
    }
}

pub(super) fn convey(
    map: &Map,
    along: TangentialSettings,
    launch: PartState,
    [settle, impacts]: [u64; 2],
) -> Result<Conveyed, OutOfRange> {
    let tangential = Tangential::build(map.k(), along)?;
    let effort = Effort { settle, impacts };
    Ok(measure(Orbit::new(map, launch), tangential, effort, &mut ()).conveyed)
}

pub(super) fn estimate(spread: &SampleMean) -> (f64, f64) {
    let [mean, error] = [spread.mean(), spread.error()].map(|value| value.unwrap_or(f64::NAN));
    (mean, error)
}
