//! The times between impacts at one k: F(z), mean, autocorrelation.

use kband::impact::{Kernel, Map, Tangential};
use kband::transport::{Intervals, Motion, Origin, SampleMean, measure};
use serde_json::json;

use super::{Arguments, Computed, Feeder, effort, starts};
use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::Refusal;
use crate::report::{Printout, fields, number};

const BINS: usize = 120;
const LAGS: usize = 24;

type Seen = Intervals<BINS, LAGS>;

struct Found {
    k: f64,
    starts: usize,
    impacts: u64,
    longest: f64,
    mean: SampleMean,
    deviation: SampleMean,
    bins: Vec<u64>,
    correlation: Vec<SampleMean>,
}

pub(super) fn computed(
    feeder: Feeder,
    arguments: &Arguments,
    desk: &Desk,
) -> Result<Computed, Refusal> {
    let k = feeder.single_k(arguments)?;
    let found = found(&feeder, k, arguments, desk)?;
    let report = report(&feeder, &found)?;
    Ok((report, Box::new(move || picture(&feeder, &found))))
}

fn found(feeder: &Feeder, k: f64, arguments: &Arguments, desk: &Desk) -> Result<Found, Refusal> {
    let map = Map::build(k, feeder.restitution)?;
    let tangential = Tangential::build(k, feeder.settings)?;
    // More starts than for a speed: each gives one independent value of every correlation.
    let starts = starts(k, feeder, arguments.starts.unwrap_or(24));
    let watch = |start: Origin, seen: &mut Seen| {
        measure(start.orbit(&map), tangential, effort(arguments), seen).motion == Motion::Hopping
            && seen.count() > LAGS as u64
    };
    // The longest interval sets the scale of the histogram; the second pass sees the same orbits.
    let first = desk.map("intervals", starts.len(), |n| {
        let mut seen = Seen::new(0.0, 1.0, 0.0);
        watch(starts[n], &mut seen).then_some((seen.longest(), seen.mean().unwrap_or(0.0)))
    })?;
    let longest = first
        .iter()
        .flatten()
        .map(|found| found.0)
        .fold(0.0, f64::max);
    let kept: Vec<(Origin, f64)> = starts
        .iter()
        .zip(&first)
        .filter_map(|(start, found)| found.map(|found| (*start, found.1)))
        .collect();
    if kept.is_empty() {
        return Err(Refusal::new(
            format!(
                "at k = {} and R = {} no start goes on hopping: all come to rest every few cycles",
                number(k, 6),
                number(feeder.restitution, 6)
            ),
            "take a smaller k (more amplitude) or a livelier part",
        ));
    }
    let seen = desk.map("intervals", kept.len(), |n| {
        let (start, centre) = kept[n];
        let mut seen = Seen::new(0.0, longest * (1.0 + 1e-9), centre);
        watch(start, &mut seen);
        seen
    })?;
    let mut bins = vec![0; BINS];
    for one in &seen {
        for (sum, bin) in bins.iter_mut().zip(one.bins()) {
            *sum += bin;
        }
    }
    Ok(Found {
        k,
        starts: kept.len(),
        impacts: seen.iter().map(Seen::count).sum(),
        longest,
        mean: SampleMean::from_values(seen.iter().filter_map(Seen::mean)),
        deviation: SampleMean::from_values(seen.iter().filter_map(Seen::deviation)),
        bins,
        correlation: (1..=LAGS)
            .map(|lag| {
                SampleMean::from_values(seen.iter().filter_map(|one| one.autocorrelation(lag)))
            })
            .collect(),
    })
}

impl Found {
    fn width(&self) -> f64 {
        self.longest / BINS as f64
    }

    /// Density F(z) in 1/rad of each bin, as (low, high, density).
    fn density(&self) -> Vec<(f64, f64, f64)> {
        let total = self.impacts.max(1) as f64;
        self.bins
            .iter()
            .enumerate()
            .map(|(n, bin)| {
                let low = n as f64 * self.width();
                (low, low + self.width(), *bin as f64 / total / self.width())
            })
            .collect()
    }

    /// The verdict on the renewal picture.
    fn verdict(&self) -> String {
        let farthest = self
            .correlation
            .iter()
            .enumerate()
            .filter_map(|(n, spread)| Some((n + 1, spread.mean()?, spread.error()?)))
            .map(|(lag, mean, error)| (lag, mean, error, mean.abs() / error.max(1e-12)))
            .max_by(|a, b| a.3.total_cmp(&b.3));
        match farthest {
            None => "every interval is alike: the parts are locked, there is nothing to correlate"
                .into(),
            Some((lag, mean, error, far)) if far > 5.0 => format!(
                "not a renewal process: the intervals are correlated, {mean:.3} ± {error:.3} at lag {lag}"
            ),
            Some((lag, mean, error, _)) => format!(
                "no correlation found (largest: {mean:.3} ± {error:.3} at lag {lag}): a renewal process as \
                 far as this run can tell"
            ),
        }
    }
}

fields! {
    /// The autocorrelation of the intervals at each lag.
    fn correlations(row: (usize, SampleMean)) {
        all LAG => row.0;
        all AUTOCORRELATION.digits(4) => row.1.mean();
        all AUTOCORRELATION_ERROR.titled("error").digits(2) => row.1.error();
    }
}

fn report(feeder: &Feeder, found: &Found) -> Result<Printout, Refusal> {
    let cycles = |rad: Option<f64>| rad.map(|rad| rad / std::f64::consts::TAU);
    let histogram: Vec<_> = found
        .density()
        .into_iter()
        .zip(&found.bins)
        .map(|((low, high, density), count)| {
            json!({ "interval_low": low, "interval_high": high, "count": count, "density": density })
        })
        .collect();
    let view = correlations();
    let rows: Vec<(usize, SampleMean)> = (1..).zip(found.correlation.iter().copied()).collect();
    let lags: Vec<_> = rows.iter().map(|row| view.object(row)).collect();
    view.printout(&rows)
        .heading(format!(
            "Times between impacts at k = {}, R = {}: {} impacts from {} starts",
            number(found.k, 6),
            number(feeder.restitution, 6),
            found.impacts,
            found.starts
        ))
        .note(format!(
            "mean interval D = {} ± {} drive cycles, standard deviation {} cycles",
            number(cycles(found.mean.mean()).unwrap_or(f64::NAN), 6),
            number(cycles(found.mean.error()).unwrap_or(0.0), 2),
            number(cycles(found.deviation.mean()).unwrap_or(f64::NAN), 4)
        ))
        .note(found.verdict())
        .json(&json!({
            "k": found.k,
            "restitution": feeder.restitution,
            "impacts": found.impacts,
            "starts": found.starts,
            "mean_interval": found.mean.mean(),
            "mean_interval_error": found.mean.error(),
            "interval_deviation": found.deviation.mean(),
            "histogram": histogram,
            "lags": lags,
            "verdict": found.verdict(),
        }))
}

fn picture(feeder: &Feeder, found: &Found) -> Picture {
    let density = found.density();
    let tallest = density.iter().map(|bar| bar.2).fold(0.0, f64::max);
    let mut histogram = Panel::new(
        Axis::new("time between impacts z", "rad", 0.0, found.longest),
        Axis::new("F(z)", "1/rad", 0.0, 1.1 * tallest),
    )
    .height(260.0)
    .heading("Distribution of the times between impacts")
    .bars("", 0, density);
    if let Some(mean) = found.mean.mean() {
        histogram = histogram.mark(mean, "mean D");
    }
    let lag = |n: usize| (n + 1) as f64;
    let points = |of: &dyn Fn(&SampleMean) -> Option<f64>| -> Vec<(f64, f64)> {
        found
            .correlation
            .iter()
            .enumerate()
            .map(|(n, spread)| (lag(n), of(spread).unwrap_or(f64::NAN)))
            .collect()
    };
    let noise: Vec<(f64, f64, f64)> = found
        .correlation
        .iter()
        .enumerate()
        .filter_map(|(n, spread)| Some((lag(n), -2.0 * spread.error()?, 2.0 * spread.error()?)))
        .collect();
    let correlation = Panel::new(
        Axis::new("lag", "impacts", 0.0, LAGS as f64 + 1.0),
        Axis::new("autocorrelation", "", -1.0, 1.0),
    )
    .height(220.0)
    .heading("Are the intervals independent?")
    .between("two standard errors around 0 (independent)", 1, noise)
    .level(0.0, "")
    .line("", 0, points(&|spread| spread.mean()))
    .markers("autocorrelation", 0, points(&|spread| spread.mean()));
    Picture::new("The renewal picture, measured")
        .caption(format!(
            "k = {}, R = {}, {} impacts from {} starts: {}",
            number(found.k, 6),
            number(feeder.restitution, 6),
            found.impacts,
            found.starts,
            found.verdict()
        ))
        .panel(histogram)
        .panel(correlation)
}
