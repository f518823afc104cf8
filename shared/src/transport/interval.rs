//! Times between impacts: their histogram and autocorrelation, a test of the renewal model
//! (equations 28 to 32).

use crate::impact::{Impact, Observer, PartState};

/// Observer of the times between impacts (symbol z, in rad): histogram and autocorrelation.
///
/// As in the paper, rests are no intervals between impacts; a lift-off begins a new sequence.
///
/// ```
/// use core::f64::consts::TAU;
/// use kband::impact::{Kernel, Map, Orbit};
/// use kband::transport::Intervals;
///
/// let map = Map::build(0.43, 0.2)?;
/// let mut orbit = Orbit::new(&map, Map::state(0.5, 0.45)?);
/// orbit.watch(200, &mut ());
/// let mut intervals = Intervals::<32, 4>::new(0.0, 2.0 * TAU, TAU);
/// orbit.watch(100, &mut intervals);
/// // A locked part strikes once a cycle: one interval, nothing to correlate.
/// assert!((intervals.mean().unwrap() - TAU).abs() < 1e-14);
/// assert!(intervals.deviation().unwrap() < 1e-14);
/// assert_eq!(intervals.autocorrelation(1), None);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intervals<const BINS: usize, const LAGS: usize> {
    low: f64,
    high: f64,
    centre: f64,
    bins: [u64; BINS],
    outside: u64,
    count: u64,
    longest: f64,
    sum: f64,
    squares: f64,
    /// The last `LAGS` intervals minus the centre, newest at `count - 1` modulo `LAGS`.
    recent: [f64; LAGS],
    /// Number of them in the present sequence.
    sequence_length: usize,
    products: [f64; LAGS],
    pairs: [u64; LAGS],
}

impl<const BINS: usize, const LAGS: usize> Intervals<BINS, LAGS> {
    /// Observer with a histogram of equal bins over `low..high` rad. `centre` is a rough mean of
    /// the intervals, subtracted against cancellation; 0 is allowed.
    pub fn new(low: f64, high: f64, centre: f64) -> Self {
        Self {
            low,
            high,
            centre,
            bins: [0; BINS],
            outside: 0,
            count: 0,
            longest: 0.0,
            sum: 0.0,
            squares: 0.0,
            recent: [0.0; LAGS],
            sequence_length: 0,
            products: [0.0; LAGS],
            pairs: [0; LAGS],
        }
    }

    /// Number of intervals.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Mean (symbol D) in rad.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.centre + self.sum / self.count as f64)
    }

    /// Standard deviation in rad.
    pub fn deviation(&self) -> Option<f64> {
        self.variance().map(libm::sqrt)
    }

    /// Longest interval in rad.
    pub fn longest(&self) -> f64 {
        self.longest
    }

    /// Number of intervals in each bin of `low..high`.
    pub fn bins(&self) -> &[u64; BINS] {
        &self.bins
    }

    /// Number of intervals outside `low..high`.
    pub fn outside(&self) -> u64 {
        self.outside
    }

    /// Autocorrelation at `lag` 1..=LAGS impacts, -1..1; `None` beyond, or for constant intervals
    /// (a locked part).
    ///
    /// A renewal process has independent intervals, with autocorrelation 0 at each lag.
    pub fn autocorrelation(&self, lag: usize) -> Option<f64> {
        let n = lag.checked_sub(1)?;
        let (products, pairs) = (*self.products.get(n)?, *self.pairs.get(n)?);
        let (mean, variance) = (self.mean()?, self.variance()?);
        // Below this bound the variance is the rounding of phases.
        if pairs == 0 || variance <= 1e-20 * mean * mean {
            return None;
        }
        let deviation = self.sum / self.count as f64;
        Some((products / pairs as f64 - deviation * deviation) / variance)
    }

    fn variance(&self) -> Option<f64> {
        let count = self.count as f64;
        let deviation = self.sum / count;
        (self.count > 0).then(|| (self.squares / count - deviation * deviation).max(0.0))
    }
}

impl<const BINS: usize, const LAGS: usize> Observer for Intervals<BINS, LAGS> {
    fn impact(&mut self, _: PartState, impact: &Impact<PartState>) {
        let z = impact.flight;
        let place = (z - self.low) / (self.high - self.low) * BINS as f64;
        match self.bins.get_mut(place as usize) {
            Some(bin) if place >= 0.0 => *bin += 1,
            _ => self.outside += 1,
        }
        self.longest = self.longest.max(z);
        let deviation = z - self.centre;
        self.sum += deviation;
        self.squares += deviation * deviation;
        if LAGS > 0 {
            let newest = self.count as usize;
            for lag in 1..=self.sequence_length.min(LAGS) {
                self.products[lag - 1] += deviation * self.recent[(newest + LAGS - lag) % LAGS];
                self.pairs[lag - 1] += 1;
            }
            self.recent[newest % LAGS] = deviation;
            self.sequence_length = (self.sequence_length + 1).min(LAGS);
        }
        self.count += 1;
    }

    fn lift_off(&mut self, _: f64, _: f64) {
        self.sequence_length = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{Kernel, Map};

    fn interval(flight: f64) -> Impact<PartState> {
        Impact {
            flight,
            next: Map::state(0.0, 0.0).unwrap(),
            grazes: false,
        }
    }

    #[test]
    fn interval_statistics_match_their_definitions() {
        let values = [1.0, 4.0, 2.0, 5.0, 3.0, 3.5, 0.5, 9.0];
        let mut intervals = Intervals::<4, 3>::new(0.0, 8.0, 3.0);
        let nowhere = Map::state(0.0, 0.0).unwrap();
        for value in values {
            intervals.impact(nowhere, &interval(value));
        }
        let mean = values.iter().sum::<f64>() / 8.0;
        let variance = values.iter().map(|z| (z - mean) * (z - mean)).sum::<f64>() / 8.0;
        assert!((intervals.mean().unwrap() - mean).abs() < 1e-14);
        assert!((intervals.deviation().unwrap() - libm::sqrt(variance)).abs() < 1e-14);
        assert_eq!((intervals.bins(), intervals.outside()), (&[2, 3, 2, 0], 1));
        for lag in 1..=3 {
            let pairs = values.iter().zip(&values[lag..]);
            let products =
                pairs.map(|(a, b)| (a - 3.0) * (b - 3.0)).sum::<f64>() / (8 - lag) as f64;
            let expected = (products - (mean - 3.0) * (mean - 3.0)) / variance;
            assert!((intervals.autocorrelation(lag).unwrap() - expected).abs() < 1e-14);
        }
        assert_eq!(
            (intervals.autocorrelation(0), intervals.autocorrelation(4)),
            (None, None)
        );
    }
}
