//! Equations (30) to (33): impacts as a renewal process, and their real correlation.

use kband::impact::{Impact, Kernel, Map, Observer, Orbit, PartState};
use kband::transport::{Intervals, Spread};

use super::engine::{Cases, Check, Ledger, estimate};
use crate::refusal::Refusal;
use crate::report::number;

pub(super) const CHECKS: &[Check] = &[correlated, independent];

/// Number of impacts in each of successive windows of time.
struct Windows {
    length: f64,
    time: f64,
    impacts: u64,
    counts: Vec<f64>,
}

impl Observer for Windows {
    fn impact(&mut self, _: PartState, impact: &Impact<PartState>) {
        self.time += impact.flight;
        while self.time >= self.length {
            self.time -= self.length;
            self.counts.push(self.impacts as f64);
            self.impacts = 0;
        }
        self.impacts += 1;
    }
}

/// Sum of cos over the impacts.
#[derive(Default)]
struct Cosine(f64);

impl Observer for Cosine {
    fn impact(&mut self, launch: PartState, _: &Impact<PartState>) {
        self.0 += launch.phase.cos();
    }
}

/// A probability law of two intervals, and the process of independent draws from it.
struct TwoIntervals {
    lengths: [f64; 2],
    chance: f64,
}

impl TwoIntervals {
    /// Mean interval (symbol Delta), by (30).
    fn mean(&self) -> f64 {
        self.chance * self.lengths[0] + (1.0 - self.chance) * self.lengths[1]
    }

    /// `<delta(tau_l)>` by the characteristic function, `Re chi^l (chi - 1)`: the convolutions of
    /// (32).
    fn delta(&self, l: u32) -> f64 {
        let part = |of: fn(f64) -> f64| {
            self.chance * of(self.lengths[0]) + (1.0 - self.chance) * of(self.lengths[1])
        };
        let (re, im) = (part(f64::cos), part(f64::sin));
        let power = |n: u32| re.hypot(im).powi(n as i32) * (f64::from(n) * im.atan2(re)).cos();
        power(l + 1) - power(l)
    }

    /// Visits every sequence of `n` intervals, with its probability.
    fn visit_sequences(&self, n: usize, mut visit: impl FnMut(f64, &[f64])) {
        let mut intervals = vec![0.0; n];
        for bits in 0_u32..1 << n {
            let mut weight = 1.0;
            for (l, interval) in intervals.iter_mut().enumerate() {
                let second = bits >> l & 1 == 1;
                *interval = self.lengths[usize::from(second)];
                weight *= if second {
                    1.0 - self.chance
                } else {
                    self.chance
                };
            }
            visit(weight, &intervals);
        }
    }
}

/// (31) to (33), which assume independent intervals: (9) and (10) over every sequence of two
/// intervals.
fn independent(rows: &mut Ledger) -> Result<(), Refusal> {
    const N: usize = 9;
    let mut cases = Cases::new(15);
    for _ in 0..60 {
        let law = TwoIntervals {
            lengths: [cases.within(0.5, 8.0), cases.within(0.5, 8.0)],
            chance: cases.within(0.1, 0.9),
        };
        let k = cases.within(0.05, 0.6);
        let (r, rt) = (cases.within(0.2, 0.9), cases.within(0.2, 0.9));
        let (eta, tangent) = (cases.within(0.2, 3.0), cases.within(-0.3, 0.3));
        let interval = law.mean();
        // Begun at their stationary parts, (31) holds for every n and not only for large ones.
        let settled_along = -k * tangent * rt * interval / (1.0 - rt);
        let settled_normal = k * r * interval / (1.0 + r);
        let (mut phi_mean, mut psi_mean, mut w_mean) = (0.0, 0.0, 0.0);
        let mut deltas = [0.0; N];
        law.visit_sequences(N + 1, |weight, intervals| {
            let (mut phi, mut psi, mut clock) = (settled_along, settled_normal, 0.0_f64);
            for (sum, &d) in deltas.iter_mut().zip(intervals) {
                let delta = (clock + d).cos() - clock.cos();
                *sum += weight * delta;
                phi = rt * (phi - eta * delta - k * tangent * d);
                psi = r * (k * d + delta - psi);
                clock += d;
            }
            phi_mean += weight * phi;
            psi_mean += weight * psi;
            w_mean += weight * (phi - eta * psi + intervals[N] * 0.5 * k * (eta - tangent));
        });
        for (delta, l) in deltas.into_iter().zip(0..) {
            rows.compare("(32)", law.delta(l), delta);
        }
        let sum = |base: f64| -> f64 {
            (0..N as u32)
                .map(|l| base.powi(N as i32 - l as i32) * law.delta(l))
                .sum()
        };
        rows.compare("(31a)", settled_along - eta * sum(rt), phi_mean);
        rows.compare("(31b)", settled_normal - sum(-r), psi_mean);
        rows.print("(31b)", settled_normal + sum(-r), psi_mean);
        let drive = eta * (1.0 - r) / (1.0 + r) - tangent * (1.0 + rt) / (1.0 - rt);
        let mean = 0.5 * k * interval * drive - eta * (sum(rt) - sum(-r));
        rows.compare("(33)", mean, w_mean);
    }
    Ok(())
}

/// (30), and the correlation of the flights at k = 0.05, R = 0.9.
fn correlated(rows: &mut Ledger) -> Result<(), Refusal> {
    const RUNS: u32 = 24;
    const IMPACTS: u64 = 5000;
    const BINS: usize = 200;
    const LONGEST: f64 = 1000.0;
    const WINDOW: f64 = 3000.0;
    let map = Map::build(0.05, 0.9)?;
    let (mut lag, mut variances, mut cosines) =
        (Spread::default(), Spread::default(), Spread::default());
    for run in 0..RUNS {
        let run = f64::from(run);
        let mut orbit = Orbit::new(&map, Map::state(0.2 * run, 4.0 + 0.3 * run)?);
        orbit.watch(300, &mut ());
        let mut seen = Intervals::<BINS, 1>::new(0.0, LONGEST, 150.0);
        let mut windows = Windows {
            length: WINDOW,
            time: 0.0,
            impacts: 0,
            counts: Vec::new(),
        };
        let mut cosine = Cosine::default();
        orbit.watch(IMPACTS, &mut (&mut seen, &mut windows, &mut cosine));
        cosines.add(cosine.0 / seen.count() as f64);
        lag.add(seen.autocorrelation(1).unwrap_or(f64::NAN));
        // The mean of the distribution alone, against the plain mean: half a bin at most.
        let width = LONGEST / BINS as f64;
        let weighted =
            (seen.bins().iter().enumerate()).map(|(n, bin)| (n as f64 + 0.5) * width * *bin as f64);
        let from_bins = weighted.sum::<f64>() / seen.bins().iter().sum::<u64>() as f64;
        let plain = seen.mean().unwrap_or(f64::NAN);
        rows.compare_in("(30)", from_bins, plain, 0.5 * width);
        let counted = Spread::of(windows.counts.iter().copied());
        let (counts, error) = estimate(&counted);
        rows.compare_in("finding count", counts, WINDOW / plain, 6.0 * error);
        let variance = error * error * counted.count() as f64;
        let deviation = seen.deviation().unwrap_or(f64::NAN);
        variances.add(variance / (deviation * deviation * WINDOW / plain.powi(3)));
    }
    // Phase-synchronised chaos, where the mean cosine is larger still.
    let narrow = Map::build(0.34, 0.2)?;
    let mut orbit = Orbit::new(&narrow, Map::state(0.9, 0.36)?);
    orbit.watch(1000, &mut ());
    let mut cosine = Cosine::default();
    orbit.watch(20_000, &mut cosine);
    let narrow = cosine.0 / 20_000.0;
    // Reference: long runs, rounded.
    let (cos, cos_error) = estimate(&cosines);
    rows.compare_in("finding cosine", cos, 0.197, 5e-4 + 6.0 * cos_error);
    rows.compare_in("finding cosine", narrow, 0.681, 5e-3);
    let shown = [number(cos, 3), number(cos_error, 1), number(narrow, 3)];
    rows.fill("finding cosine", shown);
    // A correlation is claimed at 10 standard errors off zero.
    let (rho, rho_error) = estimate(&lag);
    rows.deviation("finding correlation", 10.0 * rho_error / rho.abs());
    rows.fill(
        "finding correlation",
        [number(rho, 3), number(rho_error, 1)],
    );
    // A variance unlike that of independent intervals is claimed at 6 standard errors off one.
    let (ratio, ratio_error) = estimate(&variances);
    rows.deviation("finding variance", 6.0 * ratio_error / (ratio - 1.0).abs());
    rows.fill(
        "finding variance",
        [number(ratio, 3), number(ratio_error, 1)],
    );
    let impacts = u64::from(RUNS) * IMPACTS;
    for key in [
        "(30)",
        "finding correlation",
        "finding count",
        "finding variance",
    ] {
        rows.count(key, impacts);
    }
    rows.count("finding cosine", impacts + 20_000);
    Ok(())
}
