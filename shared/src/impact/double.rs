//! The impact map in f64.

use core::f64::consts::TAU;

use super::{Impact, Kernel, State};
use crate::feeder::{OutOfRange, accept};

/// The impact map in f64 for one k and one restitution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Map {
    k: f64,
    restitution: f64,
}

impl Map {
    /// k of this map.
    #[must_use]
    pub fn k(&self) -> f64 {
        self.k
    }

    /// Restitution of this map.
    #[must_use]
    pub fn restitution(&self) -> f64 {
        self.restitution
    }
}

impl Kernel for Map {
    type State = State;

    const NAME: &'static str = "f64";

    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        accept("k", k, (1e-3..=1e3).contains(&k), "0.001..1000")?;
        accept(
            "restitution",
            restitution,
            (0.0..=1.0).contains(&restitution),
            "0..1",
        )?;
        Ok(Self { k, restitution })
    }

    fn state(phase: f64, velocity: f64) -> Result<State, OutOfRange> {
        accept("phase", phase, phase.is_finite(), "any finite angle in rad")?;
        accept(
            "velocity",
            velocity,
            (0.0..=1e3).contains(&velocity),
            "0..1000 (units of b w)",
        )?;
        let turned = phase - TAU * libm::floor(phase / TAU);
        Ok(State {
            phase: if turned < TAU { turned } else { 0.0 },
            velocity,
        })
    }

    fn observe(state: State) -> State {
        state
    }

    /// Steps by a lower bound of the height that cannot jump over an impact: `|u'''| = |cos| <= 1`,
    /// so `u + u' h + u'' h^2/2 - h^3/6` is below `u(d + h)` (physics, section 3).
    fn impact(&self, state: State) -> Impact<State> {
        let State {
            phase: t,
            velocity: psi,
        } = state;
        let (s, c) = (libm::sin(t), libm::cos(t));
        let excess = s - self.k;
        if psi == 0.0 && (excess < 0.0 || (excess == 0.0 && c <= 0.0)) {
            return Impact {
                flight: 0.0,
                next: state,
                grazes: false,
            };
        }
        let launch = psi + c;
        // First step: psi h + (s-k) h^2/2 + c_low h^3/6 with the deflated quadratic; at lift-off
        // itself only cos t lifts the part.
        let root = libm::sqrt(excess * excess + 8.0 / 3.0 * psi);
        let mut d = if excess < 0.0 {
            4.0 * psi / (root - excess)
        } else {
            1.5 * (excess + root)
        };
        if d <= 1e-9 * c && c > 0.0 {
            d = d.max(2.0 * c);
        }
        let leaving = launch * launch - 2.0 * self.k * (1.0 - s);
        if launch > 0.0 && leaving >= 1.0 {
            d = d.max((launch + libm::sqrt(leaving)) / self.k);
        }
        for _ in 0..10_000 {
            let height = if d < 0.5 {
                d * (psi + d * (s * versine(d) - 0.5 * self.k + d * c * sagitta(d)))
            } else {
                launch * d
                    - 0.5 * self.k * d * d
                    - 2.0 * libm::cos(t + 0.5 * d) * libm::sin(0.5 * d)
            };
            let slope = psi - self.k * d + 2.0 * libm::sin(t + 0.5 * d) * libm::sin(0.5 * d);
            let curvature = libm::sin(t + d) - self.k;
            let h = if height <= 0.0 {
                -height / slope.min(-1e-300)
            } else {
                root_of_bound(height, slope, curvature)
            };
            if height <= 0.0 || h <= 1e-16 * d {
                let d = if height <= 0.0 { d - h.min(0.5 * d) } else { d };
                let arrival =
                    -(psi - self.k * d + 2.0 * libm::sin(t + 0.5 * d) * libm::sin(0.5 * d));
                let next = t + d;
                let turned = next - TAU * libm::floor(next / TAU);
                return Impact {
                    flight: d,
                    next: State {
                        phase: turned,
                        velocity: self.restitution * arrival.max(0.0),
                    },
                    grazes: false,
                };
            }
            d += h;
        }
        Impact {
            flight: d,
            next: state,
            grazes: true,
        }
    }
}

/// `(1 - cos d) / d^2`.
fn versine(d: f64) -> f64 {
    let half = libm::sin(0.5 * d) / (0.5 * d);
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

/// Smallest positive root of `u + v h + a h^2/2 - h^3/6` for u > 0, by bisection from below.
fn root_of_bound(u: f64, v: f64, a: f64) -> f64 {
    let value = |h: f64| u + h * (v + h * (0.5 * a - h / 6.0));
    let mut low = 0.0;
    let mut high = 1.0;
    let turning = a * a + 2.0 * v;
    let valley = a - libm::sqrt(turning.max(0.0));
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
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if value(middle) > 0.0 {
            low = middle
        } else {
            high = middle
        }
    }
    low
}
