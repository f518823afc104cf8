//! The shape of the track's motion: a sine and its second and third harmonic.
//!
//! Input is amplitude and phase angle of the harmonics. The outputs are displacement and
//! derivatives at a phase, in `b`, `b w`, `b w^2`, and their extrema over a turn. A bound of the
//! second derivative isolates the extrema. Safeguarded Newton steps refine them (Press et al.,
//! Numerical Recipes, section 9.4).

use core::f64::consts::{FRAC_PI_2, TAU};
use core::ops::{Add, Mul};

use heapless::Vec;

use crate::arithmetic::vector::sine_cosine;
use crate::feeder::{OutOfRange, accept_in};

/// One harmonic of the track's motion: `amplitude sin(n t + angle)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tone {
    /// Amplitude over that of the fundamental (symbol e), 0..=0.5.
    pub amplitude: f64,
    /// Phase angle (symbol th) in rad, -2 pi..=2 pi.
    pub angle: f64,
}

impl Tone {
    /// A tone of this amplitude and angle.
    #[inline(always)]
    pub const fn new(amplitude: f64, angle: f64) -> Self {
        Self { amplitude, angle }
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Motion<F = f64> {
    /// Displacement S.
    pub height: F,
    /// S'.
    pub speed: F,
    /// `A = -S''`: a resting part leaves where A rises through k.
    pub push: F,
    /// A'.
    pub jerk: F,
    /// -A''.
    pub snap: F,
}

/// Sums of tones, from displacement and velocity over its frequency of each.
impl<F: Copy + Add<Output = F> + Mul<Output = F> + From<f32>> Motion<F> {
    #[inline(always)]
    pub fn of_two([s, c]: [F; 2], [s2, c2]: [F; 2]) -> Self {
        Self {
            height: s + s2,
            speed: c + (c2 + c2),
            push: s + F::from(4.0) * s2,
            jerk: c + F::from(8.0) * c2,
            snap: s + F::from(16.0) * s2,
        }
    }

    #[inline(always)]
    pub fn with_third(self, [s3, c3]: [F; 2]) -> Self {
        Self {
            height: self.height + s3,
            speed: self.speed + F::from(3.0) * c3,
            push: self.push + F::from(9.0) * s3,
            jerk: self.jerk + F::from(27.0) * c3,
            snap: self.snap + F::from(81.0) * s3,
        }
    }
}

/// Displacement and velocity of each tone over its frequency, at a phase.
pub(super) type Parts = [[f64; 2]; 3];

/// The shape of the track's motion in units of the fundamental's amplitude b. It is `S(t) = sin t +
/// e sin(2 t + th) + e3 sin(3 t + th3)`. Two tones: reference 19 of Hongler & Figour 1989.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    second: Tone,
    third: Tone,
    /// `e cos th` and `e sin th` of each harmonic.
    mixed: [[f64; 2]; 2],
    /// Every extremum of A, in the order of their phases: phase and value.
    extrema: [[f64; 2]; MAX_ZEROS],
    count: usize,
    /// max S, -min S and max |S'|.
    pub(super) top: f64,
    pub(super) bottom: f64,
    pub(super) steepest: f64,
}

/// Largest number of zeros in a turn, of a trigonometric polynomial of three tones.
pub(super) const MAX_ZEROS: usize = 6;

/// Largest number of humps in a turn: one between two zeros of A - k.
pub(super) const MAX_HUMPS: usize = MAX_ZEROS / 2;

/// Rounding of a bound of S or S', in b or `b w`.
const BOUND_ROUNDING: f64 = 1e-12;

impl Wave {
    /// The wave with these second and third harmonics; an error names the tone out of range
    /// (amplitude 0..=0.5, angle -2 pi..=2 pi).
    pub fn build(second: Tone, third: Tone) -> Result<Self, OutOfRange> {
        accept_tones(second, third)?;
        Ok(Self::from_tones(second, third))
    }

    fn from_tones(second: Tone, third: Tone) -> Self {
        let mixed = [second, third].map(|tone| {
            let angle = tone.angle;
            let turned = if angle < 0.0 { angle + TAU } else { angle };
            let (sine, cosine) = sine_cosine(turned);
            [tone.amplitude * cosine, tone.amplitude * sine]
        });
        let mut wave = Self {
            second,
            third,
            mixed,
            extrema: [[0.0; 2]; MAX_ZEROS],
            count: 0,
            top: 0.0,
            bottom: 0.0,
            steepest: 0.0,
        };
        let largest = |power: i32| {
            1.0 + second.amplitude * libm::pow(2.0, power.into())
                + third.amplitude * libm::pow(3.0, power.into())
        };
        for phase in wave.zeros(|m| [m.speed, -m.push], largest(3)) {
            let height = wave.at(phase).height;
            wave.top = wave.top.max(height + BOUND_ROUNDING);
            wave.bottom = wave.bottom.max(BOUND_ROUNDING - height);
        }
        for phase in wave.zeros(|m| [m.push, m.jerk], largest(4)) {
            let speed = wave.at(phase).speed.abs();
            wave.steepest = wave.steepest.max(speed + BOUND_ROUNDING);
        }
        for phase in wave.zeros(|m| [m.jerk, -m.snap], largest(5)) {
            wave.extrema[wave.count] = [phase, wave.at(phase).push];
            wave.count += 1;
        }
        wave
    }

    /// One tone: the sine itself.
    pub const fn sine() -> Self {
        const NO_TONE: Tone = Tone::new(0.0, 0.0);
        // The same bits as the search in `from_tones`: a plant uses this at every impact.
        let mut extrema = [[0.0; 2]; MAX_ZEROS];
        extrema[0] = [FRAC_PI_2, 1.0];
        extrema[1] = [3.0 * FRAC_PI_2, -1.0];
        Self {
            second: NO_TONE,
            third: NO_TONE,
            mixed: [[0.0; 2]; 2],
            extrema,
            count: 2,
            top: 1.0 + BOUND_ROUNDING,
            bottom: 1.0 + BOUND_ROUNDING,
            steepest: 1.0 + BOUND_ROUNDING,
        }
    }

    /// The second harmonic.
    pub fn second(&self) -> Tone {
        self.second
    }

    /// The third harmonic.
    pub fn third(&self) -> Tone {
        self.third
    }

    /// The tones that are present, each with its number; the first has amplitude 1 and angle 0.
    pub(crate) fn tones(&self) -> impl Iterator<Item = (f64, Tone)> {
        let first = Tone::new(1.0, 0.0);
        [(1.0, first), (2.0, self.second), (3.0, self.third)]
            .into_iter()
            .filter(|(_, tone)| tone.amplitude > 0.0)
    }

    /// Whether the wave is a sine, without harmonics.
    pub fn is_sine(&self) -> bool {
        self.second.amplitude == 0.0 && self.third.amplitude == 0.0
    }

    /// Largest acceleration of the track, max |S''|, in units of `b w^2`, within 1e-14.
    pub fn peak_acceleration(&self) -> f64 {
        let peaks = self.extrema().map(|[_, push]| push.abs());
        peaks.fold(0.0, f64::max)
    }

    /// Largest k at which the track throws a resting part, max(-S'').
    pub fn highest_throw(&self) -> f64 {
        let pushes = self.extrema().map(|[_, push]| push);
        pushes.fold(0.0, f64::max)
    }

    /// Acceleration of a weightless part over the track, `-S''` in `b w^2`, at a phase in rad.
    pub fn push(&self, phase: f64) -> f64 {
        self.motion(phase)[2]
    }

    /// Displacement S, velocity S', push A = -S'' and A' at a phase in rad, each within 4e-15.
    pub(crate) fn motion(&self, phase: f64) -> [f64; 4] {
        let m = self.at(in_turn(phase));
        [m.height, m.speed, m.push, m.jerk]
    }

    pub(super) fn at(&self, phase: f64) -> Motion {
        let (sine, cosine) = sine_cosine(phase);
        if self.is_of_two() {
            motion::<2>(&self.parts::<2>(sine, cosine))
        } else {
            motion::<3>(&self.parts::<3>(sine, cosine))
        }
    }

    #[inline(always)]
    pub(super) fn is_of_two(&self) -> bool {
        self.third.amplitude == 0.0
    }

    pub(super) fn extrema(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        self.extrema.iter().take(self.count).copied()
    }

    /// The first N tones at a phase, from its sine and cosine.
    #[inline(always)]
    pub(super) fn parts<const N: usize>(&self, sine: f64, cosine: f64) -> Parts {
        let double = (sine + sine) * cosine;
        let turned = (cosine - sine) * (cosine + sine);
        let mix = |[a, b]: [f64; 2], sine: f64, cosine: f64| {
            [a * sine + b * cosine, a * cosine - b * sine]
        };
        let second = mix(self.mixed[0], double, turned);
        let third = if N > 2 {
            let triple = double * cosine + turned * sine;
            mix(self.mixed[1], triple, turned * cosine - double * sine)
        } else {
            [0.0; 2]
        };
        [[sine, cosine], second, third]
    }

    /// Zeros of a derivative of S in a turn, in order; `of` gives it with its own derivative,
    /// `bound` bounds the next one. It starts where the function is large and takes steps too short
    /// to pass a zero. It may miss pairs of zeros between which the function is below 1e-14 of
    /// `bound`.
    fn zeros(&self, of: impl Fn(&Motion) -> [f64; 2], bound: f64) -> Vec<f64, MAX_ZEROS> {
        const MIN_STEP: f64 = 1e-7;
        /// Share of `bound` below which rounding decides the sign.
        const ROUNDING: f64 = 1e-14;
        let at = |phase: f64| of(&self.at(in_turn(phase)));
        let mut start = 0.0;
        for n in 1..16 {
            let phase = f64::from(n) * TAU / 16.0;
            if at(phase)[0].abs() > at(start)[0].abs() {
                start = phase;
            }
        }
        let mut zeros = Vec::new();
        let (mut phase, mut value) = (start, at(start));
        while phase < start + TAU {
            // The sign is constant up to the root of |value| - slope h - bound h^2/2.
            let [size, slope] = if value[0] < 0.0 {
                value.map(|x| -x)
            } else {
                value
            };
            let step = (slope + libm::sqrt(slope * slope + 2.0 * bound * size)) / bound;
            let mut next = phase + step.max(MIN_STEP);
            let mut then = at(next);
            while then[0].abs() < ROUNDING * bound {
                next += MIN_STEP;
                then = at(next);
            }
            if (then[0] < 0.0) != (value[0] < 0.0) && next < start + TAU {
                // There are no more zeros than the list holds.
                let _ = zeros.push(in_turn(crossing(&at, phase, next)));
            }
            (phase, value) = (next, then);
        }
        zeros.sort_unstable_by(f64::total_cmp);
        zeros
    }
}

pub(super) fn accept_tones(second: Tone, third: Tone) -> Result<(), OutOfRange> {
    let names = [
        ("second tone, amplitude", "second tone, angle"),
        ("third tone, amplitude", "third tone, angle"),
    ];
    for (tone, (amplitude, angle)) in [second, third].into_iter().zip(names) {
        accept_in(amplitude, tone.amplitude, 0.0..=0.5, "0..0.5 of the first")?;
        accept_in(angle, tone.angle, -TAU..=TAU, "-6.2832..6.2832 rad")?;
    }
    Ok(())
}

/// Sum of the first N tones: the motion of the track.
#[inline(always)]
pub(super) fn motion<const N: usize>(parts: &Parts) -> Motion {
    let [first, second, third] = *parts;
    let two = Motion::of_two(first, second);
    if N < 3 { two } else { two.with_third(third) }
}

/// `angle` in 0..2 pi.
pub(super) fn in_turn(angle: f64) -> f64 {
    let turned = angle - TAU * libm::floor(angle / TAU);
    if turned < TAU { turned } else { 0.0 }
}

/// Zero of a function between two places of opposite sign, by safeguarded Newton steps. `at` gives
/// the value and its derivative.
pub(super) fn crossing(at: &impl Fn(f64) -> [f64; 2], low: f64, high: f64) -> f64 {
    let (mut low, mut high) = (low, high);
    let negative = at(low)[0] < 0.0;
    let mut x = 0.5 * (low + high);
    for round in 0..120 {
        let [value, slope] = at(x);
        if (value < 0.0) == negative {
            low = x;
        } else {
            high = x;
        }
        let newton = x - value / slope;
        let next = if newton > low && newton < high && round % 8 != 7 {
            newton
        } else {
            0.5 * (low + high)
        };
        if value == 0.0 || (next - x).abs() <= 0.25 * f64::EPSILON * x.abs() {
            break;
        }
        x = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;

    fn waves() -> impl Iterator<Item = Wave> {
        (0..400).map(|n| {
            let spread = |factor: f64| (f64::from(n) * factor).rem_euclid(1.0);
            let tone = |a: f64, b: f64| Tone::new(0.5 * spread(a), TAU * (2.0 * spread(b) - 1.0));
            let third = [tone(0.732_051, 0.236_068), Tone::default()][n as usize % 2];
            Wave::build(tone(0.618_034, 0.414_214), third).unwrap()
        })
    }

    /// A wave whose push has a zero of fifth order, where rounding decides its sign:
    /// `S'' = sin 2t 4/5 - sin t - sin 3t 1/5`, the derivative of -4/15 (1 - cos t)^3.
    fn flat_wave() -> Wave {
        Wave::build(Tone::new(0.2, PI), Tone::new(0.2 / 9.0, 0.0)).unwrap()
    }

    /// Direct sines, without a search for extrema. Bounds hold on a fine grid and are reached on it
    /// to second order.
    #[test]
    fn bounds_hold_and_are_reached() {
        for wave in waves().chain([flat_wave()]) {
            let direct = |phase: f64, derivative: i32| {
                let tones = [
                    (1.0, 1.0, 0.0),
                    (2.0, wave.second.amplitude, wave.second.angle),
                    (3.0, wave.third.amplitude, wave.third.angle),
                ];
                let terms = tones.map(|(q, amplitude, angle)| {
                    let (s, c) = (q * phase + angle).sin_cos();
                    amplitude * q.powi(derivative) * [s, c, -s][derivative as usize]
                });
                terms.iter().sum::<f64>()
            };
            let mut largest = [0.0_f64; 5];
            for n in 0..20_000 {
                let phase = f64::from(n) * TAU / 20_000.0;
                let at = wave.at(phase);
                // The direct form rounds angles of up to 25 rad.
                let [height, speed, curvature] = [0, 1, 2].map(|n| direct(phase, n));
                assert!((at.height - height).abs() < 6e-15);
                assert!((at.speed - speed).abs() < 2e-14);
                assert!((at.push + curvature).abs() < 4e-14);
                let here = [height, -height, speed.abs(), curvature.abs(), -curvature];
                largest = core::array::from_fn(|n| largest[n].max(here[n]));
            }
            let bounds = [wave.top, wave.bottom, wave.steepest];
            let bounds = bounds.into_iter();
            let bounds = bounds.chain([wave.peak_acceleration(), wave.highest_throw()]);
            // Half a step of the grid, squared, times half the largest second derivative there.
            for (bound, grid) in bounds.zip(largest) {
                assert!((-1e-13..2e-6).contains(&(bound - grid)), "{wave:?} {grid}");
            }
        }
    }

    #[test]
    fn wave_of_one_tone_is_the_sine() {
        let sine = Wave::sine();
        assert!(sine.is_sine() && sine.count == 2);
        assert_eq!(sine, Wave::from_tones(Tone::default(), Tone::default()));
        assert!((sine.peak_acceleration() - 1.0).abs() < 1e-15);
        assert!((sine.top - 1.0).abs() < 2e-12 && (sine.steepest - 1.0).abs() < 2e-12);
    }

    #[test]
    fn tone_out_of_range_is_named() {
        let (size, angle) = (0.5_f64.next_up(), TAU.next_up());
        for ([e, th, e3, th3], parameter) in [
            ([size, 0.0, 0.0, 0.0], "second tone, amplitude"),
            ([-0.1, 0.0, 0.0, 0.0], "second tone, amplitude"),
            ([0.1, angle, 0.0, 0.0], "second tone, angle"),
            ([0.1, 2.0, f64::NAN, 0.0], "third tone, amplitude"),
            ([0.1, 2.0, 0.1, -angle], "third tone, angle"),
        ] {
            let refused = Wave::build(Tone::new(e, th), Tone::new(e3, th3)).unwrap_err();
            assert_eq!(refused.parameter, parameter);
        }
        assert!(Wave::build(Tone::new(0.5, TAU), Tone::new(0.5, -TAU)).is_ok());
    }
}
