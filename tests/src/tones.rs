//! An independent impact map for tracks of several tones: slow, simple, unable to jump over an impact.
//!
//! It shares no code and no idea with the kernels: it evaluates every tone where it stands and steps by a
//! lower bound of the gap. With M the sum of `q^4 e_q` the fourth derivative is within -M..M, so that the
//! Taylor series to the third power less `M h^4/24` is below `u(d + h)`.

use crate::oracle::Flight;

/// A track: k and its tones, each frequency, amplitude and angle.
#[derive(Clone, Copy, Debug)]
pub struct Track {
    /// k.
    pub k: f64,
    /// The tones, `e sin(q t + th)` as (q, e, th).
    pub tones: [(f64, f64, f64); 3],
}

/// Longest step in rad.
const STRIDE: f64 = 2.0;

impl Track {
    /// The track of a second and a third tone, each amplitude and angle.
    #[must_use]
    pub fn of(k: f64, [e, th, e3, th3]: [f64; 4]) -> Self {
        Self {
            k,
            tones: [(1.0, 1.0, 0.0), (2.0, e, th), (3.0, e3, th3)],
        }
    }

    /// S and its first three derivatives.
    #[must_use]
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

    /// Bound of the fourth derivative of S.
    fn bound(&self) -> f64 {
        self.tones.iter().map(|(q, e, _)| e * q.powi(4)).sum()
    }

    /// The gap and its first two derivatives `d` after a launch.
    #[must_use]
    pub fn gap(&self, phase: f64, velocity: f64, d: f64) -> [f64; 3] {
        let mut gap = [
            d * (velocity - 0.5 * self.k * d),
            velocity - self.k * d,
            -self.k,
        ];
        for (q, e, th) in self.tones {
            let x = q * d;
            let (s, c) = (q * phase + th).sin_cos();
            let half = (0.5 * x).sin();
            let (versine, sine) = (2.0 * half * half, x.sin());
            let sagitta = if x < 0.5 { sagitta(x) } else { x - sine };
            gap[0] += e * (s * versine + c * sagitta);
            gap[1] += e * q * (s * sine + c * versine);
            gap[2] += e * q * q * (s * (1.0 - versine) + c * sine);
        }
        gap
    }

    /// Rounding error of [`Track::gap`]: half a unit in the last place of every term it sums.
    #[must_use]
    pub fn rounding(&self, phase: f64, velocity: f64, d: f64) -> f64 {
        let speeds: f64 = self.tones.iter().map(|(q, e, _)| q * e).sum();
        let pushes: f64 = self.tones.iter().map(|(q, e, _)| q * q * e).sum();
        let angles = 2.0 + phase + d;
        let turned = d * (velocity + self.k * d + (d * pushes).min(speeds * angles));
        f64::EPSILON * turned
    }

    /// The first impact after a launch that is not at rest: at `told`, where that is soon proven, else by stepping.
    #[must_use]
    pub fn first_impact_by(&self, phase: f64, velocity: f64, told: f64) -> Flight {
        let [height, slope, curvature] = self.gap(phase, velocity, told);
        let noise = self.rounding(phase, velocity, told);
        let simple = slope < 0.0 && slope * slope > 100.0 * curvature.abs() * noise;
        if simple && height.abs() <= 16.0 * noise && self.is_first(phase, velocity, told) {
            return Flight {
                duration: told,
                arrival: -slope,
                clearance: f64::INFINITY,
            };
        }
        self.first_impact(phase, velocity)
    }

    /// Whether no impact before `d` is proven; `d` itself is a zero of the gap to rounding.
    ///
    /// A ball that leaves the reach of the track faster than the track ever moves meets it once; above that reach there
    /// is no track; the lower bound of the gap holds from anywhere; and where the slope is negative from here to the
    /// impact, the gap before it is positive.
    #[must_use]
    fn is_first(&self, phase: f64, velocity: f64, d: f64) -> bool {
        let sum = |weight: i32| -> f64 {
            let terms = self.tones.iter().map(|(q, e, _)| e * q.powi(weight));
            terms.sum()
        };
        let (reach, fastest, jerk, bound) = (sum(0), sum(1), sum(3), self.bound());
        let start = self.at(phase);
        let launch = velocity + start[1];
        let leaving = launch * launch - 2.0 * self.k * (reach - start[0]);
        let spare = 1e-13 * (1.0 + launch * launch);
        let (mut rises, mut sinks) = (f64::INFINITY, 0.0);
        if launch > 0.0 && leaving > spare {
            let speed = leaving.sqrt();
            sinks = (launch + speed) / self.k * (1.0 - 1e-12) - spare / (self.k * speed);
            rises = (launch - speed) / self.k * (1.0 + 1e-12) + spare / (self.k * speed);
            if leaving >= fastest * fastest + spare {
                return d >= sinks;
            }
        }
        let quotient = [velocity, 0.5 * (-start[2] - self.k), -start[3] / 6.0];
        let mut at = 0.999 * clear(quotient, bound / 24.0, d.min(STRIDE));
        let [_, slope, curvature] = self.gap(phase, velocity, d);
        for _ in 0..100 {
            if at >= rises && at < sinks {
                at = sinks;
            }
            let rest = d - at;
            // u' = slope - curvature (d - x) at most plus the largest jerk (d - x)^2/2 at x.
            let rise = (-curvature).max(0.0) * rest + 0.5 * jerk * rest * rest;
            if rest <= 0.0 || slope + rise < 0.01 * slope {
                return true;
            }
            let there = self.gap(phase, velocity, at);
            if there[0] <= 4.0 * self.rounding(phase, velocity, at) {
                return false;
            }
            let jerk = -self.at(phase + at)[3];
            let gap = [there[0], there[1], 0.5 * there[2], jerk / 6.0];
            let step = 0.999 * clear_from(gap, bound / 24.0);
            if step <= 1e-6 * rest {
                return false;
            }
            at += step;
        }
        false
    }

    /// The first impact after a launch that is not at rest, by stepping.
    #[must_use]
    pub fn first_impact(&self, phase: f64, velocity: f64) -> Flight {
        let bound = self.bound();
        let start = self.at(phase);
        let (push, surge) = (-start[2], -start[3]);
        // u/d = psi + (A - k) d/2 + A' d^2/6 + ...
        let quotient = [velocity, 0.5 * (push - self.k), surge / 6.0];
        let mut d = 0.999 * clear(quotient, bound / 24.0, STRIDE);
        if velocity == 0.0 && surge > 0.0 {
            // At lift-off, whatever the rounding of A - k.
            d = d.max(2.0 * surge / bound);
        }
        let reach: f64 = self.tones.iter().map(|tone| tone.1).sum();
        let fastest: f64 = self.tones.iter().map(|tone| tone.0 * tone.1).sum();
        let launch = velocity + start[1];
        let leaving = launch * launch - 2.0 * self.k * (reach - start[0]);
        if launch > 0.0 && leaving >= fastest * fastest {
            d = d.max((launch + leaving.sqrt()) / self.k * (1.0 - 1e-15));
        }
        let (mut clearance, mut shrinking) = (f64::INFINITY, f64::INFINITY);
        for n in 0..40_000 {
            let at = self.gap(phase, velocity, d);
            let rounding = self.rounding(phase, velocity, d);
            if at[0] <= 0.0 {
                break;
            }
            let jerk = -self.at(phase + d)[3];
            let h = clear_from([at[0], at[1], 0.5 * at[2], jerk / 6.0], bound / 24.0);
            if h <= 2e-16 * d || (n > 400 && h < 1e-6 * d && at[0] < rounding) {
                break;
            }
            // Steps that shrink and grow again passed a near touch.
            if h > shrinking {
                clearance = clearance.min(at[0] / rounding);
            }
            shrinking = h;
            d += h;
        }
        Flight {
            duration: d,
            arrival: (-self.gap(phase, velocity, d)[1]).max(0.0),
            clearance,
        }
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

/// How long `a + b h + c h^2 - w h^3 > 0` at least, from 0 up to `stride`.
fn clear([a, b, c]: [f64; 3], w: f64, mut stride: f64) -> f64 {
    // Every term that falls at its least: monotone, so its value at the end decides.
    for _ in 0..2000 {
        let least = if a > 0.0 {
            a + (b.min(0.0) + (c.min(0.0) - w * stride) * stride) * stride
        } else if b > 0.0 {
            b + (c.min(0.0) - w * stride) * stride
        } else {
            c - w * stride
        };
        if least > 0.0 {
            return stride;
        }
        stride *= 0.8;
    }
    0.0
}

/// How long `u + v h + a h^2 + b h^3 - w h^4 > 0` at least: over steps on which the quadratic part is as large
/// as its vertex or its ends.
fn clear_from([u, v, a, b]: [f64; 4], w: f64) -> f64 {
    let mut stride = STRIDE;
    for _ in 0..800 {
        let bend = a + (b - w * stride).min(0.0) * stride;
        // The least of u + v h + bend h^2 over 0..stride.
        let end = u + (v + bend * stride) * stride;
        let least = if bend > 0.0 && v < 0.0 && -v < 2.0 * bend * stride {
            u - 0.25 * v * v / bend
        } else {
            end.min(u)
        };
        if least > 0.0 {
            return stride;
        }
        stride *= 0.8;
    }
    0.0
}
