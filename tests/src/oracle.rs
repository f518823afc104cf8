//! An independent impact map: slow, simple, unable to jump over an impact.
//!
//! It shares no code and no idea with the kernels: it evaluates sines where it stands, and steps by
//! a lower bound of the gap. Its fourth derivative is within -1..1, so its Taylor series to the
//! third power less `h^4/24` is below `u(d + h)`: stepping up to the first root of that passes no
//! impact.

/// Longest step in rad.
const STRIDE: f64 = 2.0;

/// A flight's first impact as the oracle sees it.
#[derive(Clone, Copy, Debug)]
pub struct Flight {
    /// Duration in rad.
    pub duration: f64,
    /// Speed of arrival.
    pub arrival: f64,
    /// The smallest gap, relative to its rounding error, at which the stepping slowed before the
    /// impact: about 1 or below where an earlier touch is within rounding.
    pub clearance: f64,
}

/// The gap and its first two derivatives `d` after a launch.
pub fn gap(k: f64, phase: f64, velocity: f64, d: f64) -> [f64; 3] {
    let (s, c) = phase.sin_cos();
    gap_from([s, c], k, phase, velocity, d)
}

/// The same where sine and cosine of the phase are known.
pub fn gap_from([s, c]: [f64; 2], k: f64, phase: f64, velocity: f64, d: f64) -> [f64; 3] {
    let half_sine = (0.5 * d).sin();
    let (middle_sine, middle_cosine) = (phase + 0.5 * d).sin_cos();
    let height = if d < 0.5 {
        d * (velocity + d * (s * versine(d) - 0.5 * k + d * c * sagitta(d)))
    } else {
        (velocity + c) * d - 0.5 * k * d * d - 2.0 * middle_cosine * half_sine
    };
    let slope = if d < 0.5 {
        velocity + d * (s - k + d * (c * versine(d) - s * d * sagitta(d)))
    } else {
        velocity - k * d + 2.0 * middle_sine * half_sine
    };
    let curvature = if d < 0.5 {
        (s - k) + 2.0 * middle_cosine * half_sine
    } else {
        (phase + d).sin() - k
    };
    [height, slope, curvature]
}

/// Rounding error of [`gap`]: half a unit in the last place of every term it sums.
pub fn rounding(k: f64, phase: f64, velocity: f64, d: f64) -> f64 {
    let (s, c) = phase.sin_cos();
    rounding_from([s, c], k, velocity, d)
}

/// The same where sine and cosine of the phase are known.
pub fn rounding_from([s, c]: [f64; 2], k: f64, velocity: f64, d: f64) -> f64 {
    let terms = if d < 0.5 {
        d * (velocity + d * ((s - k).abs() + k + s.abs() + d * c.abs()))
    } else {
        d * ((velocity + c).abs() + velocity + k * d + 1.0) + 2.0
    };
    0.5 * f64::EPSILON * terms
}

/// The first impact after a launch that is not at rest.
pub fn first_impact(k: f64, phase: f64, velocity: f64) -> Flight {
    let (s, c) = phase.sin_cos();
    let mut d = 0.999 * clear_of_launch(k, phase, velocity, STRIDE);
    let mut clearance = f64::INFINITY;
    let launch = velocity + c;
    let leaving = launch * launch - 2.0 * k * (1.0 - s);
    if launch > 0.0 && leaving >= 1.0 {
        d = d.max((launch + leaving.sqrt()) / k);
    }
    let mut shrinking = f64::INFINITY;
    for n in 0..10_000 {
        let at = gap(k, phase, velocity, d);
        let height = at[0];
        if height <= 0.0 {
            break;
        }
        let h = clear_from(at, phase, d, STRIDE);
        // Near the flat top of a track with k within rounding of 1 every step is this small.
        if h <= 2e-16 * d || (n > 300 && h < 1e-6 * d && height < rounding(k, phase, velocity, d)) {
            break;
        }
        // Steps that shrink and grow again have passed a near touch.
        if h > shrinking {
            clearance = clearance.min(height / rounding(k, phase, velocity, d));
        }
        shrinking = h;
        d += h;
    }
    let arrival = (-gap(k, phase, velocity, d)[1]).max(0.0);
    Flight {
        duration: d,
        arrival,
        clearance,
    }
}

/// `(1 - cos d) / d^2`.
fn versine(d: f64) -> f64 {
    if d == 0.0 {
        return 0.5;
    }
    let half = (0.5 * d).sin() / (0.5 * d);
    0.5 * half * half
}

/// `(d - sin d) / d^3` by its series, for d < 0.5.
fn sagitta(d: f64) -> f64 {
    let x = d * d;
    let mut sum = 0.0;
    for n in [19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0] {
        sum = (1.0 - x * sum) / ((n - 1.0) * n);
    }
    (1.0 - x * sum) / 6.0
}

/// How long `u + v h + a h^2 + b h^3 - w h^4 > 0` at least, up to `stride`; u >= 0, w >= 0.
///
/// Up to the stride the last two terms are above a quadratic one, whose root is closed; the stride
/// is shortened until it is near that root.
pub(crate) fn clear_for([u, v, a, b, w]: [f64; 5], mut stride: f64) -> f64 {
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

/// How long the gap stays positive from `d` on, at least, up to `stride`; `at` is the gap there.
pub fn clear_from(at: [f64; 3], phase: f64, d: f64, stride: f64) -> f64 {
    // The fourth derivative is within -1..1; the phase rounds.
    let cosine = (phase + d).cos() - 2.0 * f64::EPSILON * (phase + d);
    clear_for(
        [at[0], at[1], 0.5 * at[2], cosine / 6.0, 1.0 / 24.0],
        stride,
    )
}

/// How long the gap stays positive from launch, at least, up to `stride`.
pub fn clear_of_launch(k: f64, phase: f64, velocity: f64, stride: f64) -> f64 {
    let (s, c) = phase.sin_cos();
    // u/d = psi + (s - k) d/2 + c d^2/6 - s d^3/24 - ...
    let quotient = [velocity, 0.5 * (s - k), c / 6.0, -s / 24.0, 1.0 / 120.0];
    let clear = clear_for(quotient, stride);
    if velocity == 0.0 && c > 0.0 {
        // At lift-off, whatever the rounding of sin t - k, cos t lifts the part.
        clear.max(2.0 * c)
    } else {
        clear
    }
}
