//! The engine of the comparison: the table of rows, the evidence for each, and seeded cases.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use kband::feeder::OutOfRange;
use kband::impact::{Impact, Kernel, Map, PartState, TangentialSettings};
use kband::transport::Spread;
use serde::{Deserialize, Serialize};
use toml::Spanned;

use crate::desk::Desk;
use crate::refusal::Refusal;

/// Texts, verdicts and tolerances of all rows, in the order of the page.
const TABLE: &str = include_str!("rows.toml");

/// Verdict on a printed statement, with the recomputed form.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Verdict {
    /// It holds as printed.
    Agrees(String),
    /// It holds once corrected.
    Corrected(String),
    /// It does not hold.
    Refuted(String),
    /// The paper does not print it.
    Found(String),
}

impl Verdict {
    pub(super) fn name(&self) -> &'static str {
        match self {
            Self::Agrees(_) => "agrees",
            Self::Corrected(_) => "corrected",
            Self::Refuted(_) => "refuted",
            Self::Found(_) => "own finding",
        }
    }

    fn recomputed(&self) -> &str {
        match self {
            Self::Agrees(form)
            | Self::Corrected(form)
            | Self::Refuted(form)
            | Self::Found(form) => form,
        }
    }
}

/// A section of the table.
#[derive(Clone, Debug, Deserialize)]
struct Text {
    subject: String,
    #[serde(default)]
    printed: String,
    #[serde(flatten)]
    verdict: Verdict,
    tolerance: f64,
}

/// One equation, number or claim.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Row {
    /// Number of the equation as printed, or `example`, `claim`, `finding`.
    pub equation: String,
    pub subject: String,
    pub printed: String,
    pub recomputed: String,
    pub verdict: &'static str,
    /// Largest deviation of the recomputed form from its reference, over all cases.
    pub residual: f64,
    /// Largest deviation that rounding and statistics allow.
    pub tolerance: f64,
    /// Largest deviation of the printed form in the same measure, where it can be evaluated.
    pub printed_error: Option<f64>,
    pub cases: u64,
    /// Whether the residual is within the tolerance.
    pub holds: bool,
}

/// Evidence for one row.
#[derive(Clone, Debug, Default)]
struct Evidence {
    residual: f64,
    printed_error: Option<f64>,
    cases: u64,
    values: Vec<String>,
}

/// Larger of two deviations; NaN counts as the largest.
fn larger(largest: f64, deviation: f64) -> f64 {
    let deviation = deviation.abs();
    if deviation.is_nan() || deviation > largest {
        deviation
    } else {
        largest
    }
}

/// A computation that gives the evidence for one row or a few.
pub(super) type Check = fn(&mut Ledger) -> Result<(), Refusal>;

/// Evidence by the key of the row.
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

    /// Records a deviation from the reference.
    pub(super) fn deviation(&mut self, key: &'static str, deviation: f64) {
        let row = self.row(key);
        row.residual = larger(row.residual, deviation);
        row.cases += 1;
    }

    /// Compares a recomputed value with its reference.
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

    /// Records a condition, which fails the row where it does not hold.
    pub(super) fn require(&mut self, key: &'static str, holds: bool) {
        self.deviation(key, if holds { 0.0 } else { f64::INFINITY });
    }

    /// Compares the literal print with the reference.
    pub(super) fn print(&mut self, key: &'static str, printed: f64, reference: f64) {
        self.print_in(key, printed, reference, 1.0);
    }

    /// Compares the literal print with the reference, in multiples of `unit`.
    pub(super) fn print_in(&mut self, key: &'static str, printed: f64, reference: f64, unit: f64) {
        let row = self.row(key);
        let largest = row.printed_error.unwrap_or(0.0);
        row.printed_error = Some(larger(largest, (printed - reference) / unit));
    }

    /// Sets the numbers of the row's text, in the order of its placeholders.
    pub(super) fn fill(&mut self, key: &'static str, values: impl IntoIterator<Item = String>) {
        self.row(key).values = values.into_iter().collect();
    }

    /// Sets the number of cases, where one deviation sums up many.
    pub(super) fn count(&mut self, key: &'static str, cases: u64) {
        self.row(key).cases = cases;
    }

    /// The row of a section of the table, with its evidence; without evidence it does not hold.
    fn finish(&self, key: &str, text: Text) -> Row {
        let missing = Evidence {
            residual: f64::NAN,
            ..Evidence::default()
        };
        let evidence = self.evidence.get(key).unwrap_or(&missing);
        let filled = |text: &str| {
            (evidence.values.iter().zip(1..)).fold(text.to_string(), |text, (value, n)| {
                text.replace(&format!("{{{n}}}"), value)
            })
        };
        let residual = evidence.residual;
        let agrees = matches!(text.verdict, Verdict::Agrees(_));
        Row {
            equation: key.split(' ').next().unwrap_or(key).into(),
            printed: filled(&text.printed),
            recomputed: filled(text.verdict.recomputed()),
            verdict: text.verdict.name(),
            subject: text.subject,
            residual,
            tolerance: text.tolerance,
            // What agrees is recomputed in the printed form itself.
            printed_error: agrees.then_some(residual).or(evidence.printed_error),
            cases: evidence.cases,
            holds: residual <= text.tolerance,
        }
    }
}

/// Runs the checks on the desk's threads and fills the table, in the order of the page.
pub(super) fn recompute(checks: &[Check], error: f64, desk: &Desk) -> Result<Vec<Row>, Refusal> {
    let table: BTreeMap<String, Spanned<Text>> = toml::from_str(TABLE)
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
    if let Some(key) = all.evidence.keys().find(|key| !table.contains_key(**key)) {
        return Err(Refusal::new(
            format!("the table of the paper has no row '{key}'"),
            "report this",
        ));
    }
    let mut sections: Vec<_> = table.into_iter().collect();
    sections.sort_by_key(|(_, text)| text.span().start);
    Ok(sections
        .into_iter()
        .map(|(key, text)| all.finish(&key, text.into_inner()))
        .collect())
}

/// Cases that are the same in every run (the generator splitmix64).
pub(super) struct Cases(u64);

impl Cases {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// A number within `low..high`.
    pub(super) fn within(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        bits ^= bits >> 31;
        low + (high - low) * (bits >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Settings along the track.
    pub(super) fn settings(&mut self) -> TangentialSettings {
        TangentialSettings {
            restitution: self.within(0.0, 0.95),
            amplitude_ratio: self.within(0.2, 3.0),
            phase_lead: self.within(-3.0, 3.0),
            incline_tangent: self.within(-0.3, 0.3),
        }
    }

    /// A flight short enough to be compared with an integration of the equations of motion.
    pub(super) fn flight(&mut self) -> Result<Flight, OutOfRange> {
        let k = self.within(0.1, 1.5);
        let restitution = self.within(0.0, 1.0);
        let map = Map::build(k, restitution)?;
        let launch = Map::state(self.within(0.0, TAU), self.within(0.05, 3.0))?;
        Ok(Flight {
            k,
            restitution,
            launch,
            impact: map.impact(launch),
        })
    }
}

/// One flight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flight {
    pub k: f64,
    pub restitution: f64,
    pub launch: PartState,
    pub impact: Impact<PartState>,
}

impl Flight {
    /// Phase and velocity of the launch, and length of the flight.
    pub(super) fn parts(&self) -> (f64, f64, f64) {
        (self.launch.phase, self.launch.velocity, self.impact.flight)
    }
}

/// Mean and standard error of the mean.
pub(super) fn estimate(spread: &Spread) -> (f64, f64) {
    (
        spread.mean().unwrap_or(f64::NAN),
        spread.error().unwrap_or(f64::NAN),
    )
}
