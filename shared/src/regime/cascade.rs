//! Period-doubling cascade below a band, located by numerical continuation of the doubled orbits.
//!
//! Predictor: the derivative of the orbit by k. Corrector: Newton's method on the return map. The
//! flip condition is solved by the secant method (Yu. A. Kuznetsov, Elements of Applied Bifurcation
//! Theory, chapter 10; docs/theory-bands.md#t6.1).

use core::f64::consts::TAU;

use heapless::Vec;

use super::band;
use super::lock::{Lock, Multipliers, accept_order, accept_restitution, wrap_phase};
use super::wave_band::{Bifurcation, WaveBands};
use crate::feeder::{OutOfRange, accept_in};
use crate::impact::{Impact, Kernel, Map, PartState, Tangent, Wave, WaveMap};

/// Feigenbaum's constant: the limit of the ratio of successive gaps between flips.
pub const FEIGENBAUM: f64 = 4.669_201_609_102_99;

/// Largest number of flips located; the last gap is about 1e-7 of the first.
pub const MAX_DOUBLINGS: usize = 10;

/// Change in phase (rad) and velocity (`b w`) over a period below which Newton's method takes over.
/// Near an unstable orbit, where the iteration starts, the change is a hundred times as large.
const CLOSED_ORBIT: f64 = 1e-10;

/// Reason for the end of a cascade.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CascadeEnd {
    /// The requested number of flips was located.
    Complete,
    /// The doubled orbit was lost before its flip: it loses a flight (parts of low restitution rest
    /// within it), or the gaps have reached rounding.
    Lost,
}

/// An estimated value with its error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Error of the value, one-sided; a bound in each case that was checked.
    pub error: f64,
}

/// The orbit created at a flip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DoubledOrbit {
    /// k in the middle of its window.
    pub k: f64,
    /// Period in impacts.
    pub impacts: u32,
    /// Floquet multipliers of one period; their product is R to twice the power of its impacts.
    pub multipliers: Multipliers,
}

impl DoubledOrbit {
    /// Both Lyapunov exponents per impact, the larger first: `ln |multiplier|` over the impacts.
    /// Their sum is 2 ln R.
    pub fn exponents(&self) -> [f64; 2] {
        let sizes = match self.multipliers {
            Multipliers::Real(larger, smaller) => [larger, smaller],
            Multipliers::Pair { modulus, .. } => [modulus; 2],
        };
        sizes.map(|size| libm::log(libm::fabs(size)) / f64::from(self.impacts))
    }
}

/// The flips 1 -> 2 -> 4 -> ... of the period-1 orbit of one order, for falling k.
///
/// ```
/// use kband::regime::cascade::Cascade;
/// let cascade = Cascade::locate(0.2, 1, 4)?;
/// assert!((cascade.flips()[1] - 0.366_000_656_686_421).abs() < 1e-13);
/// let end = cascade.k_infinity().expect("four flips are enough");
/// assert!((end.value - 0.358_723_326).abs() < 1e-6);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Cascade {
    flips: Vec<f64, MAX_DOUBLINGS>,
    /// A point of the orbit at each flip.
    states: Vec<PartState, MAX_DOUBLINGS>,
    end: CascadeEnd,
    birth: f64,
    track: MapSettings,
    order: u32,
}

/// Motion of the track, `None` for a sine, and restitution.
#[derive(Clone, Copy, Debug, PartialEq)]
struct MapSettings {
    wave: Option<Wave>,
    restitution: f64,
}

#[expect(
    clippy::large_enum_variant,
    reason = "one at a time lives, and without an allocator there is no box"
)]
enum TrackMap {
    Sine(Map),
    Tones(WaveMap),
}

impl MapSettings {
    fn map_at(&self, k: f64) -> Option<TrackMap> {
        Some(match self.wave {
            None => TrackMap::Sine(Map::build(k, self.restitution).ok()?),
            Some(wave) => TrackMap::Tones(WaveMap::on(wave, k, self.restitution).ok()?),
        })
    }
}

impl TrackMap {
    fn impact(&self, state: PartState) -> Impact {
        match self {
            Self::Sine(map) => map.impact(state),
            Self::Tones(map) => map.impact(state),
        }
    }

    fn tangent(&self, state: PartState, impact: &Impact) -> Option<Tangent> {
        match self {
            Self::Sine(map) => Tangent::build(map, state, impact),
            Self::Tones(map) => Tangent::build(map, state, impact),
        }
    }
}

fn accept_doublings(doublings: usize) -> Result<f64, OutOfRange> {
    let most = MAX_DOUBLINGS as f64;
    accept_in("doublings", doublings as f64, 1.0..=most, "1..10")
}

impl Cascade {
    /// Locates `doublings` flips (1..=10) for a restitution of 0..1 without 1 and an order 1..=100.
    ///
    /// The first flip is equation (17a). Each further orbit is found by Newton's method and
    /// continued along k to the root of `1 + trace + R^(2N) = 0`, where a multiplier is -1. The
    /// error against 40-digit references for R = 0.2 and 0.5 is within 2e-14 of k.
    pub fn locate(restitution: f64, order: u32, doublings: usize) -> Result<Self, OutOfRange> {
        accept_order(order)?;
        accept_restitution(restitution)?;
        accept_doublings(doublings)?;
        let flip = band::flip(restitution, order)?;
        let birth = band::birth(restitution, order)?;
        let cascade = Self::from_first_flip(flip, birth, None, restitution, order);
        Ok(match Lock::build(flip, restitution, order)? {
            Some(lock) => cascade.append_flips(lock.state(), doublings),
            None => cascade,
        })
    }

    /// As [`Cascade::locate`] on a track of several tones, below the highest band that ends in a
    /// flip; `None` without such a band.
    pub fn on_tones(
        wave: &Wave,
        restitution: f64,
        order: u32,
        doublings: usize,
    ) -> Result<Option<Self>, OutOfRange> {
        accept_doublings(doublings)?;
        let bands = WaveBands::find(wave, restitution, order)?;
        let mut bands = bands.iter();
        let Some(band) = bands.find(|band| band.low.bifurcation == Bifurcation::Flip) else {
            return Ok(None);
        };
        let flip = band.low.k;
        let cascade = Self::from_first_flip(flip, band.high.k, Some(*wave), restitution, order);
        let velocity = TAU * f64::from(order) * flip * restitution / (1.0 + restitution);
        let state = PartState::new(band.low.phase, velocity);
        Ok(Some(cascade.append_flips(state, doublings)))
    }

    fn from_first_flip(
        flip: f64,
        birth: f64,
        wave: Option<Wave>,
        restitution: f64,
        order: u32,
    ) -> Self {
        Self {
            flips: Vec::from_array([flip]),
            states: Vec::new(),
            end: CascadeEnd::Complete,
            birth,
            track: MapSettings { wave, restitution },
            order,
        }
    }

    /// Appends the flips after the first; `state` is a point of the orbit at the first.
    fn append_flips(mut self, mut state: PartState, doublings: usize) -> Self {
        // The lists have the capacity of the largest accepted number.
        let _ = self.states.push(state);
        while self.flips.len() < doublings {
            let first_offset = self.first_offset();
            let flip = self.flips.last().copied().unwrap_or(self.birth);
            let continuation = self.continuation_after(self.flips.len());
            let Some((next, orbit)) = continuation.next_flip(flip, first_offset, state) else {
                self.end = CascadeEnd::Lost;
                break;
            };
            let _ = self.flips.push(next);
            let _ = self.states.push(orbit);
            state = orbit;
        }
        self
    }

    fn first_offset(&self) -> f64 {
        match self.flips.as_slice() {
            [.., before, flip] => 0.35 * (before - flip) / FEIGENBAUM,
            // The first gap is unknown; for each R and order 0.2 % of k is well within it.
            [flip] => 2e-3 * flip,
            [] => 0.0,
        }
    }

    fn continuation_after(&self, flips: usize) -> Continuation {
        let impacts = 1_u32 << flips;
        Continuation {
            track: self.track,
            impacts,
            turns: f64::from(self.order) * f64::from(impacts),
        }
    }

    /// Largest relative scatter of restitution (standard deviation over the mean, symbol sigma) at
    /// which each doubling is detectable in the phases. `None` if its orbit was lost.
    ///
    /// The orbit is taken in the middle of its window. The doubling is detectable while two phases
    /// that it separated differ by more than the sum of their standard deviations. Each further
    /// doubling has a limit lower by 6.62 (Crutchfield, Nauenberg and Rudnick 1981).
    pub fn max_visible_scatters(&self) -> impl Iterator<Item = Option<f64>> + '_ {
        (0..self.flips.len()).map(|n| {
            let (continuation, k, state) = self.window_middle(n)?;
            continuation.max_separating_scatter(k, state)
        })
    }

    /// The orbit created at each flip, in the middle of its window; `None` if it was lost.
    pub fn doubled_orbits(&self) -> impl Iterator<Item = Option<DoubledOrbit>> + '_ {
        (0..self.flips.len()).map(|n| {
            let (continuation, k, state) = self.window_middle(n)?;
            let map = self.track.map_at(k)?;
            let [[a, _], [_, d]] = continuation.return_map(&map, state)?.jacobian;
            // Each impact has the determinant R^2 psi/psi'. Computed from the entries it would be
            // lost in cancellation.
            let impacts = continuation.impacts;
            let determinant = libm::pow(self.track.restitution, 2.0 * f64::from(impacts));
            Some(DoubledOrbit {
                k,
                impacts,
                multipliers: Multipliers::from_trace(a + d, determinant),
            })
        })
    }

    /// The orbit created at flip `n`, halfway to the next flip.
    fn window_middle(&self, n: usize) -> Option<(Continuation, f64, PartState)> {
        let gap = match (self.flips.get(n + 1), n.checked_sub(1)) {
            (Some(next), _) => self.flips[n] - next,
            (None, Some(before)) => (self.flips[before] - self.flips[n]) / FEIGENBAUM,
            (None, None) => 4e-3 * self.flips[n],
        };
        let continuation = self.continuation_after(n + 1);
        let k = self.flips[n] - 0.5 * gap;
        let near = continuation.iterate_to_orbit(k, *self.states.get(n)?)?;
        let state = continuation.solve_orbit(k, near)?;
        Some((continuation, k, state))
    }

    /// k of the flips in falling order, the 1 -> 2 flip first.
    pub fn flips(&self) -> &[f64] {
        &self.flips
    }

    /// Reason for the end of the cascade.
    pub fn end(&self) -> CascadeEnd {
        self.end
    }

    /// Ratios of successive gaps between flips; they tend to [`FEIGENBAUM`].
    pub fn ratios(&self) -> impl Iterator<Item = f64> + '_ {
        self.flips()
            .windows(3)
            .map(|three| (three[0] - three[1]) / (three[1] - three[2]))
    }

    /// Accumulation point of the flips in k, where chaos begins, extrapolated with Feigenbaum's
    /// constant; `None` below two flips.
    pub fn k_infinity(&self) -> Option<Estimate> {
        let extrapolate = |n: usize| {
            let (before, last) = (self.flips[n - 2], self.flips[n - 1]);
            last - (before - last) / (FEIGENBAUM - 1.0)
        };
        let count = self.flips.len();
        if count < 2 {
            return None;
        }
        let value = extrapolate(count);
        let error = if count == 2 {
            // The first gap differs from the geometric law by 1 % at R = 0.2 and by 40 % at R =
            // 0.9.
            0.4 * (self.flips[1] - value)
        } else {
            libm::fabs(value - extrapolate(count - 1)) + 4.0 * f64::EPSILON * value
        };
        Some(Estimate { value, error })
    }

    /// k1 of the order, where the period-1 orbit is created.
    pub fn birth(&self) -> f64 {
        self.birth
    }
}

/// Continuation along k of an orbit of `impacts` impacts in `turns` drive cycles.
struct Continuation {
    track: MapSettings,
    impacts: u32,
    turns: f64,
}

impl Continuation {
    /// The next flip and a point of the orbit there, from `first_offset` below `flip` on.
    fn next_flip(
        &self,
        flip: f64,
        first_offset: f64,
        state: PartState,
    ) -> Option<(f64, PartState)> {
        let mut k = flip - first_offset;
        let mut state = self.solve_orbit(k, self.iterate_to_orbit(k, state)?)?;
        let mut condition = self.flip_condition(k, state)?;
        // The doubled orbit is created with a multiplier of 1.
        let square = libm::pow(self.track.restitution, 2.0 * f64::from(self.impacts));
        let mut slope = (2.0 * (1.0 + square) - condition) / first_offset;
        for _ in 0..60 {
            // The condition is nearly linear in k and falls to 0 at the flip.
            let max_step = 0.5 * first_offset.max(flip - k);
            let mut step = (-condition / slope).clamp(-max_step, max_step);
            let drift = self.orbit_derivative(k, state)?;
            // Damping: halve a step that jumps to another orbit, whose condition is no nearer to 0.
            let (next, orbit, value) = loop {
                let next = k + step;
                let small = libm::fabs(step) <= 1e-9 * k;
                let velocity = (state.velocity + drift[1] * step).max(0.0);
                let ahead = Map::state(state.phase + drift[0] * step, velocity).ok()?;
                let orbit = self.solve_orbit(next, ahead);
                match orbit.and_then(|orbit| Some((next, orbit, self.flip_condition(next, orbit)?)))
                {
                    Some(candidate) if small || libm::fabs(candidate.2) < libm::fabs(condition) => {
                        break candidate;
                    }
                    _ if small => return None,
                    _ => step *= 0.5,
                }
            };
            let new_slope = (value - condition) / step;
            let small = libm::fabs(step) <= 4.0 * f64::EPSILON * k;
            (k, state, condition) = (next, orbit, value);
            if small || value == 0.0 {
                return Some((k, state));
            }
            // For smaller steps the difference quotient is dominated by rounding.
            if libm::fabs(step) > 1e-9 * k {
                slope = new_slope;
            }
            if slope <= 0.0 || !slope.is_finite() {
                return None;
            }
        }
        // The steps have reached the rounding of the condition.
        (libm::fabs(condition / slope) < 1e-13 * k).then_some((k, state))
    }

    /// A point near the attracting orbit, by iteration from a point near the orbit that flipped.
    fn iterate_to_orbit(&self, k: f64, state: PartState) -> Option<PartState> {
        let map = self.track.map_at(k)?;
        let phase = state.phase + 1e-3 / f64::from(self.impacts);
        let mut state = Map::state(phase, state.velocity).ok()?;
        for _ in 0..200 + 2000 / self.impacts {
            let before = state;
            for _ in 0..self.impacts {
                let impact = map.impact(state);
                if impact.flight <= 0.0 {
                    return None;
                }
                state = impact.next;
            }
            let moved = libm::fabs(wrap_phase(state.phase - before.phase))
                + libm::fabs(state.velocity - before.velocity);
            if moved < CLOSED_ORBIT {
                break;
            }
        }
        Some(state)
    }

    fn solve_orbit(&self, k: f64, mut state: PartState) -> Option<PartState> {
        let map = self.track.map_at(k)?;
        let mut last = f64::INFINITY;
        for _ in 0..30 {
            let around = self.return_map(&map, state)?;
            let ([x, y], [[a, b], [c, d]]) = (around.closure_error, around.jacobian);
            // Newton step: (J - 1) (dt, dpsi) = -(x, y).
            let determinant = (a - 1.0) * (d - 1.0) - b * c;
            let dt = (-x * (d - 1.0) + y * b) / determinant;
            let dv = (-y * (a - 1.0) + x * c) / determinant;
            let size = libm::fabs(dt) + libm::fabs(dv);
            if !size.is_finite() || size > 0.5 {
                return None;
            }
            state = Map::state(state.phase + dt, (state.velocity + dv).max(0.0)).ok()?;
            if size < 1e-15 || (size < 1e-11 && size >= 0.5 * last) {
                return Some(state);
            }
            last = size;
        }
        None
    }

    /// Derivative of the orbit by k: `(1 - J)^-1` times the derivative of the return map by k.
    fn orbit_derivative(&self, k: f64, state: PartState) -> Option<[f64; 2]> {
        let around = self.return_map(&self.track.map_at(k)?, state)?;
        let ([x, y], [[a, b], [c, d]]) = (around.by_k, around.jacobian);
        let determinant = (1.0 - a) * (1.0 - d) - b * c;
        let drift = [(1.0 - d) * x + b * y, c * x + (1.0 - a) * y].map(|sum| sum / determinant);
        drift.iter().all(|part| part.is_finite()).then_some(drift)
    }

    /// Flip condition `1 + trace + determinant`, 0 if a multiplier is -1.
    fn flip_condition(&self, k: f64, state: PartState) -> Option<f64> {
        let [[a, b], [c, d]] = self.return_map(&self.track.map_at(k)?, state)?.jacobian;
        let value = 1.0 + a + d + (a * d - b * c);
        value.is_finite().then_some(value)
    }

    /// Largest relative scatter of restitution at which the orbit's two halves are distinguishable.
    fn max_separating_scatter(&self, k: f64, start: PartState) -> Option<f64> {
        let map = self.track.map_at(k)?;
        let around = self.return_map(&map, start)?;
        let step = |state: PartState, covariance: [[f64; 2]; 2]| {
            let impact = map.impact(state);
            let jacobian = map.tangent(state, &impact)?.jacobian;
            let mut then = propagate_covariance(jacobian, covariance);
            then[1][1] += impact.next.velocity * impact.next.velocity;
            Some((impact.next, then))
        };
        // Covariance added in one period, then its sum over all earlier periods.
        let (mut state, mut covariance) = (start, [[0.0; 2]; 2]);
        for _ in 0..self.impacts {
            (state, covariance) = step(state, covariance)?;
        }
        let mut covariance = solve_lyapunov(around.jacobian, covariance);
        let mut state = start;
        let mut phases: Vec<(f64, f64), { 1 << MAX_DOUBLINGS }> = Vec::new();
        for _ in 0..self.impacts {
            (state, covariance) = step(state, covariance)?;
            let deviation = libm::sqrt(covariance[0][0]);
            phases.push((state.phase, deviation)).ok()?;
        }
        let (first, second) = phases.split_at(phases.len() / 2);
        let max_ratio = first.iter().zip(second).fold(0.0_f64, |max_ratio, (a, b)| {
            let difference = libm::fabs(wrap_phase(a.0 - b.0));
            max_ratio.max(difference / (a.1 + b.1))
        });
        (max_ratio > 0.0).then_some(max_ratio)
    }

    /// Return map: one period of the orbit, with its derivatives.
    fn return_map(&self, map: &TrackMap, start: PartState) -> Option<ReturnMap> {
        let mut state = start;
        let mut jacobian = [[1.0, 0.0], [0.0, 1.0]];
        let mut by_k = [0.0, 0.0];
        let mut flights = 0.0;
        for _ in 0..self.impacts {
            let impact = map.impact(state);
            if impact.flight <= 0.0 {
                return None;
            }
            let tangent = map.tangent(state, &impact)?;
            let [x, y] = by_k;
            let rows = [0, 1].map(|n| (tangent.jacobian[n], tangent.by_k[n]));
            by_k = rows.map(|([of_x, of_y], added)| of_x * x + of_y * y + added);
            jacobian = product(tangent.jacobian, jacobian);
            flights += impact.flight;
            state = impact.next;
        }
        // An orbit with another number of drive cycles is rejected.
        if libm::fabs(flights - TAU * self.turns) > 1.0 {
            return None;
        }
        Some(ReturnMap {
            closure_error: [
                wrap_phase(state.phase - start.phase),
                state.velocity - start.velocity,
            ],
            jacobian,
            by_k,
        })
    }
}

struct ReturnMap {
    /// Closure error in phase (rad) and velocity (`b w`).
    closure_error: [f64; 2],
    jacobian: [[f64; 2]; 2],
    by_k: [f64; 2],
}

/// `J S J^T`.
fn propagate_covariance(jacobian: [[f64; 2]; 2], covariance: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let [[a, b], [c, d]] = jacobian;
    product(product(jacobian, covariance), [[a, c], [b, d]])
}

/// Solves the discrete Lyapunov equation `S = J S J^T + Q` for a contracting J by doubling (R. A.
/// Smith, SIAM J. Appl. Math. 16 (1968) 198).
fn solve_lyapunov(jacobian: [[f64; 2]; 2], added: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let (mut sum, mut power) = (added, jacobian);
    // Each round doubles the number of summed terms; at most 2^40.
    for _ in 0..40 {
        let added = propagate_covariance(power, sum);
        if added[0][0] <= 1e-17 * sum[0][0] && added[1][1] <= 1e-17 * sum[1][1] {
            break;
        }
        for (row, added) in sum.iter_mut().zip(added) {
            row[0] += added[0];
            row[1] += added[1];
        }
        power = product(power, power);
    }
    sum
}

fn product([[a, b], [c, d]]: [[f64; 2]; 2], [[e, f], [g, h]]: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    [
        [a * e + b * g, a * f + b * h],
        [c * e + d * g, c * f + d * h],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::regime::exponent::{ExponentSettings, measure};

    #[test]
    fn doubled_orbit_exponents_match_a_long_orbit() {
        for (restitution, order) in [(0.2, 1), (0.5, 1), (0.5, 2)] {
            let cascade = Cascade::locate(restitution, order, 4).unwrap();
            for (n, orbit) in cascade.doubled_orbits().enumerate() {
                let orbit = orbit.unwrap();
                assert_eq!(orbit.impacts, 2 << n);
                assert!(orbit.multipliers.modulus() < 1.0, "{orbit:?}");
                let [larger, smaller] = orbit.exponents();
                assert!(larger >= smaller && larger < 0.0);
                let excess = larger + smaller - 2.0 * libm::log(restitution);
                assert!(excess.abs() < 1e-6, "{orbit:?}");
                // Independent method: mean growth of a tangent vector along the orbit.
                let map = Map::build(orbit.k, restitution).unwrap();
                let (settle, impacts) = (20_000, 64_000);
                let settings = ExponentSettings { settle, impacts };
                let measured = measure(&map, cascade.states[n], settings);
                let measured = measured.unwrap().per_impact;
                let error = (measured.value - larger).abs();
                // Complex multipliers rotate the tangent vector, over which growth is averaged.
                let bound = 2e-3 + 5.0 * measured.error;
                assert!(error < bound, "{orbit:?} {measured:?}");
            }
        }
    }

    /// docs/theory-real-parts.md#t10.2
    #[test]
    fn phase_of_a_locked_part_scatters_by_the_closed_form() {
        for [k, expected] in [
            [0.40, 0.0552],
            [0.41, 0.0368],
            [0.43, 0.0274],
            [0.46, 0.0256],
        ] {
            let map = Map::build(k, 0.2).unwrap();
            let lock = Lock::build(k, 0.2, 1).unwrap().unwrap();
            let impact = map.impact(lock.state());
            let tangent = Tangent::build(&map, lock.state(), &impact).unwrap();
            let kick = 0.02 * impact.next.velocity;
            let covariance = solve_lyapunov(tangent.jacobian, [[0.0; 2], [0.0, kick * kick]]);
            let deviation = libm::sqrt(covariance[0][0]);
            assert!((deviation - expected).abs() < 5e-5, "{k}: {deviation}");
            let (sum, trace) = (1.0 + 0.04, lock.trace());
            let closed = libm::sqrt(sum / ((1.0 - 0.04) * (sum * sum - trace * trace)));
            assert!((deviation / (TAU * 0.004 * closed) - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn gap_ratios_tend_to_feigenbaums_constant() {
        let cascade = Cascade::locate(0.2, 1, 8).unwrap();
        let references = [4.7273, 4.6826, 4.6710, 4.6697, 4.6693];
        for (ratio, reference) in cascade.ratios().zip(references) {
            assert!((ratio - reference).abs() < 2e-4, "{ratio} {reference}");
        }
        let limit = cascade.k_infinity().unwrap();
        assert!((limit.value - 0.358_723_3).abs() < 1e-7 && limit.error < 1e-9);
        // The extrapolation from fewer flips is within its stated error.
        for (restitution, order) in [(0.2, 1), (0.5, 1), (0.5, 2), (0.1, 1), (0.7, 1), (0.3, 3)] {
            let located = |doublings| Cascade::locate(restitution, order, doublings).unwrap();
            let best = located(8);
            assert_eq!(best.end(), CascadeEnd::Complete, "{restitution} {order}");
            let limit = best.k_infinity().unwrap();
            for doublings in 2..8 {
                let estimate = located(doublings).k_infinity().unwrap();
                let error = (estimate.value - limit.value).abs();
                let stated = estimate.error + limit.error;
                assert!(
                    error <= stated,
                    "{restitution} {order} {doublings} {estimate:?}"
                );
            }
        }
    }
}
