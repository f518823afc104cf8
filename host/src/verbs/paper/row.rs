//! A row of the comparison, and what the recomputations share.

use kband::feeder::OutOfRange;
use kband::impact::{Impact, Kernel, Map, PartState};

use crate::refusal::Refusal;

/// What became of a printed statement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It holds as printed.
    Agrees,
    /// It holds once corrected.
    Corrected,
    /// It does not hold.
    Refuted,
    /// The paper does not print it: found here.
    Found,
}

impl Verdict {
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::Agrees => "agrees",
            Self::Corrected => "corrected",
            Self::Refuted => "refuted",
            Self::Found => "own finding",
        }
    }
}

/// One equation, number or claim.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Row {
    /// Order on the page.
    pub place: u32,
    /// Number of the equation as printed, or `example`, `claim`, `finding`.
    pub equation: &'static str,
    pub subject: &'static str,
    /// What the paper prints.
    pub printed: String,
    /// What holds.
    pub recomputed: String,
    pub verdict: Verdict,
    /// Largest deviation of what holds from its reference, over all cases.
    pub residual: f64,
    /// Largest deviation that rounding and statistics allow.
    pub tolerance: f64,
    /// Largest deviation of the printed form in the same measure, where it can be evaluated.
    pub printed_error: Option<f64>,
    pub cases: u64,
}

impl Row {
    /// Which row it is, in a message.
    pub(super) fn name(&self) -> String {
        format!("{} {}", self.equation, self.subject)
    }

    /// A row of which no more is known than where it stands.
    pub(super) fn new(place: u32, equation: &'static str, subject: &'static str) -> Self {
        Self {
            place,
            equation,
            subject,
            printed: String::new(),
            recomputed: String::new(),
            verdict: Verdict::Found,
            residual: f64::NAN,
            tolerance: 0.0,
            printed_error: None,
            cases: 0,
        }
    }

    fn judged(self, verdict: Verdict, printed: String, recomputed: String) -> Self {
        Self {
            verdict,
            printed,
            recomputed,
            ..self
        }
    }

    /// What the paper prints holds.
    pub(super) fn agrees(self, printed: impl Into<String>, recomputed: impl Into<String>) -> Self {
        self.judged(Verdict::Agrees, printed.into(), recomputed.into())
    }

    /// What the paper prints, and what holds instead.
    pub(super) fn corrected(
        self,
        printed: impl Into<String>,
        recomputed: impl Into<String>,
    ) -> Self {
        self.judged(Verdict::Corrected, printed.into(), recomputed.into())
    }

    /// What the paper claims, and what is the case.
    pub(super) fn refuted(self, printed: impl Into<String>, recomputed: impl Into<String>) -> Self {
        self.judged(Verdict::Refuted, printed.into(), recomputed.into())
    }

    /// What holds and is not in the paper.
    pub(super) fn found(self, recomputed: impl Into<String>) -> Self {
        self.judged(Verdict::Found, String::new(), recomputed.into())
    }

    /// How far what holds is off its reference, and may be.
    pub(super) fn within(self, worst: Worst, tolerance: f64) -> Self {
        Self {
            residual: worst.value,
            cases: worst.cases,
            tolerance,
            // What agrees is recomputed in the printed form itself.
            printed_error: (self.verdict == Verdict::Agrees).then_some(worst.value),
            ..self
        }
    }

    /// How far the printed form is off, in the same measure.
    pub(super) fn off(self, printed_error: f64) -> Self {
        Self {
            printed_error: Some(printed_error),
            ..self
        }
    }

    /// Whether the recomputation agrees with its own reference.
    pub(super) fn holds(&self) -> bool {
        self.residual <= self.tolerance
    }
}

/// One piece of work that fills one row or a few.
pub(super) type Work = fn() -> Result<Vec<Row>, Refusal>;

/// Largest deviation over cases.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Worst {
    pub value: f64,
    pub cases: u64,
}

impl Worst {
    /// A deviation that is known of so many cases.
    pub(super) fn of(value: f64, cases: u64) -> Self {
        Self { value, cases }
    }

    /// Takes one more deviation; NaN stays.
    pub(super) fn see(&mut self, deviation: f64) {
        let deviation = deviation.abs();
        if deviation.is_nan() || deviation > self.value {
            self.value = deviation;
        }
        self.cases += 1;
    }
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

    /// A flight of a part: k, restitution, launch, impact. Of moderate length, so that an integration
    /// of the equations of motion can be compared with it.
    pub(super) fn flight(&mut self) -> Result<Flight, OutOfRange> {
        let k = self.within(0.1, 1.5);
        let restitution = self.within(0.0, 1.0);
        let map = Map::build(k, restitution)?;
        let launch = Map::state(
            self.within(0.0, std::f64::consts::TAU),
            self.within(0.05, 3.0),
        )?;
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

/// Way and velocity after `d` of a point that starts at 0 with `velocity` and is accelerated by
/// `acceleration(tau)` from phase `t` on, by the classical Runge-Kutta rule in 4000 steps. Its error is of
/// order `d^2 (d/4000)^4`, below 1e-10 for d < 40.
pub(super) fn integrated(
    t: f64,
    d: f64,
    velocity: f64,
    acceleration: impl Fn(f64) -> f64,
) -> (f64, f64) {
    const STEPS: u32 = 4000;
    let h = d / f64::from(STEPS);
    let (mut way, mut speed) = (0.0, velocity);
    for n in 0..STEPS {
        let tau = t + f64::from(n) * h;
        let (early, middle, late) = (
            acceleration(tau),
            acceleration(tau + 0.5 * h),
            acceleration(tau + h),
        );
        way += h * (speed + h * (early + 2.0 * middle) / 6.0);
        speed += h * (early + 4.0 * middle + late) / 6.0;
    }
    (way, speed)
}
