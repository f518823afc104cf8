//! Acceleration by the drive: up to three harmonics and a constant, integrated in closed form.
//!
//! The first zero is found by steps that a bound of the second derivative limits, see
//! docs/theory-impacts.md#t3.3.

use crate::arithmetic::{bisect, sine_cosine};
use crate::impact::wave::Wave;

const HARMONICS: usize = 3;

/// `sum over n of (sine_n sin(n tau) + cosine_n cos(n tau)) - constant`, in `b w^2`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Push {
    sine: [f64; HARMONICS],
    cosine: [f64; HARMONICS],
    constant: f64,
    /// Harmonics from this one on are zero.
    count: usize,
}

impl Push {
    /// `amplitude A(tau + lead) - constant`, with `A = -S''` of the track's motion S.
    pub(super) fn new(wave: &Wave, amplitude: f64, lead: f64, constant: f64) -> Self {
        let mut push = Self {
            constant,
            ..Self::default()
        };
        for (n, tone) in wave.tones() {
            let index = n as usize - 1;
            let (sine, cosine) = sine_cosine(n * lead + tone.angle);
            let size = amplitude * n * n * tone.amplitude;
            push.sine[index] = size * cosine;
            push.cosine[index] = size * sine;
            push.count = push.count.max(index + 1);
        }
        push
    }

    /// `self + factor other`.
    pub(super) fn plus(&self, factor: f64, other: &Self) -> Self {
        let sum = |a: [f64; HARMONICS], b: [f64; HARMONICS]| {
            core::array::from_fn(|n| a[n] + factor * b[n])
        };
        Self {
            sine: sum(self.sine, other.sine),
            cosine: sum(self.cosine, other.cosine),
            constant: self.constant + factor * other.constant,
            count: self.count.max(other.count),
        }
    }

    /// The harmonics: number, coefficients.
    fn tones(&self) -> impl Iterator<Item = (f64, f64, f64)> + '_ {
        (0..self.count).map(|n| (n as f64 + 1.0, self.sine[n], self.cosine[n]))
    }

    pub(super) fn at(&self, phase: f64) -> f64 {
        let tones = self.tones().map(|(n, p, q)| {
            let (sine, cosine) = sine_cosine(n * phase);
            p * sine + q * cosine
        });
        tones.sum::<f64>() - self.constant
    }

    pub(super) fn slope(&self, phase: f64) -> f64 {
        let tones = self.tones().map(|(n, p, q)| {
            let (sine, cosine) = sine_cosine(n * phase);
            n * (p * cosine - q * sine)
        });
        tones.sum()
    }

    /// Velocity gained in `d` rad from `phase` on.
    pub(super) fn velocity(&self, phase: f64, d: f64) -> f64 {
        let tones = self.tones().map(|(n, p, q)| {
            let half = 0.5 * n * d;
            let (sine, cosine) = sine_cosine(n * phase + half);
            2.0 / n * libm::sin(half) * (p * sine + q * cosine)
        });
        tones.sum::<f64>() - self.constant * d
    }

    /// Distance and [velocity](Push::velocity) gained in `d` rad from `phase` on.
    pub(super) fn integrals(&self, phase: f64, d: f64) -> (f64, f64) {
        let (mut displacement, mut gained) = (-0.0, -0.0);
        for (n, p, q) in self.tones() {
            let (sine, cosine) = sine_cosine(n * phase);
            let half = 0.5 * n * d;
            let (chord, arc) = sine_cosine(half);
            let x = n * d;
            let even = versine(half, chord);
            let odd = x * sagitta(x, 2.0 * chord * arc);
            displacement += p * (sine * even + cosine * odd) + q * (cosine * even - sine * odd);
            // Sine and cosine at the middle of the flight.
            let (sine, cosine) = (sine * arc + cosine * chord, cosine * arc - sine * chord);
            gained += 2.0 / n * chord * (p * sine + q * cosine);
        }
        let distance = d * d * (displacement - 0.5 * self.constant);
        (distance, gained - self.constant * d)
    }

    /// Distance and velocity after `d` rad from `phase` on, of a part that begins with `velocity`.
    pub(super) fn advance(&self, phase: f64, d: f64, velocity: f64) -> (f64, f64) {
        let (distance, gained) = self.integrals(phase, d);
        (velocity * d + distance, velocity + gained)
    }

    /// Maximum in a turn, within 1e-12 of its size.
    pub(super) fn maximum(&self) -> f64 {
        /// Number of phases between which the push of three harmonics has at most one maximum.
        const SCANNED_PHASES: u32 = 256;
        let step = core::f64::consts::TAU / f64::from(SCANNED_PHASES);
        let mut highest = f64::NEG_INFINITY;
        for n in 0..SCANNED_PHASES {
            let (low, high) = (f64::from(n) * step, f64::from(n + 1) * step);
            highest = highest.max(self.at(low));
            if self.slope(low) > 0.0 && self.slope(high) <= 0.0 {
                let [top, _] = bisect(low, high, 40, |phase| self.slope(phase) > 0.0);
                highest = highest.max(self.at(top));
            }
        }
        highest
    }

    /// Bound of the derivative of this order.
    pub(super) fn bound(&self, order: i32) -> f64 {
        let power = |n: f64| (0..order).fold(1.0, |power, _| power * n);
        let sizes = self.tones().map(|(n, p, q)| power(n) * libm::hypot(p, q));
        sizes.sum()
    }
}

/// `(1 - cos d) / d^2`, from half of d and the sine of that half.
fn versine(half: f64, sine: f64) -> f64 {
    if half == 0.0 {
        return 0.5;
    }
    let half = sine / half;
    0.5 * half * half
}

/// `(d - sin d) / d^3`, from d and its sine; by a series below 0.5.
fn sagitta(d: f64, sine: f64) -> f64 {
    if d >= 0.5 {
        return (d - sine) / (d * d * d);
    }
    let x = d * d;
    let mut sum = 0.0;
    for n in [19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0] {
        sum = (1.0 - x * sum) / ((n - 1.0) * n);
    }
    (1.0 - x * sum) / 6.0
}

/// The first `d` in 0..=limit at which a function that begins at or above 0 reaches 0. `None`
/// without a zero within `limit`. `at` gives value and slope; `bound` bounds the second derivative.
/// The step is the smallest positive root of `value + slope h - bound h^2/2`, so it never passes a
/// zero. It converges like Newton's method. A function that begins at 0 and rises counts as having
/// left 0.
pub(super) fn first_zero(limit: f64, bound: f64, at: impl Fn(f64) -> (f64, f64)) -> Option<f64> {
    /// Steps after which the current `d` counts as the zero; most zeros need some ten.
    const MAX_STEPS: usize = 10_000;
    /// Error of a zero in rad; at most one such step is lost.
    const ZERO_TOLERANCE: f64 = 1e-14;
    let mut d = 0.0;
    for _ in 0..MAX_STEPS {
        let (value, slope) = at(d);
        let value = value.max(0.0);
        let step = if bound > 0.0 {
            let root = libm::sqrt(slope * slope + 2.0 * bound * value);
            // This form has no cancellation.
            if slope > 0.0 {
                (slope + root) / bound
            } else {
                2.0 * value / (root - slope).max(f64::MIN_POSITIVE)
            }
        } else if slope < 0.0 {
            -value / slope
        } else {
            return None;
        };
        if step <= ZERO_TOLERANCE * (1.0 + d) {
            return Some(d);
        }
        d += step;
        if d > limit {
            return None;
        }
    }
    Some(d)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::wave::Tone;

    fn push() -> Push {
        let second = Tone::new(0.15, 2.356);
        let wave = Wave::build(second, Tone::default()).unwrap();
        Push::new(&wave, 1.5, 0.4, 0.3)
    }

    #[test]
    fn sagitta_series_meets_the_closed_form() {
        for n in 1..=1000 {
            let d = 1e-4 * f64::from(n);
            let x = d * d;
            let series = 1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0 * (1.0 - x / 110.0)));
            let series = series / 6.0;
            assert!((sagitta(d, 0.0) / series - 1.0).abs() < 1e-15, "{d}");
        }
        let (below, above) = (0.5 - 1e-9, 0.5);
        let [below, above] = [below, above].map(|d| sagitta(d, libm::sin(d)));
        assert!((above / below - 1.0).abs() < 1e-9, "{below} {above}");
    }

    /// Finds every zero of a fine scan and passes none.
    #[test]
    fn first_zero_is_the_smallest() {
        let push = push();
        for n in 0..400 {
            let from = 0.05 * f64::from(n);
            if push.at(from) < 1e-3 {
                continue;
            }
            let actual = first_zero(20.0, push.bound(2), |d| {
                (push.at(from + d), push.slope(from + d))
            });
            let mut scan = (1..200_000).map(|n| 1e-4 * f64::from(n));
            let scanned = scan.find(|d| push.at(from + d) <= 0.0).unwrap();
            let actual = actual.unwrap();
            let difference = scanned - actual;
            assert!((0.0..1e-4).contains(&difference), "{from}: {actual}");
            assert!(push.at(from + actual).abs() < 1e-12);
        }
        let above_zero = |d| (2.0 + libm::sin(d), libm::cos(d));
        assert_eq!(first_zero(20.0, 1.0, above_zero), None);
    }
}
