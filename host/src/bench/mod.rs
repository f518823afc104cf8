//! Benchmark: run time against error of every arithmetic of the impact map.
//!
//! All kernels are measured in one run, turn by turn, so a busy machine slows them alike. The
//! medians of the turns are compared. Errors are against the f64 impact of the state as the kernel
//! represents it.

pub mod bracket;
pub mod chains;
pub mod classes;
pub mod contest;
pub mod instructions;
pub mod scaling;
pub mod scene;
pub mod skips;
pub mod textbook;
pub mod verbs;
pub mod waves;
pub mod workload;

/// A flight of a baseline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flight {
    /// Duration in rad.
    pub duration: f64,
    /// Phase of the impact, 0..2 pi.
    pub phase: f64,
    /// Speed of arrival in units of `b w`.
    pub arrival: f64,
}

/// The measurement of one kernel on one workload.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// Name of the kernel.
    pub kernel: &'static str,
    /// Name of the workload.
    pub workload: &'static str,
    /// Run time of one impact in ns, median of the turns.
    pub nanoseconds: f64,
    /// Errors of the phase in rad, if judged.
    pub errors: Option<Errors>,
}

/// Errors of the phase of the next impact in rad, over the impacts with the right root.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Median.
    pub median: f64,
    /// 99th percentile.
    pub p99: f64,
    /// The largest.
    pub largest: f64,
    /// Number of impacts at another root.
    pub wrong_roots: u64,
}

impl Errors {
    /// The errors of the given impacts, and the number of those at another root.
    #[must_use]
    pub fn of(mut errors: Vec<f64>, wrong_roots: u64) -> Self {
        errors.sort_by(f64::total_cmp);
        let part = |share: f64| {
            let last = errors.len().saturating_sub(1) as f64;
            errors
                .get((share * last).round() as usize)
                .copied()
                .unwrap_or(f64::NAN)
        };
        Self {
            median: part(0.5),
            p99: part(0.99),
            largest: part(1.0),
            wrong_roots,
        }
    }
}

/// Median of some measurements.
#[must_use]
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
