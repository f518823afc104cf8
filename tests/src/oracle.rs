//! An independent impact map for tracks of one and of several tones: slow, simple, and unable to
//! miss an impact.
//!
//! It shares neither code nor method with the kernels. It evaluates every tone directly and steps
//! by a lower bound of the gap. With M the sum of `q^4 e_q`, the fourth derivative is within -M..M.
//! So the third-order Taylor polynomial less `M h^4/24` is below `u(d + h)`.

use kband::impact::Tone;

use crate::states::bisect;

/// First impact of a flight, by the oracle.
#[derive(Clone, Copy, Debug)]
pub struct Flight {
    /// Duration, rad.
    pub duration: f64,
    /// Arrival speed in `b w`.
    pub arrival: f64,
    /// Smallest gap before the impact where the steps shortened, relative to its rounding error. It
    /// is about 1 or below if an earlier touch is within rounding.
    pub clearance: f64,
}

/// A track: k, and frequency, amplitude and angle of its tones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// k.
    pub k: f64,
    /// The tones, `e sin(q t + th)` as (q, e, th).
    pub tones: [(f64, f64, f64); 3],
}

/// Longest step in rad.
const STRIDE: f64 = 2.0;

impl Track {
    /// The track of a second and a third tone.
    pub fn on(k: f64, [second, third]: [Tone; 2]) -> Self {
        Self {
            k,
            tones: [
                (1.0, 1.0, 0.0),
                (2.0, second.amplitude, second.angle),
                (3.0, third.amplitude, third.angle),
            ],
        }
    }

    /// The track of one tone.
    pub fn sine(k: f64) -> Self {
        Self::on(k, [Tone::default(); 2])
    }

    pub(crate) fn is_sine(&self) -> bool {
        self.tones[1..].iter().all(|(_, e, _)| *e == 0.0)
    }

    pub(crate) fn upper_tones(&self) -> [Tone; 2] {
        [self.tones[1], self.tones[2]].map(|(_, e, th)| Tone::new(e, th))
    }

    /// S and its first three derivatives.
    pub fn at(&self, phase: f64) -> [f64; 4] {
        let mut sums = [0.0; 4];
        for (q, e, th) in self.tones {
            let (s, c) = (q * phase + th).sin_cos();
            sums[0] += e * s;
            sums[1] += e * q * c;
            sums[2] -= e * q * q * s;
            sums[3] -= e * q * q * q * c;
        }
        sums
    }

    /// Bounds of S and of its first four derivatives.
    pub fn sums(&self) -> [f64; 5] {
        let mut sums = [0.0; 5];
        for (q, e, _) in self.tones {
            let mut term = e;
            for sum in &mut sums {
                *sum += term;
                term *= q;
            }
        }
        sums
    }

    /// The gap and its first two derivatives `d` after a launch.
    pub fn gap(&self, phase: f64, velocity: f64, d: f64) -> [f64; 3] {
        let [height, slope, curvature, _] = self.launched(phase, velocity).gap(d);
        [height, slope, curvature]
    }

    fn launched(&self, phase: f64, velocity: f64) -> TrackLaunch {
        let tones = self.tones.map(|(q, e, th)| {
            let (s, c) = if e == 0.0 {
                (0.0, 0.0)
            } else {
                (q * phase + th).sin_cos()
            };
            [q, e * s, e * c]
        });
        TrackLaunch {
            k: self.k,
            velocity,
            tones,
        }
    }

    /// Rounding error of [`Track::gap`]: half a unit in the last place of every summed term.
    pub fn rounding(&self, phase: f64, velocity: f64, d: f64) -> f64 {
        let speeds: f64 = self.tones.iter().map(|(q, e, _)| q * e).sum();
        let pushes: f64 = self.tones.iter().map(|(q, e, _)| q * q * e).sum();
        let angles = 2.0 + phase + d;
        let turned = d * (velocity + self.k * d + (d * pushes).min(speeds * angles));
        f64::EPSILON * turned
    }

    /// The first impact after a launch that is not at rest, by stepping.
    pub fn first_impact(&self, phase: f64, velocity: f64) -> Flight {
        let [reach, fastest, _, _, bound] = self.sums();
        let launched = self.launched(phase, velocity);
        let [height, speed, _, surge] = launched.track();
        let quotient = launched.quotient(bound);
        let mut d = 0.999 * clear_for(quotient, STRIDE);
        if velocity == 0.0 && surge > 0.0 {
            // At lift-off, independent of the rounding of A - k.
            d = d.max(2.0 * surge / bound);
        }
        let launch = velocity + speed;
        let leaving = launch * launch - 2.0 * self.k * (reach - height);
        if launch > 0.0 && leaving >= fastest * fastest {
            d = d.max((launch + leaving.sqrt()) / self.k * (1.0 - 1e-15));
        }
        // Smallest ratio, within a step, of the lower bound to the rounding of the gap.
        let distance_in_roundings =
            |from: f64, [at, min]: [f64; 2]| min / self.rounding(phase, velocity, from + at);
        let mut clearance = lowest(quotient, d).map_or(f64::INFINITY, |[at, min]| {
            distance_in_roundings(0.0, [at, at * min])
        });
        let mut before = f64::INFINITY;
        let mut falls = true;
        for n in 0..40_000 {
            let at = launched.gap(d);
            let rounding = self.rounding(phase, velocity, d);
            // If the gap is nearly level, its bound has no minimum within a step; the previous
            // value is then the minimum.
            if falls && at[0] > before {
                clearance = clearance.min(before / rounding);
            }
            falls = at[0] < before;
            before = at[0];
            if at[0] <= 0.0 {
                break;
            }
            let terms = onward(at, bound);
            let h = clear_for(terms, STRIDE);
            if h <= 2e-16 * d || (n > 400 && h < 1e-6 * d && at[0] < rounding) {
                break;
            }
            if let Some(lowest) = lowest(terms, h) {
                clearance = clearance.min(distance_in_roundings(d, lowest));
            }
            d += h;
        }
        Flight {
            duration: d,
            arrival: (-launched.gap(d)[1]).max(0.0),
            clearance,
        }
    }
}

/// A launch from a track: its velocity, and for each tone frequency and amplitude times sine and
/// cosine.
struct TrackLaunch {
    k: f64,
    velocity: f64,
    tones: [[f64; 3]; 3],
}

impl TrackLaunch {
    /// The track at launch: height, speed, and the negative second and third derivatives.
    fn track(&self) -> [f64; 4] {
        let mut sums = [0.0; 4];
        for [q, s, c] in self.tones {
            sums[0] += s;
            sums[1] += q * c;
            sums[2] += q * q * s;
            sums[3] += q * q * q * c;
        }
        sums
    }

    /// Coefficients of the lower bound of `u/d = psi + (A - k) d/2 + A' d^2/6 - ...`, for
    /// [`clear_for`].
    fn quotient(&self, bound: f64) -> [f64; 5] {
        let [.., push, surge] = self.track();
        let (v, a) = (0.5 * (push - self.k), surge / 6.0);
        [self.velocity, v, a, -bound / 24.0, 0.0]
    }

    /// The gap and its first three derivatives `d` after it.
    fn gap(&self, d: f64) -> [f64; 4] {
        let mut gap = [
            d * (self.velocity - 0.5 * self.k * d),
            self.velocity - self.k * d,
            -self.k,
            0.0,
        ];
        for [q, s, c] in self.tones {
            if s == 0.0 && c == 0.0 {
                continue;
            }
            let x = q * d;
            let (half_sine, half_cosine) = (0.5 * x).sin_cos();
            let (versine, sine) = (2.0 * half_sine * half_sine, 2.0 * half_sine * half_cosine);
            let sagitta = if x < 0.5 { sagitta(x) } else { x - sine };
            let cosine = 1.0 - versine;
            gap[0] += s * versine + c * sagitta;
            gap[1] += q * (s * sine + c * versine);
            gap[2] += q * q * (s * cosine + c * sine);
            gap[3] += q * q * q * (c * cosine - s * sine);
        }
        gap
    }
}

/// `x - sin x` by its series, for x < 0.5.
fn sagitta(x: f64) -> f64 {
    let z = x * x;
    let mut sum = 0.0;
    for n in [19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0] {
        sum = (1.0 - z * sum) / ((n - 1.0) * n);
    }
    x * z * (1.0 - z * sum) / 6.0
}

/// Lower bound of the h up to which `u + v h + a h^2 + b h^3 - w h^4 > 0`, at most `stride`; u >=
/// 0, w >= 0.
///
/// Up to the stride the last two terms are above a quadratic term, and the resulting quadratic has
/// a closed root. The stride is reduced until it is near that root.
fn clear_for([u, v, a, b, w]: [f64; 5], mut stride: f64) -> f64 {
    let mut clear = 0.0_f64;
    for _ in 0..40 {
        let bend = a + (b - w * stride).min(0.0) * stride;
        let square = v * v - 4.0 * bend * u;
        let zero = if bend >= 0.0 && (v >= 0.0 || square < 0.0) {
            stride
        } else if v < 0.0 {
            2.0 * u / (square.max(0.0).sqrt() - v)
        } else {
            (v + square.sqrt()) / (-2.0 * bend)
        };
        clear = clear.max(zero.min(stride));
        if clear > 0.3 * stride {
            break;
        }
        stride = (0.125 * stride).max(1.2 * clear);
    }
    clear
}

/// Coefficients of the lower bound from this point on, for [`clear_for`].
fn onward([u, v, a, b]: [f64; 4], bound: f64) -> [f64; 5] {
    [u, v, 0.5 * a, b / 6.0, bound / 24.0]
}

/// Place and value of the minimum of `u + v x + a x^2 + b x^3 - w x^4` in 0..`end`; `None` if it
/// does not rise again.
fn lowest([u, v, a, b, w]: [f64; 5], end: f64) -> Option<[f64; 2]> {
    const PIECES: u32 = 16;
    let rise = |x: f64| v + x * (2.0 * a + x * (3.0 * b - 4.0 * w * x));
    let mut min: Option<[f64; 2]> = None;
    for n in 0..PIECES {
        let [low, high] = [n, n + 1].map(|n| end * f64::from(n) / f64::from(PIECES));
        if rise(low) >= 0.0 || rise(high) < 0.0 {
            continue;
        }
        let [low, _] = bisect(low, high, |x| rise(x) < 0.0);
        let value = u + low * (v + low * (a + low * (b - w * low)));
        if min.is_none_or(|[_, min]| value < min) {
            min = Some([low, value]);
        }
    }
    min
}
