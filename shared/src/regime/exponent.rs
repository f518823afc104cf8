//! Largest Lyapunov exponent by propagating a tangent vector, normalized at each impact (Benettin,
//! Galgani, Giorgilli and Strelcyn, Meccanica 15 (1980) 9).
//!
//! Its standard error is estimated from batch means and their autocorrelation time.

use core::f64::consts::TAU;

use heapless::Vec;

use super::cascade::Estimate;
use super::lock::Lock;
use crate::feeder::{OutOfRange, accept_in};
use crate::impact::batch::Block;
use crate::impact::{Impact, Kernel, Map, Orbit, OrbitEvent, PartState, Scatter, Tangent};

/// Largest number of batches for the standard error and the autocorrelation time.
const MAX_BATCHES: usize = 512;

/// Smallest number of batches, of 16 impacts each.
const MIN_BATCHES: u32 = 20;

/// Length of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExponentSettings {
    /// Impacts discarded at the start.
    pub settle: u32,
    /// Impacts measured, 320..=1e9.
    pub impacts: u32,
}

/// Type of an orbit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Dynamics {
    /// Periodic: the exponent is negative by more than three standard errors.
    Regular,
    /// Chaotic: the exponent is positive by more than three standard errors, without a rest.
    Chaotic,
    /// The exponent is within three standard errors of 0.
    Undecided,
    /// The part came to rest, so any chaos before was transient: after a rest each orbit is the
    /// same.
    Rest {
        /// Impacts before the rest, discarded ones included.
        after: u32,
    },
}

impl Dynamics {
    /// Type of an orbit without rest, from its exponent per impact.
    pub fn from_exponent(per_impact: Estimate) -> Self {
        let Estimate { value, error } = per_impact;
        if value > 3.0 * error {
            Self::Chaotic
        } else if value < -3.0 * error {
            Self::Regular
        } else {
            Self::Undecided
        }
    }
}

/// Largest Lyapunov exponent of one orbit; of the flights before the rest if it came to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exponent {
    /// Exponent per impact, with its standard error.
    pub per_impact: Estimate,
    /// Exponent per drive cycle, with its standard error.
    pub per_cycle: Estimate,
    /// Mean flight in drive cycles.
    pub flight: f64,
    /// Type of the orbit.
    pub dynamics: Dynamics,
}

/// Measures the largest Lyapunov exponent of the orbit of `map` from `start`.
pub fn measure(
    map: &Map,
    start: PartState,
    settings: ExponentSettings,
) -> Result<Exponent, OutOfRange> {
    let start = Map::state(start.phase, start.velocity)?;
    measure_along(map, Orbit::new(map, start), settings)
}

/// [`measure`] for a part with random restitution drawn by `scatter`. It is the divergence of two
/// parts with the same draws.
pub fn measure_scattered(
    map: &Map,
    start: PartState,
    settings: ExponentSettings,
    scatter: Scatter,
) -> Result<Exponent, OutOfRange> {
    let start = Map::state(start.phase, start.velocity)?;
    measure_along(map, Orbit::new(map, start).scattering(scatter)?, settings)
}

/// [`measure`] along several orbits of one map side by side, which takes less time and gives the
/// same bits; `None` if one of them comes to rest.
pub fn measure_together<const N: usize>(
    map: &Map,
    starts: [PartState; N],
    settings: ExponentSettings,
) -> Result<Option<[Exponent; N]>, OutOfRange> {
    let measurement = Measurement::build(settings)?;
    let mut block = Block::new();
    let mut states = starts;
    for (lane, state) in states.iter_mut().enumerate() {
        *state = Map::state(state.phase, state.velocity)?;
        block.put(lane, map, *state)?;
    }
    let mut measured: [Measurement; N] = core::array::from_fn(|_| measurement.clone());
    for _ in 0..measurement.impacts() {
        block.advance(1);
        for (lane, (state, one)) in states.iter_mut().zip(&mut measured).enumerate() {
            let flown = block.impact(lane).filter(|impact| impact.flight > 0.0);
            let (Some(impact), false) = (flown, block.rests(lane)) else {
                return Ok(None);
            };
            one.add(map, *state, &impact, 1.0);
            *state = impact.next;
        }
    }
    Ok(Some(measured.map(|one| one.exponent(None))))
}

fn measure_along(
    map: &Map,
    mut orbit: Orbit<'_>,
    settings: ExponentSettings,
) -> Result<Exponent, OutOfRange> {
    let mut measurement = Measurement::build(settings)?;
    let mut rest = None;
    while measurement.count < measurement.impacts() {
        let before = orbit.state();
        match orbit.next() {
            Some(OrbitEvent::Impact(impact)) => {
                measurement.add(map, before, &impact, orbit.drawn);
            }
            // A start at rest begins with a lift-off; a later rest ends the orbit.
            Some(OrbitEvent::LiftOff { .. }) if measurement.count == 0 => {}
            Some(OrbitEvent::LiftOff { .. } | OrbitEvent::Rest { .. }) | None => {
                rest = Some(measurement.count);
                break;
            }
        }
    }
    Ok(measurement.exponent(rest))
}

/// A start near the locked orbit of `order` if it exists, else at lift-off. It leads to the cascade
/// and its chaos; a start from rest rarely does.
pub fn start_near_lock(map: &Map, order: u32) -> PartState {
    match Lock::build(map.k(), map.restitution(), order) {
        Ok(Some(lock)) => PartState::new(lock.state().phase + 1e-3, lock.state().velocity),
        _ => PartState::new(libm::asin(map.k().min(1.0)), 0.0),
    }
}

#[derive(Clone)]
struct Measurement {
    settle: u32,
    /// Impacts of a batch, and number of batches of the whole measurement.
    batch: u32,
    requested: u32,
    vector: TangentVector,
    count: u32,
    current: Batch,
    batches: Vec<Batch, MAX_BATCHES>,
}

impl Measurement {
    fn build(settings: ExponentSettings) -> Result<Self, OutOfRange> {
        let range = f64::from(16 * MIN_BATCHES)..=1e9;
        accept_in("impacts", settings.impacts.into(), range, "320..1000000000")?;
        // A power of two, so that each batch visits the chaotic bands of the cascade equally often.
        let batch = (settings.impacts / MAX_BATCHES as u32)
            .next_power_of_two()
            .max(16);
        Ok(Self {
            settle: settings.settle,
            batch,
            requested: settings.impacts / batch,
            vector: TangentVector {
                vector: [1.0, 0.0],
                growth: 0.0,
            },
            count: 0,
            current: Batch::default(),
            batches: Vec::new(),
        })
    }

    fn impacts(&self) -> u32 {
        self.settle.saturating_add(self.batch * self.requested)
    }

    /// Adds an impact of `map` from `before`, its restitution `drawn` times the map's.
    #[inline]
    fn add(&mut self, map: &Map, before: PartState, impact: &Impact, drawn: f64) {
        if self.count == self.settle {
            self.vector.take_growth();
        }
        self.count += 1;
        // A grazing impact has no tangent; such states have measure zero.
        if let Some(tangent) = Tangent::build(map, before, impact) {
            self.vector.map_by(tangent.jacobian, drawn);
        }
        if self.count > self.settle {
            self.current.cycles += impact.flight / TAU;
            self.current.impacts += 1;
            if self.current.impacts == self.batch {
                self.end_batch();
            }
        }
    }

    fn end_batch(&mut self) {
        self.current.growth = self.vector.take_growth();
        // Batches beyond the list are left out.
        let _ = self.batches.push(core::mem::take(&mut self.current));
    }

    /// The exponent; `rest` is the number of impacts before a rest.
    fn exponent(mut self, rest: Option<u32>) -> Exponent {
        if self.batches.len() < 2 && self.current.impacts > 0 {
            self.end_batch();
        }
        let batches = &self.batches;
        let sum = |of: fn(&Batch) -> f64| batches.iter().map(of).sum::<f64>();
        let growth = sum(|batch| batch.growth);
        let impacts = sum(|batch| f64::from(batch.impacts));
        let cycles = sum(|batch| batch.cycles);
        // Ratio estimator: its error is that of the residuals growth - ratio * unit.
        let estimate = |unit: fn(&Batch) -> f64, units: f64| {
            let value = growth / units;
            let deviation = |n: usize| batches[n].growth - value * unit(&batches[n]);
            let mean_error = standard_error(batches.len(), deviation);
            let error = mean_error * batches.len() as f64 / units;
            Estimate { value, error }
        };
        let per_impact = estimate(|batch| f64::from(batch.impacts), impacts);
        let dynamics = match rest {
            Some(after) => Dynamics::Rest { after },
            None => Dynamics::from_exponent(per_impact),
        };
        Exponent {
            per_impact,
            per_cycle: estimate(|batch| batch.cycles, cycles),
            flight: cycles / impacts,
            dynamics,
        }
    }
}

/// A tangent vector that the Jacobians carry along an orbit, normalized if extreme.
#[derive(Clone, Copy)]
struct TangentVector {
    vector: [f64; 2],
    /// Logarithm of the growth taken out of the vector.
    growth: f64,
}

/// Sizes of the vector, between which it is not normalized.
const VECTOR_SIZES: core::ops::Range<f64> = 1e-100..1e100;

impl TangentVector {
    /// Maps the vector by a Jacobian; the drawn restitution over the mean scales velocity
    /// differences like the velocity.
    fn map_by(&mut self, [[a, b], [c, d]]: [[f64; 2]; 2], drawn: f64) {
        let [x, y] = self.vector;
        let vector = [a * x + b * y, drawn * (c * x + d * y)];
        let size = vector[0].abs() + vector[1].abs();
        if VECTOR_SIZES.contains(&size) {
            self.vector = vector;
        } else if size > 0.0 && size.is_finite() {
            self.vector = vector;
            self.normalize();
        }
    }

    fn normalize(&mut self) {
        let size = libm::hypot(self.vector[0], self.vector[1]);
        self.vector = self.vector.map(|component| component / size);
        self.growth += libm::log(size);
    }

    /// Logarithm of the growth since the last call; the vector has length 1 then.
    fn take_growth(&mut self) -> f64 {
        self.normalize();
        core::mem::take(&mut self.growth)
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Batch {
    growth: f64,
    cycles: f64,
    impacts: u32,
}

/// Standard error of the mean of successive correlated values: `sqrt(variance tau/(n - 1))`;
/// infinite for fewer than two.
///
/// The autocorrelation time is `tau = 1 + 2 sum rho(t)` over the smallest window of at least
/// `5 tau` (automatic windowing: Madras and Sokal 1988; Wolff 2004). The bias of a finite series is
/// corrected. The spread of 48 runs at k = 0.34, R = 0.2 is 0.9 to 1.2 times the estimate.
fn standard_error(count: usize, value: impl Fn(usize) -> f64) -> f64 {
    if count < 2 {
        return f64::INFINITY;
    }
    let n = count as f64;
    let mean = (0..count).map(&value).sum::<f64>() / n;
    let deviation = |i: usize| value(i) - mean;
    let covariance = |lag: usize| {
        (lag..count)
            .map(|i| deviation(i) * deviation(i - lag))
            .sum::<f64>()
            / n
    };
    let variance = covariance(0);
    // Smallest window in values; negative autocorrelation shows within it.
    const MIN_WINDOW: usize = 8;
    let mut time = 1.0;
    let mut window = 0;
    while variance > 0.0 && window + 1 < count / 2 {
        window += 1;
        time += 2.0 * covariance(window) / variance;
        if window >= MIN_WINDOW && window as f64 >= 5.0 * time {
            break;
        }
    }
    let bias = 1.0 + (2.0 * window as f64 + 1.0) / n;
    libm::sqrt(variance * (time * bias).max(0.02) / (n - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::Noise;

    /// The spread of runs agrees with their standard errors. Batches of correlated impacts would
    /// give too small an error.
    #[test]
    fn standard_errors_match_the_spread_of_runs() {
        for (k, restitution) in [(0.34, 0.2), (0.35, 0.2), (0.586, 0.5)] {
            let map = Map::build(k, restitution).unwrap();
            let (settle, impacts) = (500, 20_000);
            let settings = ExponentSettings { settle, impacts };
            let (mut sum, mut square, mut errors, mut n) = (0.0, 0.0, 0.0, 0.0);
            for run in 0..48 {
                let mut from = start_near_lock(&map, 1);
                from.phase += 1e-4 * f64::from(run);
                let actual = measure(&map, from, settings).unwrap();
                if matches!(actual.dynamics, Dynamics::Rest { .. }) {
                    continue;
                }
                let Estimate { value, error } = actual.per_impact;
                (sum, square) = (sum + value, square + value * value);
                (errors, n) = (errors + error * error, n + 1.0);
            }
            let deviation = libm::sqrt((square - sum * sum / n) / (n - 1.0));
            let ratio = deviation / libm::sqrt(errors / n);
            // The spread of 48 runs has a relative error of 10 %.
            assert!((0.7..1.3).contains(&ratio), "{k}: {ratio} of {n}");
        }
    }

    /// docs/theory-reference.md#t11.3
    #[test]
    fn exponents_match_the_references() {
        let (settle, impacts) = (2000, 400_000);
        let settings = ExponentSettings { settle, impacts };
        for (restitution, k, exponent) in [
            (0.2, 0.43, -1.3307),
            (0.2, 0.358, 0.0778),
            (0.2, 0.355, 0.0522),
            (0.2, 0.35, 0.3622),
            (0.2, 0.34, 0.5020),
            (0.5, 0.586, 0.0860),
        ] {
            let map = Map::build(k, restitution).unwrap();
            let actual = measure(&map, start_near_lock(&map, 1), settings).unwrap();
            let Estimate { value, error } = actual.per_impact;
            let difference = (value - exponent).abs();
            assert!(difference < 0.003 + 3.0 * error, "{k} {actual:?}");
        }
    }

    #[test]
    fn orbits_side_by_side_have_the_bits_of_each_alone() {
        let (settle, impacts) = (100, 2000);
        let settings = ExponentSettings { settle, impacts };
        for [k, restitution] in [
            [0.34, 0.2],
            [0.43, 0.2],
            [0.586, 0.5],
            [0.35, 0.0],
            [0.2, 0.95],
        ] {
            let map = Map::build(k, restitution).unwrap();
            let start = start_near_lock(&map, 1);
            let shifts = [0.0, 1.0, 2.0, 3.0, 4.0].map(|n| 1e-4 * n);
            let starts = shifts.map(|shift| PartState::new(start.phase + shift, start.velocity));
            let separate = starts.map(|start| measure(&map, start, settings).unwrap());
            let rests = |one: &Exponent| matches!(one.dynamics, Dynamics::Rest { .. });
            let expected = (!separate.iter().any(rests)).then_some(separate);
            let joint = measure_together(&map, starts, settings).unwrap();
            assert_eq!(joint, expected, "{k}");
        }
    }

    /// The autoregression x' = a x + noise has tau = (1 + a)/(1 - a).
    #[test]
    fn correlated_errors_match_the_theory() {
        let mut noise = Noise::new(3);
        for a in [0.0_f64, 0.5, 0.8, -0.5] {
            let mut mean = 0.0;
            for _ in 0..40 {
                let mut x = 0.0;
                let values: [f64; 512] = core::array::from_fn(|_| {
                    x = a * x + 2.0 * f64::from(noise.uniform()) - 1.0;
                    x
                });
                mean += standard_error(values.len(), |n| values[n]) / 40.0;
            }
            let tau = (1.0 + a) / (1.0 - a);
            let expected = libm::sqrt(tau / 3.0 / (1.0 - a * a) / 512.0);
            // A window of 5 tau omits 1 % of the sum; its noise adds a few per cent.
            assert!((mean / expected - 1.0).abs() < 0.1, "{a}: {mean}");
        }
    }
}
