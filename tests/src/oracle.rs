//! An independent impact map: slow, simple, unable to jump over an impact.
//!
//! It shares no code and no idea with the kernels: it evaluates sines where it stands, and steps by a
//! lower bound of the gap. `|u'''| = |cos| <= 1`, so `u + u' h + u'' h^2/2 - h^3/6` is below `u(d + h)`:
//! stepping to the first root of the bound passes no impact (physics, section 3).

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
#[must_use]
pub fn gap(k: f64, phase: f64, velocity: f64, d: f64) -> [f64; 3] {
    let (s, c) = phase.sin_cos();
    let (half_sine, _) = (0.5 * d).sin_cos();
    let middle = phase + 0.5 * d;
    let height = if d < 0.5 {
        d * (velocity + d * (s * versine(d) - 0.5 * k + d * c * sagitta(d)))
    } else {
        (velocity + c) * d - 0.5 * k * d * d - 2.0 * middle.cos() * half_sine
    };
    let slope = if d < 0.5 {
        velocity + d * (s - k + d * (c * versine(d) - s * d * sagitta(d)))
    } else {
        velocity - k * d + 2.0 * middle.sin() * half_sine
    };
    let curvature = if d < 0.5 {
        (s - k) + 2.0 * middle.cos() * half_sine
    } else {
        (phase + d).sin() - k
    };
    [height, slope, curvature]
}

/// Rounding error of [`gap`]: half a unit in the last place of every term it sums.
#[must_use]
pub fn rounding(k: f64, phase: f64, velocity: f64, d: f64) -> f64 {
    let (s, c) = phase.sin_cos();
    let terms = if d < 0.5 {
        d * (velocity + d * ((s - k).abs() + k + s.abs() + d * c.abs()))
    } else {
        d * ((velocity + c).abs() + velocity + k * d + 1.0) + 2.0
    };
    0.5 * f64::EPSILON * terms
}

/// The first impact after a launch that is not at rest.
#[must_use]
pub fn first_impact(k: f64, phase: f64, velocity: f64) -> Flight {
    let (s, c) = phase.sin_cos();
    let excess = s - k;
    // First step: psi h + (s - k) h^2/2 - h^3/6 > 0; at lift-off itself only cos t lifts the part.
    let root = (excess * excess + 8.0 / 3.0 * velocity).sqrt();
    let mut d = if excess < 0.0 {
        4.0 * velocity / (root - excess)
    } else {
        1.5 * (excess + root)
    };
    if velocity == 0.0 && c > 0.0 {
        // psi = 0: u >= (s - k) d^2/2 + c d^3/6 - d^4/24.
        d = d.max(2.0 * c);
    }
    let mut clearance = f64::INFINITY;
    let launch = velocity + c;
    let leaving = launch * launch - 2.0 * k * (1.0 - s);
    if launch > 0.0 && leaving >= 1.0 {
        d = d.max((launch + leaving.sqrt()) / k);
    }
    let mut shrinking = f64::INFINITY;
    for _ in 0..100_000 {
        let [height, slope, curvature] = gap(k, phase, velocity, d);
        if height <= 0.0 {
            break;
        }
        let h = root_of_bound(height, slope, curvature);
        if h <= 2e-16 * d {
            break;
        }
        // Steps that shrink and grow again passed a near touch.
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

/// Smallest positive root of `u + v h + a h^2/2 - h^3/6` for u > 0, from below.
fn root_of_bound(u: f64, v: f64, a: f64) -> f64 {
    let value = |h: f64| u + h * (v + h * (0.5 * a - h / 6.0));
    let mut low = 0.0;
    let mut high = 1.0;
    let turning = a * a + 2.0 * v;
    // The local minimum, where the bound has one.
    let valley = a - turning.max(0.0).sqrt();
    if v < 0.0 && a > 0.0 && turning > 0.0 && value(valley) <= 0.0 {
        high = valley;
    } else {
        if v < 0.0 && a > 0.0 && turning > 0.0 {
            low = valley;
            high = 2.0 * valley;
        }
        while value(high) > 0.0 {
            high *= 2.0;
        }
    }
    for _ in 0..1200 {
        let middle = 0.5 * (low + high);
        if high - low <= 1e-4 * high || middle <= low || middle >= high {
            break;
        }
        if value(middle) > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}
