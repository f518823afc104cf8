//! The root in a bracket that holds one, and an impact near a node to the precision of the constants.

use super::ballistic::{Ballistic, Local};
use super::constants::{REACH, SLOW, SPACING, TURN, TURNS};
use super::search::Bracket;
use crate::arithmetic::fixed::{
    Reciprocal, high, high as product_high, square_root_scaled, wide, wide_signed,
};
use crate::arithmetic::trigonometry::Powers;
use crate::arithmetic::{Phase, Velocity};
use crate::impact::kernel::{HybridState, Landing};

/// An impact: steps of a phase after launch, arrival speed in steps of 2^-26, and whether it is a simple root.
pub(super) struct Settled {
    pub(super) steps: i64,
    pub(super) speed: i32,
    pub(super) converged: bool,
}

impl Ballistic<'_> {
    /// The state after an impact at `speed`, steps of 2^-26.
    #[inline(always)]
    pub(super) fn landing(&self, steps: i64, speed: u32, grazes: bool) -> Landing<HybridState> {
        let product = wide(speed, self.constants.restitution) + (1 << 31);
        let velocity = (product >> 32) as u32;
        Landing {
            steps,
            next: HybridState {
                phase: Phase::from_bits(self.phase.wrapping_add(steps as u32)),
                velocity: Velocity::from_bits(velocity),
            },
            grazes,
        }
    }

    /// The root in `bracket`: a node, the flight there, and the offset of the root from it, nearly.
    #[inline(never)]
    pub(super) fn solve(&self, bracket: Bracket) -> (i32, Local, i32) {
        let Bracket {
            mut low,
            mut high,
            start: mut place,
        } = bracket;
        let mut round = 0;
        loop {
            let node = ((place + i64::from(self.phase) + (1 << 23)) >> 24) as i32;
            let time = self.steps_to(node);
            let local = self.local(node);
            // The bracket's middle if steps do not find the root in time: within the reach of the node.
            if round >= 60 {
                let offset = (place - time) as i32;
                return (node, local, product_high(offset, TURN) << 6);
            }
            let (step, crosses) = down_crossing(&local);
            let next = time + (i64::from(product_high(step, TURNS)) << 8);
            let inside = crosses && next >= low - (1 << 16) && next <= high + (1 << 16);
            if inside && step.abs() < REACH >> 10 {
                return (node, local, step << 10);
            }
            if time > low && time < high {
                // The one down-crossing is after every height above 0; near launch, on a concave rise,
                // even one rounded below 0 is before it.
                let before = local.height > 0 || (local.curvature < 0 && local.slope > 0);
                if before {
                    low = time;
                } else {
                    high = time;
                }
            }
            round += 1;
            place = if inside && round < 30 {
                next
            } else {
                (low + high) / 2
            };
        }
    }

    /// The impact at the root near `offset` from a node.
    #[inline(never)]
    pub(super) fn settle(&self, mut node: i32, mut local: Local, offset: i32) -> Settled {
        let mut d = offset.clamp(-REACH, REACH);
        let mut round = 0;
        loop {
            let powers = Powers::of(d);
            let height = self.height(&local, d, &powers);
            let slope = local.slope + self.gain(&local, d, &powers);
            let curvature = local.curvature + (high(local.cosine, d) >> 4);
            round += 1;
            // 2 (S - k) u0 below u1^2 / 4, steps of 2^-28, with the slope at most 4.
            let bend = (curvature.unsigned_abs() >> 16) * (height.unsigned_abs() >> 14).min(0x7fff);
            let square = (slope.unsigned_abs() >> 12).min(0xffff);
            let simple = if slope < -SLOW {
                bend < (square * square) >> 3
            } else {
                let (square, bend) = squares(height, slope, curvature);
                slope < 0 && bend.abs() < square >> 2
            };
            let step = if simple {
                let reciprocal = Reciprocal::fine(slope.unsigned_abs());
                let newton = reciprocal.times(height, 30);
                // (S - k) e / (2 |u'|), steps of 2^-30.
                let bend = reciprocal.times(high(curvature, newton), 25);
                newton.saturating_add(high(newton, bend) << 2)
            } else {
                let nearly = Local {
                    height,
                    slope,
                    curvature,
                    ..local
                };
                down_crossing(&nearly).0.clamp(-REACH >> 10, REACH >> 10) << 10
            };
            // What is left of a simple root is about 2 (b2 e / slope)^2 e.
            let reach = match slope.unsigned_abs() >> 24 {
                0 => 1 << 22,
                1..4 => 1 << 23,
                4..16 => 1 << 24,
                _ => 3 << 24,
            };
            let converged = simple && step.unsigned_abs() < reach;
            let small = step.unsigned_abs() < 1 << 22;
            d = d.saturating_add(step);
            if d.unsigned_abs() > REACH as u32 && round < 10 {
                // From far along a long fall by several nodes at once.
                let jump = (high(d, TURNS) + (1 << 25)) >> 26;
                node += jump;
                local = self.local(node);
                d = (d - jump * SPACING).clamp(-REACH, REACH);
            } else if converged || small || round >= 10 {
                d = d.clamp(-REACH, REACH);
                let last = high(curvature + (high(local.cosine, step) >> 5), step) >> 4;
                return Settled {
                    steps: self.steps_to(node) + i64::from((high(d, TURNS) + 2) >> 2),
                    speed: -(slope + last),
                    converged,
                };
            }
        }
    }

    /// The state after a settled impact, which at a graze may have come out at launch or with a speed of 0.
    #[inline(always)]
    pub(super) fn arrival(&self, settled: &Settled, grazes: bool) -> Landing<HybridState> {
        let steps = settled.steps.max(0);
        if settled.speed <= 0 {
            return self.landing(steps, 0, true);
        }
        self.landing(steps, settled.speed as u32, grazes)
    }

    /// Height at `d` (steps of 2^-34) from a node, steps of 2^-30, where it is small.
    #[inline(always)]
    pub(super) fn height(&self, local: &Local, d: i32, powers: &Powers) -> i32 {
        // u1 d + (S - k) d^2/2 - S d^4/24 + C (d - sin d), with |d| < 2^29.
        let bent = (high(local.curvature, powers.versine) >> 2)
            - (high(self.constants.k, powers.flat) >> 2);
        local
            .height
            .saturating_add(high(local.slope, d << 2))
            .saturating_add(bent + (high(local.cosine, powers.lag) >> 2))
    }

    /// Slope gained over `d` from a node, steps of 2^-26.
    #[inline(always)]
    pub(super) fn gain(&self, local: &Local, d: i32, powers: &Powers) -> i32 {
        // (S - k) d - S (d - sin d) + C (1 - cos d).
        (high(local.curvature, d) + (high(local.cosine, powers.versine) >> 4)
            - (high(local.sine, powers.lag) >> 2))
            >> 4
    }
}

/// `u1^2` and `2 (S - k) u0`, whose difference is the discriminant of the local parabola; steps of 2^-52.
#[inline(always)]
fn squares(height: i32, slope: i32, curvature: i32) -> (i64, i64) {
    (
        wide_signed(slope, slope),
        wide_signed(curvature, height) >> 5,
    )
}

/// Root of what is positive of `square`, from steps of 2^-52 to 2^-26, to about 2^-15 of it.
#[inline(always)]
fn square_root(square: i64) -> u32 {
    if square <= 0 {
        0
    } else if square >> 32 == 0 {
        square_root_scaled(square as u32) >> 16
    } else if square >> 48 == 0 {
        square_root_scaled((square >> 16) as u32) >> 8
    } else {
        square_root_scaled((square >> 32) as u32)
    }
}

/// The step to the first down-crossing of the parabola at a node, steps of 2^-24 rad, at most 2.9 rad;
/// to its extremum where there is none, which the second value tells.
#[inline(always)]
fn down_crossing(local: &Local) -> (i32, bool) {
    let Local {
        height,
        slope,
        curvature,
        ..
    } = *local;
    let (square, bend) = squares(height, slope, curvature);
    let discriminant = square - bend;
    let step = if slope < 0 && bend.abs() < square >> 3 {
        // u0 / |u1| (1 + b2 u0 / u1^2).
        let reciprocal = Reciprocal::coarse(slope.unsigned_abs());
        let newton = reciprocal.times(height, 20);
        let bend = reciprocal.times(product_high(curvature, newton), 35);
        newton.saturating_add(product_high(newton, bend) << 2)
    } else {
        let root = square_root(discriminant) as i32;
        if slope > 0 || discriminant <= 0 {
            // -(u1 + r) / (S - k).
            if curvature == 0 {
                return (0, false);
            }
            let step =
                Reciprocal::coarse(curvature.unsigned_abs()).times(slope.saturating_add(root), 26);
            if curvature > 0 { -step } else { step }
        } else {
            // 2 u0 / (r - u1).
            let sum = root as u32 + slope.unsigned_abs();
            if sum == 0 {
                return (0, false);
            }
            Reciprocal::coarse(sum).times(height, 21)
        }
    };
    (
        step.clamp(-(29 << 24) / 10, (29 << 24) / 10),
        discriminant > 0,
    )
}
