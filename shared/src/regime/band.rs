//! Bands of k in which parts lock to the drive, for one restitution and for a lot, in closed form
//! (docs/theory-bands.md#t5.2).

use core::f64::consts::PI;
use core::fmt;

use super::lock::{ContactTerms, accept_order, accept_restitution};
use crate::arithmetic::bisect;
use crate::feeder::{OutOfRange, Restitution};
use crate::impact::ContactTime;

/// k of the saddle-node bifurcation that creates the period-1 orbit (symbol k1, equation 15).
/// Restitution 0..1 (1 excluded), order 1..=100. Error within 4 ulp.
pub fn birth(restitution: f64, order: u32) -> Result<f64, OutOfRange> {
    let r = accept_order(order)?;
    let restitution = accept_restitution(restitution)?;
    Ok((1.0 + restitution) / ((1.0 - restitution) * PI * r))
}

/// k of the flip bifurcation of the period-1 orbit of `order` (symbol k2, equation 17a).
/// Restitution 0..1 (1 excluded), order 1..=100. Error within 4 ulp.
pub fn flip(restitution: f64, order: u32) -> Result<f64, OutOfRange> {
    let r = accept_order(order)?;
    let restitution = accept_restitution(restitution)?;
    let sum = 1.0 + restitution;
    let launch = PI * r * (1.0 - restitution) / sum;
    let turn = 2.0 * (1.0 + restitution * restitution) / (sum * sum);
    Ok(1.0 / libm::sqrt(launch * launch + turn * turn))
}

/// k1 and k2 (in this order) of the period-1 orbit of `order` with impacts that take time
/// (docs/theory-real-parts.md#t10.6).
///
/// At restitutions below about 0.02 the flight may touch the track earlier; k1 then falls as
/// [`first_return_edge`] does without a contact time.
pub fn edges_with_contact(
    restitution: f64,
    order: u32,
    contact: ContactTime,
) -> Result<[f64; 2], OutOfRange> {
    let high = first_return_edge(restitution, order)?;
    if contact.is_instant() {
        return Ok([high, flip(restitution, order)?]);
    }
    let terms = ContactTerms::new(restitution, f64::from(order), contact);
    let birth_ratio = high / birth(restitution, order)?;
    Ok([terms.birth() * birth_ratio, terms.flip()])
}

/// Highest k at which the flight of the period-1 orbit takes `order` cycles.
///
/// It is `k1`, or less at restitutions below about 0.02, where the part would touch the track just
/// after launch. Restitution 0..1 (1 excluded), order 1..=100. Relative error below 1e-14.
pub fn first_return_edge(restitution: f64, order: u32) -> Result<f64, OutOfRange> {
    let birth = birth(restitution, order)?;
    let slope = touching_slope(restitution, birth).max(0.0);
    Ok(birth / libm::sqrt(1.0 + slope * slope))
}

/// Restitution above which the flight touches the track at no k. The exact limits are lower: 0.0205
/// at order 1, about `3 / (16 pi^2 r^2)` at order r.
const MAX_TOUCHING_RESTITUTION: f64 = 0.03;

/// Tangent of the largest launch phase t0 at which the flight touches the track before `r` cycles;
/// negative if there is none.
///
/// With `k = k1 cos t0` the height over the track, `s` rad after launch, is
/// `sin t0 - sin(t0 + s) + k s (pi r - s/2)`. It is zero at `tan t0 = T(s)` with
/// `T(s) = (sin s - k1 s (pi r - s/2)) / (1 - cos s)`. So the flight touches where `tan t0` is at
/// most the maximum of `T`. Only `s < pi` matters: later the parabola is above the track's next
/// crest.
///
/// The maximum is found by fixed-point iteration.
fn touching_slope(restitution: f64, birth: f64) -> f64 {
    /// Taylor coefficients of (s - sin s)/s^3 in s^2. The next term is below 1e-15 of the sum at s
    /// = 0.6.
    const SINE_COEFFICIENTS: [f64; 6] = [
        1.0 / 6.0,
        -1.0 / 120.0,
        1.0 / 5_040.0,
        -1.0 / 362_880.0,
        1.0 / 39_916_800.0,
        -1.0 / 6_227_020_800.0,
    ];
    /// Taylor coefficients of (1 - cos s)/s^2 in s^2.
    const COSINE_COEFFICIENTS: [f64; 6] = [
        1.0 / 2.0,
        -1.0 / 24.0,
        1.0 / 720.0,
        -1.0 / 40_320.0,
        1.0 / 3_628_800.0,
        -1.0 / 479_001_600.0,
    ];
    if restitution == 0.0 {
        // The maximum is at s = 0.
        return birth;
    }
    if restitution > MAX_TOUCHING_RESTITUTION {
        return -1.0;
    }
    // pi r k1 = 1 + excess.
    let excess = 2.0 * restitution / (1.0 - restitution);
    let mut after = libm::sqrt(6.0 * excess);
    let mut slope = 0.0;
    // T'(s) = 0 is s^2 = excess / weight. The first error of T is 6e-5; each step divides it by
    // 700.
    for _ in 0..6 {
        let square = after * after;
        let (sine, sine_slope) = polynomial(&SINE_COEFFICIENTS, square);
        let (cosine, cosine_slope) = polynomial(&COSINE_COEFFICIENTS, square);
        slope = (0.5 * birth - after * sine - excess / after) / cosine;
        let weight = sine + 2.0 * square * sine_slope + 2.0 * after * slope * cosine_slope;
        after = libm::sqrt(excess / weight);
    }
    slope
}

/// Value and derivative of a polynomial, lowest coefficient first.
fn polynomial(coefficients: &[f64], x: f64) -> (f64, f64) {
    let horner = |(value, slope), c: &f64| (value * x + c, slope * x + value);
    coefficients.iter().rev().fold((0.0, 0.0), horner)
}

/// Band of k in which every part of a lot has a stable period-1 orbit of one order.
///
/// ```
/// use kband::feeder::Restitution;
/// use kband::regime::band::Band;
/// let band = Band::common(Restitution::interval(0.18, 0.22)?, 1)?;
/// assert!((band.low() - 0.4076).abs() < 1e-4 && (band.high() - 0.4581).abs() < 1e-4);
/// assert!(band.contains(band.setpoint()));
/// // Parts that differ too much share none.
/// assert!(Band::common(Restitution::interval(0.1, 0.3)?, 1).is_err());
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band {
    order: u32,
    low: f64,
    high: f64,
}

/// Error: the parts of a lot have no common band of this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoBand {
    /// Drive cycles per impact.
    pub order: u32,
    /// k below which the part of highest restitution flips (k2 of the high bound).
    pub flip: f64,
    /// k above which the part of lowest restitution has no such orbit (k1 of the low bound).
    pub birth: f64,
    /// With the low bound kept, a high bound of restitution below this value gives a band.
    pub high_bound: f64,
    /// With the high bound kept, a low bound of restitution above this value gives a band.
    pub low_bound: f64,
}

impl fmt::Display for NoBand {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            formatter,
            "no band of order {} for the whole interval: its liveliest part needs k > {:.4}, its deadest \
             k < {:.4}; a high bound of restitution below {:.4} or a low bound above {:.4} would allow it",
            self.order, self.flip, self.birth, self.high_bound, self.low_bound
        )
    }
}

impl core::error::Error for NoBand {}

/// Reason for a missing band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BandError {
    /// A parameter is out of range.
    OutOfRange(OutOfRange),
    /// The parameters are valid, but the bands of the parts do not overlap.
    Empty(NoBand),
}

impl From<OutOfRange> for BandError {
    fn from(refusal: OutOfRange) -> Self {
        Self::OutOfRange(refusal)
    }
}

impl fmt::Display for BandError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange(refusal) => refusal.fmt(formatter),
            Self::Empty(none) => none.fmt(formatter),
        }
    }
}

impl core::error::Error for BandError {}

/// Distances of a working point to one edge of a band, positive inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// Distance in k.
    pub k: f64,
    /// Distance in amplitude b, over the amplitude of the working point.
    pub amplitude: f64,
}

/// Distances of a working point to both edges of a band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// Distance to the low edge in k, the margin for a larger amplitude.
    pub low: Distance,
    /// Distance to the high edge in k, the margin for a smaller amplitude.
    pub high: Distance,
}

impl Margins {
    /// Smaller of the two relative distances in amplitude; negative outside the band.
    pub fn smallest(&self) -> f64 {
        self.low.amplitude.min(self.high.amplitude)
    }
}

impl Band {
    /// Common band `k2..k1` of all parts of `restitution` in lock `order`.
    ///
    /// Both edges grow with R. So the band runs from `k2` of the high bound to `k1` of the low
    /// bound, limited by [`first_return_edge`].
    pub fn common(restitution: Restitution, order: u32) -> Result<Self, BandError> {
        Self::common_with_contact(restitution, order, ContactTime::INSTANT)
    }

    /// [`Band::common`] with impacts that take time, which the bounds in the error neglect.
    pub fn common_with_contact(
        restitution: Restitution,
        order: u32,
        contact: ContactTime,
    ) -> Result<Self, BandError> {
        let [_, low] = edges_with_contact(restitution.high(), order, contact)?;
        let [high, _] = edges_with_contact(restitution.low(), order, contact)?;
        if low < high {
            return Ok(Self { order, low, high });
        }
        let flips_below = |r| flip(r, order).is_ok_and(|flip| flip < high);
        let (lowest, highest) = (restitution.low(), restitution.high());
        let [high_bound, _] = bisect(lowest, highest, 60, flips_below);
        // Equation 15 solved for R.
        let launch = PI * f64::from(order) * low;
        let low_bound = ((launch - 1.0) / (launch + 1.0)).max(0.0);
        Err(BandError::Empty(NoBand {
            order,
            flip: low,
            birth: high,
            high_bound,
            low_bound,
        }))
    }

    /// Drive cycles per impact (symbol r).
    pub fn order(&self) -> u32 {
        self.order
    }

    /// Low edge in k, at which the part of highest restitution flips to twice its period.
    pub fn low(&self) -> f64 {
        self.low
    }

    /// High edge in k, above which the part of lowest restitution has no such orbit.
    pub fn high(&self) -> f64 {
        self.high
    }

    /// Whether `k` lies strictly inside.
    pub fn contains(&self, k: f64) -> bool {
        self.low < k && k < self.high
    }

    /// k with the largest margin: its amplitude is the mean of the amplitudes at the edges.
    pub fn setpoint(&self) -> f64 {
        2.0 / (1.0 / self.low + 1.0 / self.high)
    }

    /// Distances of `k` to both edges.
    pub fn margins(&self, k: f64) -> Margins {
        let distance = |k, amplitude| Distance { k, amplitude };
        Margins {
            low: distance(k - self.low, k / self.low - 1.0),
            high: distance(self.high - k, 1.0 - k / self.high),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::lock::Lock;
    use super::*;

    fn lock(k: f64, restitution: f64, order: u32) -> Lock {
        Lock::build(k, restitution, order).unwrap().unwrap()
    }

    #[test]
    fn multiplier_is_1_at_birth_and_minus_1_at_flip() {
        for restitution in [0.05, 0.2, 0.5, 0.8, 0.95] {
            for order in [1, 2, 5] {
                let square = restitution * restitution;
                let at = |k| lock(k, restitution, order);
                let k2 = flip(restitution, order).unwrap();
                assert!((at(k2).trace() + 1.0 + square).abs() < 1e-12);
                // t0 varies as the square root of k1 - k.
                let k1 = birth(restitution, order).unwrap();
                let error = at(k1 * (1.0 - 1e-12)).trace() - 1.0 - square;
                assert!(error.abs() < 1e-5 / k1.min(1.0));
                for step in 1..20 {
                    assert!(at(k2 + (k1 - k2) * f64::from(step) / 20.0).attracts());
                }
                assert!(!at(k2 * 0.999).attracts());
            }
        }
    }

    #[test]
    fn wide_lot_error_names_the_lots_with_a_band() {
        let wide = Restitution::interval(0.1, 0.3).unwrap();
        let Err(BandError::Empty(none)) = Band::common(wide, 1) else {
            panic!("R in 0.1..0.3 has no common band");
        };
        // The bands are [0.326, 0.389] and [0.470, 0.591] (docs/theory-bands.md#t5.4).
        assert!((none.flip - 0.470).abs() < 1e-3 && (none.birth - 0.389).abs() < 1e-3);
        for (low, high, exists) in [
            (0.1, none.high_bound - 1e-9, true),
            (0.1, none.high_bound + 1e-9, false),
            (none.low_bound + 1e-9, 0.3, true),
            (none.low_bound - 1e-9, 0.3, false),
        ] {
            let lot = Restitution::interval(low, high).unwrap();
            assert_eq!(Band::common(lot, 1).is_ok(), exists, "{low}..{high}");
        }
    }

    #[test]
    fn common_band_is_inside_the_band_of_each_part() {
        let lots = [
            (0.0, 0.01),
            (0.18, 0.22),
            (0.28, 0.32),
            (0.48, 0.52),
            (0.7, 0.8),
        ];
        for (low, high) in lots {
            let lot = Restitution::interval(low, high).unwrap();
            for order in [1, 2, 3] {
                let Ok(band) = Band::common(lot, order) else {
                    assert!(order > 1, "{low}..{high}");
                    continue;
                };
                assert_eq!(band.order(), order);
                let k = band.setpoint();
                let margins = band.margins(k);
                assert!((margins.low.amplitude - margins.high.amplitude).abs() < 1e-14);
                assert!(band.contains(k) && margins.smallest() > 0.0);
                for step in 0..=10 {
                    let restitution = low + (high - low) * f64::from(step) / 10.0;
                    for k in [band.low() * (1.0 + 1e-9), k, band.high() * (1.0 - 1e-9)] {
                        let lock = lock(k, restitution, order);
                        assert!(lock.attracts() && lock.is_first_return(), "{lock:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn edge_matches_the_first_touch_of_the_map() {
        let (mut touching, mut worst) = (0, 0.0_f64);
        for order in 1..=100 {
            let r = f64::from(order);
            // Half of the grid is where this order can touch, half the whole range.
            let limit = 0.0205 / (r * r);
            let grid = (0..60).flat_map(|n| [limit * f64::from(n) / 60.0, f64::from(n) / 2000.0]);
            for restitution in grid {
                let edge = first_return_edge(restitution, order).unwrap();
                let k1 = birth(restitution, order).unwrap();
                let flown = |k| lock(k, restitution, order).is_first_return();
                // Closer to k1 the rounding of t0 dominates.
                let (low, high) = (flip(restitution, order).unwrap(), k1 * (1.0 - 1e-9));
                if flown(high) {
                    assert!(edge > high, "R {restitution} order {order}");
                    continue;
                }
                let [low, _] = bisect(low, high, 60, flown);
                touching += 1;
                worst = worst.max((edge / low - 1.0).abs());
            }
        }
        assert!(touching > 5000 && worst < 1e-9, "{touching} {worst}");
    }
}
