//! Chatter of a part that the track throws from rest once a cycle: which restitution sounds like
//! what was folded.

use core::f32::consts::TAU;

use super::fold::BINS;
use crate::arithmetic::square_root_single;
use crate::impact::{Hybrid, Kernel};

/// Bin in which the first landing is expected.
pub const LANDING: usize = 24;
/// Bins of quiet before it: the part is in the air.
const QUIET: usize = 16;
/// Impacts that are followed; what is left of a chatter then is not heard.
const IMPACTS: usize = 12;
/// Bins in a radian.
const PER_RADIAN: f32 = 256.0 / TAU;
/// Delay of lift-off in rad, so that rounding of arcsin k never leaves the part on the track.
const LEAVING: f64 = 1e-4;
/// Restitutions that are tried: the first, the step and how many.
const FIRST: f32 = 0.02;
const STEP: f32 = 0.01;
const TRIED: usize = 88;
/// Decays of the ringing that are tried, in bins, each root 2 times the one before.
const SHORTEST: f32 = 3.0;
const DECAYS: u16 = 8;
/// Shifts of the first landing that are tried, in three quarters of a bin to either side.
const SHIFTS: i8 = 3;
/// The end of the bins that the first landing's loudness is taken from.
const LOUD: usize = 40;
/// Energy in a bin over all of that loudness below which nothing is told apart.
const FAINTEST: f32 = 2e-3;
/// Its loudness over the noise's from which on it stands out.
const AUDIBLE: f32 = 0.6;

/// The impacts of one part from its first landing until it rests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chatter {
    /// Phase of the first landing in rad, counted on from the cycle of the lift-off.
    pub landing: f32,
    lift_off: f32,
    /// Time from the first landing until the part rests in rad; infinite where it does not.
    pub rest: f32,
    /// Time from the first landing in bins, and speed over that of the first.
    impacts: [(f32, f32); IMPACTS],
}

impl Chatter {
    /// The chatter of a part of this restitution, thrown from rest at k; `None` where it is not thrown.
    pub fn of(k: f64, restitution: f32) -> Option<Self> {
        let restitution = restitution.max(1e-3);
        let map = Hybrid::build(k, f64::from(restitution)).ok()?;
        if k >= 1.0 {
            return None;
        }
        let lift_off = libm::asin(k);
        let mut state = Hybrid::state(lift_off + LEAVING, 0.0).ok()?;
        let mut impact = map.impact(state);
        let landing = (lift_off + LEAVING + impact.flight) as f32;
        let first = Hybrid::observe(impact.next).velocity as f32;
        if first <= 0.0 {
            return None;
        }
        let (mut time, mut rest) = (0.0, f32::INFINITY);
        let mut impacts = [(f32::INFINITY, 0.0); IMPACTS];
        for slot in &mut impacts {
            let speed = Hybrid::observe(impact.next).velocity as f32 / first;
            *slot = (time * PER_RADIAN, speed);
            state = impact.next;
            impact = map.impact(state);
            let flight = impact.flight as f32;
            time += flight;
            if time > TAU {
                break;
            }
            if flight < 0.02 {
                rest = time + flight * restitution / (1.0 - restitution);
                break;
            }
            // What it still hops is nearly a geometric series.
            rest = time + flight / (1.0 - restitution).max(0.02);
        }
        if time > TAU {
            rest = f32::INFINITY;
        }
        Some(Self {
            landing,
            lift_off: lift_off as f32,
            rest,
            impacts,
        })
    }

    /// Whether the part comes to rest before the track throws it anew.
    #[must_use]
    pub fn rests(&self) -> bool {
        self.landing + self.rest < TAU + self.lift_off
    }

    /// Energy of the ringing in each bin over that of the first impact's beginning, with the first landing
    /// `shift` bins later than expected and an amplitude that decays in `decay` bins.
    fn energies(&self, shift: f32, decay: f32) -> [f32; BINS] {
        let keep = libm::expf(-2.0 / decay);
        let share = 0.5 * decay;
        let (mut energy, mut next) = (0.0_f32, 0);
        let mut energies = [0.0; BINS];
        for (bin, slot) in energies.iter_mut().enumerate() {
            *slot = energy * (1.0 - keep) * share;
            energy *= keep;
            while let Some(&(time, speed)) = self.impacts.get(next) {
                let after = (bin + 1) as f32 - (LANDING as f32 + shift + time);
                // Also where there is no such impact: an infinite time.
                if after <= 0.0 {
                    break;
                }
                let kept = libm::expf(-2.0 * after / decay);
                *slot += speed * speed * (1.0 - kept) * share;
                energy += speed * speed * kept;
                next += 1;
            }
        }
        energies
    }
}

/// Bins to either side over which energies are averaged: half a period of the ringing and more.
const AVERAGED: usize = 2;
/// Bins over which they are.
const WINDOW: usize = 2 * AVERAGED + 1;

/// Averages energies over neighbouring bins: the ringing has its own phase in each.
fn smooth(energies: &mut [f32; BINS]) {
    let mut last = [0.0; WINDOW];
    let mut sum = 0.0;
    for bin in 0..BINS + AVERAGED {
        let new = energies.get(bin).copied().unwrap_or(0.0);
        let slot = &mut last[bin % WINDOW];
        sum += new - *slot;
        *slot = new;
        let out = bin.checked_sub(AVERAGED);
        if let Some(energy) = out.and_then(|out| energies.get_mut(out)) {
            *energy = (sum * (1.0 / WINDOW as f32)).max(0.0);
        }
    }
}

/// Logarithm to the base 2 of a positive number, error below 0.009: a comparison needs no better.
fn logarithm(x: f32) -> f32 {
    let bits = x.to_bits();
    let mantissa = f32::from_bits((bits & 0x007f_ffff) | 0x3f80_0000);
    let exponent = ((bits >> 23) as i32 - 127) as f32;
    exponent + (mantissa - 1.0) * (1.0 + 0.3448 * (2.0 - mantissa))
}

/// The comparison of folds with the chatter of every restitution, slice by slice.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    k: f64,
    /// k at which the parts are known to rest each cycle, and at which they are known not to.
    bounds: (f64, f64),
    /// Energies of the fold over the noise, averaged.
    energies: [f32; BINS],
    /// Energy that is still noise.
    floor: f32,
    /// Sum of the energies after the first landing.
    loudness: f32,
    /// Sum of the squared differences for each restitution, over all folds and in the running one.
    differences: [f32; TRIED],
    running: [f32; TRIED],
    /// Slices done for the running fold.
    slice: u16,
}

/// Slices for each restitution.
const SLICES: u16 = 2;

impl Fit {
    /// Nothing compared yet.
    pub const NEW: Self = Self {
        k: 1.0,
        bounds: (1.0, 0.0),
        energies: [0.0; BINS],
        floor: 0.0,
        loudness: 0.0,
        differences: [0.0; TRIED],
        running: [0.0; TRIED],
        slice: SLICES * TRIED as u16,
    };

    /// Begins the comparison of a fold of the residual's mean square at k, among the parts that rest each
    /// cycle at the first of `bounds` and do not at the second.
    pub fn begin(&mut self, k: f64, bounds: (f64, f64), folded: &[f32; BINS]) {
        let noise = folded[..QUIET].iter().sum::<f32>() / QUIET as f32;
        let mut quiet = *folded;
        smooth(&mut quiet);
        let inner = &quiet[AVERAGED..QUIET - AVERAGED];
        let squares: f32 = inner.iter().map(|e| (e - noise) * (e - noise)).sum();
        let spread = square_root_single(squares / inner.len() as f32);
        self.energies = folded.map(|energy| energy - noise);
        smooth(&mut self.energies);
        self.loudness = self.energies[LANDING..LOUD].iter().sum();
        let faintest = FAINTEST * self.loudness;
        self.floor = (4.0 * spread)
            .max(0.2 * noise)
            .max(faintest)
            .max(f32::MIN_POSITIVE);
        self.k = k;
        self.bounds = bounds;
        self.running = [f32::INFINITY; TRIED];
        self.slice = 0;
    }

    /// Whether the first landing stands out of the noise.
    #[must_use]
    pub fn audible(&self) -> bool {
        self.loudness > AUDIBLE * self.floor * (LOUD - LANDING) as f32
    }

    /// One slice, at most 0.2 million instructions; whether more are to be done.
    pub fn step(&mut self) -> bool {
        let index = usize::from(self.slice / SLICES);
        if index >= TRIED {
            return false;
        }
        let restitution = tried(index);
        let rests = |k| Chatter::of(k, restitution).is_some_and(|chatter| chatter.rests());
        if rests(self.bounds.0) && !rests(self.bounds.1) {
            if let Some(chatter) = Chatter::of(self.k, restitution) {
                let first = self.slice % SLICES;
                for n in (first..DECAYS).step_by(usize::from(SLICES)) {
                    let decay = SHORTEST * libm::exp2f(f32::from(n) * 0.5);
                    for shift in -SHIFTS..=SHIFTS {
                        let energies = chatter.energies(0.75 * f32::from(shift), decay);
                        let difference = self.difference(energies);
                        if let Some(running) = self.running.get_mut(index) {
                            *running = running.min(difference);
                        }
                    }
                }
            }
            self.slice += 1;
        } else {
            self.slice += SLICES;
        }
        if usize::from(self.slice / SLICES) >= TRIED {
            for (sum, running) in self.differences.iter_mut().zip(&self.running) {
                *sum += running;
            }
        }
        true
    }

    /// Whether there is more to do.
    #[must_use]
    pub fn busy(&self) -> bool {
        usize::from(self.slice / SLICES) < TRIED
    }

    /// Mean square of the logarithm of the fold's energies over these, each with the noise's.
    fn difference(&self, mut energies: [f32; BINS]) -> f32 {
        smooth(&mut energies);
        let sum: f32 = energies[LANDING..LOUD].iter().sum();
        if sum <= 0.0 {
            return f32::INFINITY;
        }
        let scale = self.loudness / sum;
        let mut squares = 0.0;
        for (heard, energy) in self.energies.iter().zip(&energies).skip(QUIET) {
            let ratio = (heard + self.floor) / (scale * energy + self.floor);
            let logarithm = logarithm(ratio);
            squares += logarithm * logarithm;
        }
        squares * (1.0 / (BINS - QUIET) as f32)
    }

    /// The restitution that the last fold sounds like.
    #[must_use]
    pub fn last(&self) -> Option<Match> {
        lowest(&self.running, 1.0)
    }

    /// The restitution that all `folds` so far sound like.
    #[must_use]
    pub fn all(&self, folds: f32) -> Option<Match> {
        lowest(&self.differences, folds)
    }
}

fn tried(index: usize) -> f32 {
    FIRST + STEP * index as f32
}

/// What folds were found to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Restitution of the part (symbol R).
    pub restitution: f32,
    /// Mean square of the difference in loudness, as a logarithm to the base 2.
    pub difference: f32,
}

/// The lowest of the sums over `folds`, between the grid's points by a parabola.
fn lowest(sums: &[f32; TRIED], folds: f32) -> Option<Match> {
    let (index, least) = sums
        .iter()
        .copied()
        .enumerate()
        .filter(|(_, sum)| sum.is_finite())
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    let side = |index: Option<usize>| index.and_then(|index| sums.get(index)).copied();
    let (below, above) = (side(index.checked_sub(1)), side(Some(index + 1)));
    let apart = match (below, above) {
        (Some(below), Some(above)) if below.is_finite() && above.is_finite() => {
            0.5 * (below - above) / (below - 2.0 * least + above).max(1e-6)
        }
        _ => 0.0,
    };
    Some(Match {
        restitution: tried(index) + STEP * apart.clamp(-0.5, 0.5),
        difference: least / folds,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_logarithm_keeps_its_error() {
        for n in 1..100_000 {
            let x = n as f32 * 0.01;
            assert!((logarithm(x) - libm::log2f(x)).abs() < 0.009, "{x}");
        }
    }

    #[test]
    fn a_chatter_is_that_of_the_map_and_rests_where_the_track_lets_it() {
        for (k, restitution, interval) in [(0.6, 0.3, 0.579), (0.75, 0.6, 0.654), (0.5, 0.2, 0.601)]
        {
            let chatter = Chatter::of(k, restitution).unwrap();
            // Intervals from an independent root search in double precision, to the digits given.
            let second = chatter.impacts[1].0 / PER_RADIAN;
            assert!(
                (second - interval).abs() < 1e-3,
                "{k} {restitution}: {second}"
            );
            assert!(chatter.rests());
        }
        assert!(!Chatter::of(0.45, 0.3).unwrap().rests());
        assert_eq!(Chatter::of(1.0, 0.3), None);
    }

    #[test]
    fn a_fold_made_of_a_chatter_is_found_to_be_it() {
        for (k, restitution) in [
            (0.5, 0.2),
            (0.56, 0.3),
            (0.62, 0.4),
            (0.68, 0.5),
            (0.8, 0.7),
        ] {
            let mut fit = Fit::NEW;
            for n in 0..3 {
                let k = k * (1.0 + 0.02 * f64::from(n));
                let chatter = Chatter::of(k, restitution).unwrap();
                let mut folded = chatter.energies(0.5, 13.0);
                for (bin, energy) in folded.iter_mut().enumerate() {
                    *energy += 1e-3 * (10 + bin % 3) as f32;
                }
                fit.begin(k, (k * 1.05, k * 0.8), &folded);
                assert!(fit.audible());
                while fit.step() {}
            }
            let found = fit.all(3.0).unwrap();
            assert!(
                (found.restitution - restitution).abs() < 0.01,
                "{k}: {found:?}"
            );
        }
    }
}
