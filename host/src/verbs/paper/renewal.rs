//! Equations (28) to (32): impacts as a renewal process, and what they are.

use kband::impact::{Count, Impact, Kernel, Map, Observer, Orbit, State};
use kband::transport::{Intervals, Spread};

use super::row::{Row, Work, Worst};
use crate::refusal::Refusal;
use crate::report::number;

pub(super) const ROWS: &[Work] = &[renewal];

/// Times of impacts, as counts in windows of equal length.
struct Windows {
    length: f64,
    time: f64,
    impacts: u64,
    counts: Vec<f64>,
}

impl Observer for Windows {
    fn impact(&mut self, _: State, impact: &Impact<State>) {
        self.time += impact.flight;
        while self.time >= self.length {
            self.time -= self.length;
            self.counts.push(self.impacts as f64);
            self.impacts = 0;
        }
        self.impacts += 1;
    }
}

/// (28) to (32): the renewal picture at k = 0.05, R = 0.9.
fn renewal() -> Result<Vec<Row>, Refusal> {
    let (k, restitution, runs, impacts) = (0.05, 0.9, 24, 5000_u64);
    let map = Map::build(k, restitution)?;
    let (mut normal, mut mean, mut lag, mut rate, mut dispersion) = (
        Worst::default(),
        Worst::default(),
        Spread::default(),
        Worst::default(),
        Spread::default(),
    );
    for run in 0..runs {
        let start = Map::state(0.2 * f64::from(run), 4.0 + 0.3 * f64::from(run))?;
        let mut orbit = Orbit::new(&map, start);
        orbit.watch(300, &mut ());
        let mut seen = Intervals::<200, 1>::new(0.0, 1000.0, 150.0);
        let mut windows = Windows {
            length: 3000.0,
            time: 0.0,
            impacts: 0,
            counts: Vec::new(),
        };
        let mut count = Count::default();
        orbit.watch(impacts, &mut (&mut seen, &mut windows, &mut count));
        let total = seen.count() as f64;
        let inside: u64 = seen.bins().iter().sum();
        normal.see((inside + seen.outside()) as f64 / total - 1.0);
        // D from the distribution alone, against the plain mean: half a bin at most.
        let width = 5.0;
        let from_bins: f64 = seen
            .bins()
            .iter()
            .enumerate()
            .map(|(n, bin)| (n as f64 + 0.5) * width * *bin as f64)
            .sum::<f64>()
            / inside as f64;
        let plain = seen.mean().unwrap_or(f64::NAN);
        mean.see((from_bins - plain) / (0.5 * width));
        lag.add(seen.autocorrelation(1).unwrap_or(f64::NAN));
        let counted = Spread::of(windows.counts.iter().copied());
        let expected = windows.length / plain;
        let (counts, error) = (
            counted.mean().unwrap_or(f64::NAN),
            counted.error().unwrap_or(f64::NAN),
        );
        // The windows leave out the last, incomplete one.
        rate.see((counts - expected) / (6.0 * error));
        let variance = error * error * counted.count() as f64;
        let deviation = seen.deviation().unwrap_or(f64::NAN);
        let independent = deviation * deviation * windows.length / plain.powi(3);
        dispersion.add(variance / independent);
    }
    let (rho, rho_error) = (
        lag.mean().unwrap_or(f64::NAN),
        lag.error().unwrap_or(f64::NAN),
    );
    let (ratio, ratio_error) = (
        dispersion.mean().unwrap_or(f64::NAN),
        dispersion.error().unwrap_or(f64::NAN),
    );
    let cases = u64::from(runs as u32) * impacts;
    let picture = "renewal picture";
    Ok(vec![
        Row::new(280, "(28)", "distribution F(z) of the intervals")
            .agrees(picture, "measured as a histogram; it sums to one")
            .within(Worst::of(normal.value, cases), 1e-12),
        Row::new(290, "(29)", "mean interval D")
            .agrees(
                picture,
                "D = ∫ z dF(z), within half a bin of the plain mean",
            )
            .within(Worst::of(mean.value, cases), 1.0),
        Row::new(300, "(30)", "independence of the intervals")
            .refuted(
                "intervals are independent",
                format!(
                    "they are not: lag-1 autocorrelation {} ± {} at k = 0.05, R = 0.9",
                    number(rho, 3),
                    number(rho_error, 1)
                ),
            )
            // The claim of a correlation has to stand by itself: 10 standard errors off zero.
            .within(Worst::of(10.0 * rho_error / rho.abs(), cases), 1.0),
        Row::new(310, "(31)", "number of impacts in a time")
            .agrees(
                picture,
                "N(T)/T → 1/D, which needs no independence (in units of 6 standard errors)",
            )
            .within(Worst::of(rate.value, cases), 1.0),
        Row::new(320, "(32)", "scatter of that number")
            .refuted(
                picture,
                format!(
                    "{} ± {} times what independent intervals would give",
                    number(ratio, 3),
                    number(ratio_error, 1)
                ),
            )
            // The claim has to stand by itself: 6 standard errors off one.
            .within(
                Worst::of(6.0 * ratio_error / (ratio - 1.0).abs(), cases),
                1.0,
            ),
    ])
}
