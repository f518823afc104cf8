//! The period doublings below a band, located on the exact map.

use core::f64::consts::TAU;

use heapless::Vec;

use super::band;
use super::lock::{Lock, Multipliers, accept_order, accept_restitution};
use super::spread;
use super::wave_band::{Bifurcation, WaveBands};
use crate::feeder::{OutOfRange, accept};
use crate::impact::{Impact, Kernel, Map, PartState, Tangent, Wave, WaveMap};

/// Feigenbaum's constant: the limit of the ratio of successive gaps between doublings.
pub const FEIGENBAUM: f64 = 4.669_201_609_102_99;

/// Most doublings that are located; the gap to the next is then about 1e-7 of the first.
pub const HIGHEST_DOUBLINGS: usize = 10;

/// Why a cascade has no more flips.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CascadeEnd {
    /// As many were located as were asked for.
    Complete,
    /// The doubled orbit could not be followed to its flip: it loses a flight (nearly dead parts come to
    /// rest within it) or the gaps have come down to rounding.
    Lost,
}

/// An extrapolated value with the error to be expected of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Its error, one-sided: a bound that held in every case that was checked.
    pub error: f64,
}

/// The orbit that a flip gives birth to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DoubledOrbit {
    /// k in the middle of its window.
    pub k: f64,
    /// Impacts after which it repeats.
    pub impacts: u32,
    /// Floquet multipliers of once around it; their product is R to twice the power of its impacts.
    pub multipliers: Multipliers,
}

impl DoubledOrbit {
    /// Both Lyapunov exponents per impact, the larger first: `ln |multiplier|` over the impacts; their sum is 2 ln R.
    #[must_use]
    pub fn exponents(&self) -> [f64; 2] {
        let sizes = match self.multipliers {
            Multipliers::Real(larger, smaller) => [larger, smaller],
            Multipliers::Pair { modulus, .. } => [modulus; 2],
        };
        sizes.map(|size| libm::log(libm::fabs(size)) / f64::from(self.impacts))
    }
}

/// The flips 1 -> 2 -> 4 -> ... of the period-1 orbit of one order as k falls.
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
    flips: Vec<f64, HIGHEST_DOUBLINGS>,
    /// The orbit at each of them.
    states: Vec<PartState, HIGHEST_DOUBLINGS>,
    end: CascadeEnd,
    birth: f64,
    track: Track,
    order: u32,
}

/// What parts fly over.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Track {
    Sine { restitution: f64 },
    Tones { wave: Wave, restitution: f64 },
}

/// The map on it.
#[expect(
    clippy::large_enum_variant,
    reason = "one at a time lives, and without an allocator there is no box"
)]
enum Over {
    Sine(Map),
    Tones(WaveMap),
}

impl Track {
    fn at(&self, k: f64) -> Option<Over> {
        match *self {
            Self::Sine { restitution } => Map::build(k, restitution).ok().map(Over::Sine),
            Self::Tones { wave, restitution } => {
                WaveMap::on(wave, k, restitution).ok().map(Over::Tones)
            }
        }
    }

    fn restitution(&self) -> f64 {
        match *self {
            Self::Sine { restitution } | Self::Tones { restitution, .. } => restitution,
        }
    }
}

impl Over {
    fn impact(&self, state: PartState) -> Impact<PartState> {
        match self {
            Self::Sine(map) => map.impact(state),
            Self::Tones(map) => map.impact(state),
        }
    }

    fn tangent(&self, state: PartState, impact: &Impact<PartState>) -> Option<Tangent> {
        match self {
            Self::Sine(map) => Tangent::of(map, state, impact),
            Self::Tones(map) => Tangent::on_tones(map, state, impact),
        }
    }
}

impl Cascade {
    /// Locates `doublings` flips (1..=10) for a restitution of 0..1 (1 excluded) and an order of 1..=100.
    ///
    /// The first is equation (17a). Each further orbit is found by Newton with the tangent map and
    /// carried along k, bordered by the condition that a multiplier is -1, `1 + trace + R^(2N) = 0`, with
    /// the derivative by k for the orbit and the secant rule for the condition.
    /// Measured against 40-digit references for R = 0.2 and 0.5: within 2e-14 of k.
    pub fn locate(restitution: f64, order: u32, doublings: usize) -> Result<Self, OutOfRange> {
        accept_order(order)?;
        accept_restitution(restitution)?;
        accept(
            "doublings",
            doublings as f64,
            (1..=HIGHEST_DOUBLINGS).contains(&doublings),
            "1..10",
        )?;
        let flip = band::flip(restitution, order)?;
        let cascade = Self {
            flips: Vec::from_array([flip]),
            states: Vec::new(),
            end: CascadeEnd::Complete,
            birth: band::birth(restitution, order)?,
            track: Track::Sine { restitution },
            order,
        };
        let Some(lock) = Lock::at(flip, restitution, order)? else {
            return Ok(cascade);
        };
        Ok(cascade.followed(lock.state(), doublings))
    }

    /// The same on a track of several tones, below the band with the highest k of those that end in a flip; `None`
    /// where no band does.
    pub fn on_tones(
        wave: &Wave,
        restitution: f64,
        order: u32,
        doublings: usize,
    ) -> Result<Option<Self>, OutOfRange> {
        accept(
            "doublings",
            doublings as f64,
            (1..=HIGHEST_DOUBLINGS).contains(&doublings),
            "1..10",
        )?;
        let bands = WaveBands::of(wave, restitution, order)?;
        let flips = |band: &super::wave_band::WaveBand| band.low.bifurcation == Bifurcation::Flip;
        let Some(band) = bands.iter().find(flips) else {
            return Ok(None);
        };
        let flip = band.low.k;
        let cascade = Self {
            flips: Vec::from_array([flip]),
            states: Vec::new(),
            end: CascadeEnd::Complete,
            birth: band.high.k,
            track: Track::Tones {
                wave: *wave,
                restitution,
            },
            order,
        };
        let state = PartState {
            phase: band.low.phase,
            velocity: TAU * f64::from(order) * flip * restitution / (1.0 + restitution),
        };
        Ok(Some(cascade.followed(state, doublings)))
    }

    /// The flips after the first one, on the orbit that `state` is on there.
    fn followed(mut self, mut state: PartState, doublings: usize) -> Self {
        // There is room for as many as may be asked for.
        let _ = self.states.push(state);
        while self.flips.len() < doublings {
            let inside = self.inside();
            let flip = self.flips.last().copied().unwrap_or(self.birth);
            let Some((next, orbit)) = self.walker().next_flip(flip, inside, state) else {
                self.end = CascadeEnd::Lost;
                break;
            };
            let _ = self.flips.push(next);
            let _ = self.states.push(orbit);
            state = orbit;
        }
        self
    }

    /// How far below the last flip the next orbit is begun: well above its own flip.
    fn inside(&self) -> f64 {
        match self.flips.as_slice() {
            [.., before, flip] => 0.35 * (before - flip) / FEIGENBAUM,
            // The first gap is not known: 0.2 % of k is well inside it for every R and order.
            [flip] => 2e-3 * flip,
            [] => 0.0,
        }
    }

    /// The orbit born at the last flip.
    fn walker(&self) -> Walker {
        self.walker_after(self.flips.len())
    }

    fn walker_after(&self, flips: usize) -> Walker {
        let impacts = 1_u32 << flips;
        Walker {
            track: self.track,
            impacts,
            turns: f64::from(self.order) * f64::from(impacts),
        }
    }

    /// The largest scatter of restitution (standard deviation over the mean, symbol sigma) at which each doubling can
    /// still be seen in the phases, `None` where its orbit could not be followed.
    ///
    /// In the middle of its window (the last one's width by Feigenbaum's law) each of the orbit's phases spreads in
    /// proportion to sigma; seen is a doubling while some two phases that it parted are farther apart than the sum of their standard
    /// deviations. Each further one needs 6.62 times less (Crutchfield, Nauenberg & Rudnick 1981).
    pub fn visible_below(&self) -> impl Iterator<Item = Option<f64>> + '_ {
        (0..self.flips.len()).map(|n| {
            let (walker, k, state) = self.middle(n)?;
            walker.parted(k, state)
        })
    }

    /// The orbit that each flip gives birth to, in the middle of its window, `None` where it could not be followed.
    pub fn doubled(&self) -> impl Iterator<Item = Option<DoubledOrbit>> + '_ {
        (0..self.flips.len()).map(|n| {
            let (walker, k, state) = self.middle(n)?;
            let map = self.track.at(k)?;
            let [[a, _], [_, d]] = walker.around(&map, state)?.jacobian;
            // Each impact has the determinant R^2 psi/psi' (of which a difference of large products would leave nothing).
            let impacts = walker.impacts;
            let determinant = libm::pow(self.track.restitution(), 2.0 * f64::from(impacts));
            Some(DoubledOrbit {
                k,
                impacts,
                multipliers: Multipliers::of(a + d, determinant),
            })
        })
    }

    /// The orbit born at a flip in the middle between it and the next, the last one's window by Feigenbaum's law.
    fn middle(&self, n: usize) -> Option<(Walker, f64, PartState)> {
        let gap = match (self.flips.get(n + 1), n.checked_sub(1)) {
            (Some(next), _) => self.flips[n] - next,
            (None, Some(before)) => (self.flips[before] - self.flips[n]) / FEIGENBAUM,
            (None, None) => 4e-3 * self.flips[n],
        };
        let walker = self.walker_after(n + 1);
        let k = self.flips[n] - 0.5 * gap;
        let near = walker.attracted(k, *self.states.get(n)?)?;
        let state = walker.solve(k, near)?;
        Some((walker, k, state))
    }

    /// k of the flips, the 1 -> 2 flip first, falling.
    #[must_use]
    pub fn flips(&self) -> &[f64] {
        &self.flips
    }

    /// Why there are no more.
    #[must_use]
    pub fn end(&self) -> CascadeEnd {
        self.end
    }

    /// Ratios of successive gaps between flips; they tend to [`FEIGENBAUM`].
    pub fn ratios(&self) -> impl Iterator<Item = f64> + '_ {
        self.flips()
            .windows(3)
            .map(|three| (three[0] - three[1]) / (three[1] - three[2]))
    }

    /// k where the doublings accumulate and chaos begins, extrapolated with Feigenbaum's constant;
    /// `None` below two flips.
    #[must_use]
    pub fn k_infinity(&self) -> Option<Estimate> {
        let extrapolate = |n: usize| {
            let (before, last) = (self.flips[n - 2], self.flips[n - 1]);
            last - (before - last) / (FEIGENBAUM - 1.0)
        };
        match self.flips.len() {
            0 | 1 => None,
            2 => {
                // The first gap is out of proportion by 1 % at R = 0.2, by 40 % at R = 0.9.
                let value = extrapolate(2);
                Some(Estimate {
                    value,
                    error: 0.4 * (self.flips[1] - value),
                })
            }
            n => {
                let value = extrapolate(n);
                Some(Estimate {
                    value,
                    error: libm::fabs(value - extrapolate(n - 1)) + 4.0 * f64::EPSILON * value,
                })
            }
        }
    }

    /// k1 of the order, where the cascade's orbit is born.
    #[must_use]
    pub fn birth(&self) -> f64 {
        self.birth
    }
}

/// An orbit of `impacts` impacts in `turns` drive cycles, followed over k.
struct Walker {
    track: Track,
    impacts: u32,
    turns: f64,
}

impl Walker {
    /// The next flip below `flip` and the orbit there, begun `inside` below it.
    fn next_flip(&self, flip: f64, inside: f64, state: PartState) -> Option<(f64, PartState)> {
        let mut k = flip - inside;
        let mut state = self.solve(k, self.attracted(k, state)?)?;
        let mut condition = self.condition(k, state)?;
        // At its birth the doubled orbit has a multiplier of 1.
        let square = libm::pow(self.track.restitution(), 2.0 * f64::from(self.impacts));
        let mut slope = (2.0 * (1.0 + square) - condition) / inside;
        for _ in 0..60 {
            // The condition is nearly linear in k, falling to 0 at the flip.
            let most = 0.5 * inside.max(flip - k);
            let mut step = (-condition / slope).clamp(-most, most);
            let drift = self.drift(k, state)?;
            // A step that lands on another orbit, one on which the condition has not moved towards 0, is
            // halved.
            let (next, orbit, value) = loop {
                let next = k + step;
                let small = libm::fabs(step) <= 1e-9 * k;
                let ahead = Map::state(
                    state.phase + drift.0 * step,
                    (state.velocity + drift.1 * step).max(0.0),
                )
                .ok()?;
                let found = self
                    .solve(next, ahead)
                    .and_then(|orbit| Some((next, orbit, self.condition(next, orbit)?)));
                match found {
                    Some(found) if small || libm::fabs(found.2) < libm::fabs(condition) => {
                        break found;
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
            // Near the end rounding makes nonsense of the difference.
            if libm::fabs(step) > 1e-9 * k {
                slope = new_slope;
            }
            if slope <= 0.0 || !slope.is_finite() {
                return None;
            }
        }
        // The steps wander within the rounding of the condition.
        (libm::fabs(condition / slope) < 1e-13 * k).then_some((k, state))
    }

    /// Where the attracting orbit is after long enough, begun near the orbit that flipped.
    fn attracted(&self, k: f64, state: PartState) -> Option<PartState> {
        let map = self.track.at(k)?;
        let mut state =
            Map::state(state.phase + 1e-3 / f64::from(self.impacts), state.velocity).ok()?;
        for _ in 0..(2000 + 200 * self.impacts) {
            let impact = map.impact(state);
            if impact.flight <= 0.0 {
                return None;
            }
            state = impact.next;
        }
        Some(state)
    }

    /// The orbit at `k` by Newton from `state`.
    fn solve(&self, k: f64, state: PartState) -> Option<PartState> {
        let map = self.track.at(k)?;
        let mut state = state;
        let mut last = f64::INFINITY;
        for _ in 0..30 {
            let Around {
                missing: (x, y),
                jacobian: [[a, b], [c, d]],
                ..
            } = self.around(&map, state)?;
            // (J - 1) (dt, dpsi) = -(x, y)
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

    /// How the orbit moves with k: `(1 - J)^-1` times the derivative of once around by k.
    fn drift(&self, k: f64, state: PartState) -> Option<(f64, f64)> {
        let map = self.track.at(k)?;
        let Around {
            by_k: [x, y],
            jacobian: [[a, b], [c, d]],
            ..
        } = self.around(&map, state)?;
        let determinant = (1.0 - a) * (1.0 - d) - b * c;
        let drift = (
            ((1.0 - d) * x + b * y) / determinant,
            (c * x + (1.0 - a) * y) / determinant,
        );
        (drift.0.is_finite() && drift.1.is_finite()).then_some(drift)
    }

    /// `1 + trace + determinant`: 0 where a multiplier is -1.
    fn condition(&self, k: f64, state: PartState) -> Option<f64> {
        let map = self.track.at(k)?;
        let [[a, b], [c, d]] = self.around(&map, state)?.jacobian;
        let value = 1.0 + a + d + (a * d - b * c);
        value.is_finite().then_some(value)
    }

    /// The relative scatter of restitution up to which the halves of the orbit are told apart.
    fn parted(&self, k: f64, start: PartState) -> Option<f64> {
        const MOST: usize = 1 << HIGHEST_DOUBLINGS;
        let map = self.track.at(k)?;
        let around = self.around(&map, start)?;
        let step = |state: PartState, covariance: [[f64; 2]; 2]| {
            let impact = map.impact(state);
            let jacobian = map.tangent(state, &impact)?.jacobian;
            let mut then = spread::carried(jacobian, covariance);
            then[1][1] += impact.next.velocity * impact.next.velocity;
            Some((impact.next, then))
        };
        // What one turn around adds, and its sum over all turns before.
        let (mut state, mut covariance) = (start, [[0.0; 2]; 2]);
        for _ in 0..self.impacts {
            (state, covariance) = step(state, covariance)?;
        }
        let mut covariance = spread::summed(around.jacobian, covariance);
        let mut state = start;
        let mut phases: Vec<(f64, f64), MOST> = Vec::new();
        for _ in 0..self.impacts {
            (state, covariance) = step(state, covariance)?;
            phases
                .push((state.phase, libm::sqrt(covariance[0][0])))
                .ok()?;
        }
        let (first, second) = phases.split_at(phases.len() / 2);
        let most = first.iter().zip(second).fold(0.0_f64, |most, (a, b)| {
            let apart = a.0 - b.0;
            let apart = libm::fabs(apart - TAU * libm::round(apart / TAU));
            most.max(apart / (a.1 + b.1))
        });
        (most > 0.0).then_some(most)
    }

    /// Once around.
    fn around(&self, map: &Over, start: PartState) -> Option<Around> {
        let mut state = start;
        let mut product = [[1.0, 0.0], [0.0, 1.0]];
        let mut by_k = [0.0, 0.0];
        let mut flights = 0.0;
        for _ in 0..self.impacts {
            let impact = map.impact(state);
            if impact.flight <= 0.0 {
                return None;
            }
            let tangent = map.tangent(state, &impact)?;
            let [[a, b], [c, d]] = tangent.jacobian;
            let [[e, f], [g, h]] = product;
            product = [
                [a * e + b * g, a * f + b * h],
                [c * e + d * g, c * f + d * h],
            ];
            let [x, y] = by_k;
            by_k = [
                a * x + b * y + tangent.by_k[0],
                c * x + d * y + tangent.by_k[1],
            ];
            flights += impact.flight;
            state = impact.next;
        }
        // An orbit that closes after another number of turns is not this one.
        if libm::fabs(flights - TAU * self.turns) > 1.0 {
            return None;
        }
        let apart = state.phase - start.phase;
        Some(Around {
            missing: (
                apart - TAU * libm::round(apart / TAU),
                state.velocity - start.velocity,
            ),
            jacobian: product,
            by_k,
        })
    }
}

/// An orbit once around.
struct Around {
    /// What is missing to closure, in phase and velocity.
    missing: (f64, f64),
    jacobian: [[f64; 2]; 2],
    /// Derivative of the end by k.
    by_k: [f64; 2],
}

#[cfg(test)]
mod tests {
    use super::*;

    /// docs/theory-bands.md#t6.1 (40-digit continuation), with the two entries whose last digits are
    /// misprinted there corrected from (17a) and by recomputation.
    const FLIPS: [(f64, u32, &[f64]); 3] = [
        (
            0.2,
            1,
            &[
                0.393_052_167_586_172_9,
                0.366_000_656_686_421_4,
                0.360_278_291_826_409_36,
                0.359_056_247_737_207_4,
                0.358_794_621_746_470_14,
                0.358_738_595_215_785_3,
            ],
        ),
        (
            0.5,
            1,
            &[
                0.654_954_465_050_574_4,
                0.599_833_008_612_775_9,
                0.589_351_336_330_444_9,
                0.587_136_821_342_355_8,
                0.586_662_875_705_115_3,
                0.586_561_364_035_089_2,
            ],
        ),
        (
            0.5,
            2,
            &[
                0.421_784_812_671_680_55,
                0.406_784_778_021_891_2,
                0.403_821_877_710_445_6,
                0.403_185_960_263_948_7,
                0.403_049_584_204_998_5,
            ],
        ),
    ];

    #[test]
    fn a_doubled_orbit_attracts_in_its_window_and_its_exponents_are_those_of_a_long_orbit() {
        use crate::regime::exponent::{ExponentSettings, measure};
        for (restitution, order) in [(0.2, 1), (0.5, 1), (0.5, 2)] {
            let cascade = Cascade::locate(restitution, order, 4).unwrap();
            for (n, orbit) in cascade.doubled().enumerate() {
                let orbit = orbit.unwrap();
                assert_eq!(orbit.impacts, 2 << n);
                assert!(orbit.multipliers.modulus() < 1.0, "{orbit:?}");
                let [larger, smaller] = orbit.exponents();
                assert!(larger >= smaller && larger < 0.0);
                assert!(
                    (larger + smaller - 2.0 * libm::log(restitution)).abs() < 1e-6,
                    "{orbit:?}"
                );
                // Another way: the mean growth of a tangent along the orbit.
                let map = Map::build(orbit.k, restitution).unwrap();
                let settings = ExponentSettings {
                    settle: 20_000,
                    impacts: 64_000,
                };
                let measured = measure(&map, cascade.states[n], settings)
                    .unwrap()
                    .per_impact;
                // Multipliers that are a pair turn the tangent, whose growth is a mean over the turns.
                assert!(
                    (measured.value - larger).abs() < 2e-3 + 5.0 * measured.error,
                    "{orbit:?} {measured:?}"
                );
            }
        }
    }

    #[test]
    fn flips_are_the_references() {
        for (restitution, order, flips) in FLIPS {
            let cascade = Cascade::locate(restitution, order, flips.len()).unwrap();
            assert_eq!(cascade.end(), CascadeEnd::Complete);
            for (found, reference) in cascade.flips().iter().zip(flips) {
                assert!(
                    (found - reference).abs() < 1e-12,
                    "R {restitution} {found} {reference}"
                );
            }
        }
    }

    #[test]
    fn ratios_tend_to_feigenbaums_constant_and_the_limit_holds_its_error() {
        let cascade = Cascade::locate(0.2, 1, 8).unwrap();
        for (ratio, reference) in cascade
            .ratios()
            .zip([4.7273, 4.6826, 4.6710, 4.6697, 4.6693])
        {
            assert!((ratio - reference).abs() < 2e-4, "{ratio} {reference}");
        }
        let limit = cascade.k_infinity().unwrap();
        assert!((limit.value - 0.358_723_3).abs() < 1e-7 && limit.error < 1e-9);
        // The limit from fewer flips is as far off as it says.
        for (restitution, order) in [(0.2, 1), (0.5, 1), (0.5, 2), (0.1, 1), (0.7, 1), (0.3, 3)] {
            let best = Cascade::locate(restitution, order, 8).unwrap();
            assert_eq!(
                best.end(),
                CascadeEnd::Complete,
                "R {restitution} r {order}"
            );
            let limit = best.k_infinity().unwrap();
            for doublings in 2..8 {
                let estimate = Cascade::locate(restitution, order, doublings)
                    .unwrap()
                    .k_infinity()
                    .unwrap();
                assert!(
                    (estimate.value - limit.value).abs() <= estimate.error + limit.error,
                    "R {restitution} r {order}: {doublings} flips {estimate:?} {limit:?}"
                );
            }
        }
    }

    #[test]
    fn each_doubling_is_seen_at_six_times_less_scatter_than_the_one_before() {
        let cascade = Cascade::locate(0.2, 1, 7).unwrap();
        let seen: std::vec::Vec<f64> = cascade.visible_below().map(Option::unwrap).collect();
        std::println!("{seen:?}");
        // Crutchfield, Nauenberg & Rudnick (1981): 6.619 in the mean; which two phases part most differs from window to
        // window.
        let mean = libm::pow(seen[1] / seen[5], 0.25);
        assert!((mean - 6.62).abs() < 0.5, "{mean} {seen:?}");
        assert!(
            seen.windows(2).all(|pair| pair[0] / pair[1] > 5.0),
            "{seen:?}"
        );
    }

    /// The flips of several tones are where a multiplier of the map itself is -1, and one tone's are the sine's.
    #[test]
    fn several_tones_double_as_one() {
        let sine = Cascade::on_tones(&Wave::sine(), 0.2, 1, 5)
            .unwrap()
            .unwrap();
        let one = Cascade::locate(0.2, 1, 5).unwrap();
        for (a, b) in sine.flips().iter().zip(one.flips()) {
            assert!((a - b).abs() < 1e-10, "{a} {b}");
        }
        let second = crate::impact::Tone {
            amplitude: 0.1,
            angle: 2.487,
        };
        let wave = Wave::build(second, crate::impact::Tone::default()).unwrap();
        let cascade = Cascade::on_tones(&wave, 0.2, 1, 6).unwrap().unwrap();
        assert_eq!(cascade.end(), CascadeEnd::Complete);
        let ratios: std::vec::Vec<f64> = cascade.ratios().collect();
        std::println!("{:?} {ratios:?}", cascade.flips());
        assert!(
            (ratios.last().unwrap() - FEIGENBAUM).abs() < 0.02,
            "{ratios:?}"
        );
    }

    #[test]
    fn nearly_dead_parts_end_their_cascade_honestly() {
        for restitution in [0.0, 1e-6, 1e-3, 0.01] {
            let cascade = Cascade::locate(restitution, 1, 6).unwrap();
            assert!(!cascade.flips().is_empty());
            for pair in cascade.flips().windows(2) {
                assert!(pair[1] < pair[0]);
            }
            assert_eq!(
                cascade.end() == CascadeEnd::Complete,
                cascade.flips().len() == 6
            );
        }
    }

    #[test]
    fn refusals_name_the_parameter() {
        assert_eq!(
            Cascade::locate(0.2, 1, 0).unwrap_err().parameter,
            "doublings"
        );
        assert_eq!(
            Cascade::locate(0.2, 1, 11).unwrap_err().parameter,
            "doublings"
        );
        assert_eq!(
            Cascade::locate(1.0, 1, 3).unwrap_err().parameter,
            "restitution"
        );
    }
}
