//! Locks and their bands on a track of several tones, in closed form
//! (docs/theory-real-parts.md#t10.3).
//!
//! The edges of the bands are found by a scan over the impact phase and bisection.

use core::f64::consts::{PI, TAU};

use heapless::Vec;

use super::lock::{Lock, accept_order, accept_restitution};
use crate::arithmetic::bisect;
use crate::feeder::{OutOfRange, Restitution};
use crate::impact::{ContactTime, Orbit, PartState, Wave, WaveMap};

/// The period-1 orbit of one order with a given impact phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveLock {
    wave: Wave,
    lock: Lock,
}

impl WaveLock {
    /// Orbit of `order` with impact phase t0 in rad: `k = S'(t0) (1+R)/(pi r (1-R))`, `psi = 2 pi r
    /// k R/(1+R)`. `None` if the track moves downwards at t0. [`WaveLock::is_first_return`] decides
    /// whether a part can follow it.
    fn with_impact_phase(
        wave: &Wave,
        phase: f64,
        restitution: f64,
        order: u32,
    ) -> Result<Option<Self>, OutOfRange> {
        let r = accept_order(order)?;
        accept_restitution(restitution)?;
        let [_, speed, ..] = wave.motion(phase);
        let k = speed * (1.0 + restitution) / (PI * r * (1.0 - restitution));
        let velocity = TAU * r * k * restitution / (1.0 + restitution);
        let lock = Lock {
            order,
            k,
            restitution,
            contact: ContactTime::INSTANT,
            state: PartState::new(phase - TAU * libm::floor(phase / TAU), velocity),
        };
        // Range of k of the impact map.
        let is_in_range = (1e-3..=1e3).contains(&k);
        Ok(is_in_range.then_some(Self { wave: *wave, lock }))
    }

    /// Orbit of `order` at `k` that attracts and that a part can follow; `None` without one. Of
    /// several it is that of the highest band.
    pub fn find_attracting(
        wave: &Wave,
        k: f64,
        restitution: f64,
        order: u32,
    ) -> Result<Option<Self>, OutOfRange> {
        let bands = WaveBands::find(wave, restitution, order)?;
        match bands.iter().find(|band| band.contains(k)) {
            Some(band) => Self::find_in_band(&band, wave, k, restitution, order),
            None => Ok(None),
        }
    }

    /// Orbit at `k` within a `band` from [`WaveBands::find`] for the same wave, restitution and
    /// order. `None` if the band does not contain k.
    pub fn find_in_band(
        band: &WaveBand,
        wave: &Wave,
        k: f64,
        restitution: f64,
        order: u32,
    ) -> Result<Option<Self>, OutOfRange> {
        let at = |phase| Self::with_impact_phase(wave, phase, restitution, order);
        if !band.contains(k) {
            return Ok(None);
        }
        // k falls with the phase.
        let (first, last) = band.phases();
        let [_, last] = bisect(first, last, 60, |phase| {
            let found = at(phase).ok().flatten();
            found.is_none_or(|found| found.lock.k >= k)
        });
        at(last)
    }

    /// State just after each impact: phase t0 in rad and velocity psi in `b w`.
    pub fn state(&self) -> PartState {
        self.lock.state
    }

    fn map(&self) -> Result<WaveMap, OutOfRange> {
        WaveMap::on(self.wave, self.lock.k, self.lock.restitution)
    }

    fn is_first_return(&self) -> bool {
        self.lock.returns_first(self.map())
    }

    /// Whether a part from rest reaches the orbit within this number of impacts, to 1e-3 in phase
    /// (rad) and velocity (`b w`).
    pub fn is_reached_from_rest(&self, impacts: usize) -> bool {
        let Ok(map) = self.map() else {
            return false;
        };
        let mut orbit = Orbit::from_rest(&map);
        // At most a rest and a lift-off for each impact.
        let events = 3 * impacts;
        orbit.by_ref().take(events).count() == events && self.lock.distance(orbit.state()) < 1e-3
    }
}

/// Bifurcation at an edge of a band.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bifurcation {
    /// Saddle-node: the orbit is created together with an unstable one.
    SaddleNode,
    /// Flip: the period doubles.
    Flip,
    /// Grazing: the flight touches the track before it returns.
    Grazing,
}

/// An edge of a band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BandEdge {
    /// k at the edge.
    pub k: f64,
    /// Impact phase of the orbit at the edge, in rad.
    pub phase: f64,
    /// Bifurcation at the edge.
    pub bifurcation: Bifurcation,
}

/// Band of k in which a period-1 orbit attracts and a part can follow it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveBand {
    /// Low edge in k, at the largest amplitude.
    pub low: BandEdge,
    /// High edge in k.
    pub high: BandEdge,
}

impl WaveBand {
    /// Whether `k` lies strictly inside.
    pub fn contains(&self, k: f64) -> bool {
        self.low.k < k && k < self.high.k
    }

    /// k with the largest margin: its amplitude is the mean of the amplitudes at the edges.
    pub fn setpoint(&self) -> f64 {
        2.0 / (1.0 / self.low.k + 1.0 / self.high.k)
    }

    /// Impact phases at the high and at the low edge in rad, in rising order.
    fn phases(&self) -> (f64, f64) {
        let (first, last) = (self.high.phase, self.low.phase);
        (first, if last < first { last + TAU } else { last })
    }

    fn intersection(&self, other: &Self) -> Option<Self> {
        let low = if self.low.k < other.low.k {
            other.low
        } else {
            self.low
        };
        let high = if self.high.k < other.high.k {
            self.high
        } else {
            other.high
        };
        (low.k < high.k).then_some(Self { low, high })
    }
}

const MAX_BANDS: usize = 6;

/// Bands of one order in falling k.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WaveBands {
    bands: Vec<WaveBand, MAX_BANDS>,
}

/// Number of phases of the scan; bands narrower than 2 pi/2048 in phase may be missed. On a sine
/// the band of order r is `2 (1+R^2)/(pi r (1-R^2))` wide, at order 100 0.0064 rad or two steps.
const SCANNED_PHASES: u32 = 2048;

/// Number of equidistant restitutions of a lot that must share a band, with both ends. The ends
/// suffice if an edge is monotonic in R; the others are for a change of its bifurcation.
const COMPARED_RESTITUTIONS: u32 = 9;

impl WaveBands {
    /// Bands of one restitution (0..1, 1 excluded) in lock `order`, 1..=100. Edges within 1e-12.
    ///
    /// An orbit with impact phase t0 attracts where `0 < A/S' < 2 (1+R^2)/(pi r (1-R^2))`; its k
    /// falls as t0 grows.
    pub fn find(wave: &Wave, restitution: f64, order: u32) -> Result<Self, OutOfRange> {
        let r = accept_order(order)?;
        accept_restitution(restitution)?;
        let square = restitution * restitution;
        let steepest = 2.0 * (1.0 + square) / (PI * r * (1.0 - square));
        let lock = |phase: f64| {
            let lock = WaveLock::with_impact_phase(wave, phase, restitution, order);
            lock.ok().flatten()
        };
        let attracts = |phase: f64| {
            let [_, speed, push, _] = wave.motion(phase);
            0.0 < push && push < steepest * speed
        };
        let holds =
            |phase: f64| attracts(phase) && lock(phase).is_some_and(|lock| lock.is_first_return());
        // Bisection for the edge between a phase inside and one outside a band.
        let end = |inside: f64, outside: f64| {
            let [inside, outside] = bisect(inside, outside, 60, holds);
            let [_, speed, push, _] = wave.motion(outside);
            lock(inside).map(|WaveLock { lock, .. }| BandEdge {
                k: lock.k,
                phase: lock.state.phase,
                bifurcation: if attracts(outside) {
                    Bifurcation::Grazing
                } else if push < 0.5 * steepest * speed {
                    Bifurcation::SaddleNode
                } else {
                    Bifurcation::Flip
                },
            })
        };
        let step = TAU / f64::from(SCANNED_PHASES);
        let mut result = Self::default();
        // Start outside any band, so that none spans the ends of the scan.
        let mut scan = 0..SCANNED_PHASES;
        let start = scan.find(|&n| !holds(f64::from(n) * step)).unwrap_or(0);
        let mut begin = None;
        for n in start..=start + SCANNED_PHASES {
            let phase = f64::from(n) * step;
            if holds(phase) {
                if begin.is_none() {
                    begin = end(phase, phase - step);
                }
            } else if let Some(high) = begin.take()
                && let Some(low) = end(phase - step, phase)
                && low.k < high.k
            {
                // Bands beyond the list are left out.
                let _ = result.bands.push(WaveBand { low, high });
            }
        }
        result.sort();
        Ok(result)
    }

    /// Bands shared by all parts of a lot, checked at nine restitutions with both ends.
    pub fn common(wave: &Wave, lot: Restitution, order: u32) -> Result<Self, OutOfRange> {
        let find = |restitution| Self::find(wave, restitution, order);
        let mut shared = find(lot.low())?;
        if lot.low() == lot.high() {
            return Ok(shared);
        }
        for part in 1..COMPARED_RESTITUTIONS {
            let share = f64::from(part) / f64::from(COMPARED_RESTITUTIONS - 1);
            let other = find(lot.low() + (lot.high() - lot.low()) * share)?;
            let mut both = Self::default();
            let bands = shared.iter();
            let pairs = bands.flat_map(|a| other.iter().map(move |b| a.intersection(&b)));
            for band in pairs.flatten() {
                let _ = both.bands.push(band);
            }
            shared = both;
        }
        shared.sort();
        Ok(shared)
    }

    /// Bands in falling k.
    pub fn iter(&self) -> impl Iterator<Item = WaveBand> + '_ {
        self.bands.iter().copied()
    }

    /// The band widest in k.
    pub fn widest(&self) -> Option<WaveBand> {
        let width = |band: &WaveBand| band.high.k - band.low.k;
        self.iter().max_by(|a, b| width(a).total_cmp(&width(b)))
    }

    fn sort(&mut self) {
        self.bands
            .sort_unstable_by(|a, b| b.high.k.total_cmp(&a.high.k));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{Kernel, Tone};
    use crate::regime::lock::is_stable;
    use crate::regime::{MAX_ORDER, band};

    fn two_tones(amplitude: f64, angle: f64) -> Wave {
        Wave::build(Tone::new(amplitude, angle), Tone::default()).unwrap()
    }

    fn tangent(WaveLock { wave, lock }: &WaveLock) -> [f64; 2] {
        lock.tangent_without_contact(wave.push(lock.state.phase))
    }

    #[test]
    fn one_tone_bands_match_the_closed_forms() {
        let wide = [(0.1, 1), (0.2, 2), (0.3, 1), (0.5, 3), (0.6, 2), (0.8, 1)];
        let narrow = [10, 37, 70, MAX_ORDER].map(|order| (0.1, order));
        for (restitution, order) in wide.into_iter().chain(narrow) {
            let (wave, lot) = (Wave::sine(), Restitution::single(restitution).unwrap());
            let bands = WaveBands::common(&wave, lot, order).unwrap();
            assert_eq!(bands.iter().count(), 1);
            let actual = bands.widest().unwrap();
            let [k1, k2] = [band::birth, band::flip].map(|edge| edge(restitution, order).unwrap());
            assert!((actual.low.k / k2 - 1.0).abs() < 1e-12, "{actual:?} {k2}");
            assert!((actual.high.k / k1 - 1.0).abs() < 1e-12, "{actual:?} {k1}");
            let bifurcations = [actual.low.bifurcation, actual.high.bifurcation];
            assert_eq!(bifurcations, [Bifurcation::Flip, Bifurcation::SaddleNode]);
            // At the saddle-node, t0 = 0, one multiplier is 1.
            let born = WaveLock::with_impact_phase(&wave, 0.0, restitution, order);
            assert!(!is_stable(tangent(&born.unwrap().unwrap())));
        }
        // On two tones a part locks where the lock is predicted.
        let lock = WaveLock::find_attracting(&two_tones(0.15, 2.356), 0.31, 0.2, 1);
        assert!(lock.unwrap().unwrap().is_reached_from_rest(400));
    }

    #[test]
    fn band_orbit_closes_with_the_stated_tangent() {
        for (e, th, restitution, order) in [
            (0.15, 2.356, 0.2, 1),
            (0.25, 2.6, 0.5, 1),
            (0.1, 2.2, 0.3, 2),
            (0.4, 1.0, 0.4, 1),
        ] {
            let wave = two_tones(e, th);
            for band in WaveBands::find(&wave, restitution, order).unwrap().iter() {
                let (first, last) = band.phases();
                for part in 1..8 {
                    let phase = first + (last - first) * f64::from(part) / 8.0;
                    let lock = WaveLock::with_impact_phase(&wave, phase, restitution, order);
                    let lock = lock.unwrap().unwrap();
                    assert!(band.contains(lock.lock.k));
                    assert!(is_stable(tangent(&lock)) && lock.is_first_return());
                    let map = lock.map().unwrap();
                    let start = lock.state();
                    let at = |phase: f64, velocity: f64| {
                        let state = PartState::new(start.phase + phase, start.velocity + velocity);
                        let impact = map.impact(state);
                        (impact.flight + phase, impact.next.velocity)
                    };
                    let (flight, velocity) = at(0.0, 0.0);
                    assert!((flight - TAU * f64::from(order)).abs() < 1e-11);
                    assert!((velocity - start.velocity).abs() < 1e-11);
                    // Central differences; the error is below 1e3, the largest third derivative,
                    // times the squared step.
                    let step = 1e-5;
                    let of_phase = at(step, 0.0).0 - at(-step, 0.0).0;
                    let of_velocity = at(0.0, step).1 - at(0.0, -step).1;
                    let trace = (of_phase + of_velocity) / (2.0 * step);
                    let [expected, _] = tangent(&lock);
                    assert!((trace - expected).abs() < 1e-5, "{trace} {expected}");
                }
            }
        }
    }

    #[test]
    fn second_tone_gives_a_wide_lot_a_band() {
        let lot = Restitution::interval(0.10, 0.30).unwrap();
        let one = WaveBands::common(&Wave::sine(), lot, 1).unwrap();
        assert_eq!(one.widest(), None);
        let wave = two_tones(0.15, 2.356);
        let shared = WaveBands::common(&wave, lot, 1).unwrap().widest().unwrap();
        for step in 0..=20 {
            let restitution = 0.10 + 0.01 * f64::from(step);
            let single = WaveBands::find(&wave, restitution, 1).unwrap();
            let k = shared.setpoint();
            assert!(single.iter().any(|band| band.contains(k)), "{restitution}");
        }
    }
}
