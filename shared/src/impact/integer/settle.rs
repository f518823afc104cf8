//! The root in a bracket with one down-crossing, and the impact near a node to full precision.
//!
//! Simple roots take Chebyshev's method, nearly double roots Cauchy's step (Traub 1964).

use super::ballistic::{Ballistic, Local};
use super::constants::{
    MAX_GRAZING_SPEED, MAX_NODE_DISTANCE, RADIANS_PER_TURN, SPACING, TURNS_PER_RADIAN, turn_steps,
};
use super::search::Bracket;
use crate::arithmetic::fixed::{Fixed, Reciprocal, square_root_scaled};
use crate::arithmetic::{Phase, Velocity};
use crate::impact::kernel::{HybridState, Landing};

/// An impact: steps of a phase after launch, arrival speed, and whether the root is simple.
pub(super) struct Settled {
    pub(super) steps: i64,
    pub(super) speed: Fixed<26>,
    pub(super) converged: bool,
}

/// Step in rad after which only rounding remains.
const MAX_LAST_STEP: Fixed<34> = Fixed::<34>::from_constant(1.0 / 4096.0);

/// The state after an impact at `speed` of at least 0.
#[inline(always)]
pub(super) fn landing(
    flight: &Ballistic<'_>,
    steps: i64,
    speed: Fixed<26>,
    grazes: bool,
) -> Landing<HybridState> {
    let product: Fixed<58, u64> = speed.unsigned().wide(flight.constants.restitution);
    let nearest = product + Fixed::<58, u64>(1 << 31);
    let velocity = Fixed(nearest.to::<26>().0 as u32);
    Landing {
        steps,
        next: HybridState {
            phase: Phase::from_bits(flight.phase.wrapping_add(steps as u32)),
            velocity: Velocity::from_fixed(velocity),
        },
        grazes,
    }
}

/// Approximate root in `bracket`: a node, the flight there, and the root's offset from it.
#[inline(never)]
pub(super) fn solve(flight: &Ballistic<'_>, bracket: Bracket) -> (i32, Local, Fixed<34>) {
    let Bracket {
        mut low,
        mut high,
        start: mut place,
    } = bracket;
    let mut round = 0;
    loop {
        let node = ((place + i64::from(flight.phase) + (1 << 23)) >> 24) as i32;
        let time = flight.steps_to(node);
        let local = flight.local(node);
        // After 60 rounds the bracket's middle, within the reach of the node.
        if round >= 60 {
            let offset = Fixed::<32>((place - time) as i32);
            return (node, local, offset.times(RADIANS_PER_TURN));
        }
        let (step, crosses) = down_crossing(&local);
        let next = time + turn_steps(step);
        let inside = crosses && next >= low - (1 << 16) && next <= high + (1 << 16);
        if inside && step.abs() < MAX_NODE_DISTANCE.to::<24>() {
            return (node, local, step.to());
        }
        if time > low && time < high {
            // The only down-crossing is after every height above 0. Near launch, on a concave rise,
            // even a height rounded below 0 is before it.
            let before = local.height > Fixed::<30>::ZERO
                || (local.curvature < Fixed::<28>::ZERO && local.slope > Fixed::<26>::ZERO);
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
pub(super) fn settle(
    flight: &Ballistic<'_>,
    mut node: i32,
    mut local: Local,
    offset: Fixed<34>,
) -> Settled {
    let mut d = offset.clamp(-MAX_NODE_DISTANCE, MAX_NODE_DISTANCE);
    let mut round = 0;
    loop {
        let (height, slope) = flight.expand(&local, d);
        let curvature = local.curvature_at(d);
        round += 1;
        // 2 (S - k) u0 below u1^2 / 4, with the slope at most 4.
        let low = height.unsigned_abs().to::<16>().min(Fixed(0x7fff));
        let bend: Fixed<28, u32> = curvature.unsigned_abs().to::<12>().short_times(low);
        let slow = slope.unsigned_abs().to::<14>().min(Fixed(0xffff));
        let square: Fixed<28, u32> = slow.short_times(slow);
        let simple = if slope < -MAX_GRAZING_SPEED {
            bend.scaled::<25>() < square.to::<25>()
        } else {
            let (square, bend) = squares(height, slope, curvature);
            slope < Fixed::<26>::ZERO && bend.0.abs() < square.0 >> 2
        };
        let step = if simple {
            let reciprocal = Reciprocal::fine(slope.unsigned_abs());
            let newton: Fixed<34> = reciprocal.times(height);
            // (S - k) e / (2 |u'|).
            let bend: Fixed<29> = reciprocal.times(curvature.times::<34, 30>(newton));
            newton.saturating_add(newton.times(bend.scaled::<30>()))
        } else {
            let nearly = Local {
                height,
                slope,
                curvature,
                ..local
            };
            let farthest = MAX_NODE_DISTANCE.to::<24>();
            let step = down_crossing(&nearly).0;
            step.clamp((-MAX_NODE_DISTANCE).to(), farthest).to()
        };
        // The remaining error of a simple root is about 2 (b2 e / slope)^2 e.
        let reach = match slope.unsigned_abs().to::<2>().0 {
            0 => MAX_LAST_STEP,
            1..4 => Fixed::<34>::from_constant(2.0 / 4096.0),
            4..16 => Fixed::<34>::from_constant(4.0 / 4096.0),
            _ => Fixed::<34>::from_constant(12.0 / 4096.0),
        };
        let size = step.unsigned_abs();
        let converged = simple && size < reach.unsigned();
        let small = size < MAX_LAST_STEP.unsigned();
        d = d.saturating_add(step);
        if d.unsigned_abs() > MAX_NODE_DISTANCE.unsigned() && round < 10 {
            // Far along a long fall it moves by several nodes at once.
            let turns: Fixed<34> = d.times(TURNS_PER_RADIAN);
            let jump = (turns + Fixed::<34>(1 << 25)).to::<8>().0;
            node += jump;
            local = flight.local(node);
            d = (d - Fixed::<34>(jump * SPACING.0)).clamp(-MAX_NODE_DISTANCE, MAX_NODE_DISTANCE);
        } else if converged || small || round >= 10 {
            d = d.clamp(-MAX_NODE_DISTANCE, MAX_NODE_DISTANCE);
            let last = local.mean_curvature(curvature, step).times(step);
            let turns: Fixed<34> = d.times(TURNS_PER_RADIAN);
            let steps = (turns + Fixed::<34>(2)).to::<32>();
            return Settled {
                steps: flight.steps_to(node) + i64::from(steps.0),
                speed: -(slope + last),
                converged,
            };
        }
    }
}

/// The state after a settled impact; at a graze it may have ended at launch or with a speed of 0.
#[inline(always)]
pub(super) fn arrival(
    flight: &Ballistic<'_>,
    settled: &Settled,
    grazes: bool,
) -> Landing<HybridState> {
    let steps = settled.steps.max(0);
    if settled.speed <= Fixed::<26>::ZERO {
        return landing(flight, steps, Fixed::<26>::ZERO, true);
    }
    landing(flight, steps, settled.speed, grazes)
}

/// `u1^2` and `2 (S - k) u0`; their difference is the discriminant of the local parabola.
#[inline(always)]
fn squares(
    height: Fixed<30>,
    slope: Fixed<26>,
    curvature: Fixed<28>,
) -> (Fixed<52, i64>, Fixed<52, i64>) {
    // In 58 places; twice it in 52.
    let Fixed(bend) = curvature.wide::<30, 58>(height);
    (slope.wide(slope), Fixed::<53, i64>(bend >> 5).scaled())
}

/// Square root of `square`, 0 for negative ones, to about 2^-15 of it.
#[inline(always)]
fn square_root(Fixed(square): Fixed<52, i64>) -> Fixed<26, u32> {
    Fixed(if square <= 0 {
        0
    } else if square >> 32 == 0 {
        square_root_scaled(square as u32) >> 16
    } else if square >> 48 == 0 {
        square_root_scaled((square >> 16) as u32) >> 8
    } else {
        square_root_scaled((square >> 32) as u32)
    })
}

/// Cauchy's step in rad to the down-crossing of the parabola at a node, at most 2.9.
///
/// Without a crossing it leads to the extremum, and the second value is false.
#[inline(always)]
fn down_crossing(local: &Local) -> (Fixed<24>, bool) {
    let Local {
        height,
        slope,
        curvature,
        ..
    } = *local;
    let (square, bend) = squares(height, slope, curvature);
    let discriminant = square - bend;
    let step = if slope < Fixed::<26>::ZERO && bend.0.abs() < square.0 >> 3 {
        // u0 / |u1| (1 + b2 u0 / u1^2).
        let reciprocal = Reciprocal::coarse(slope.unsigned_abs());
        let newton: Fixed<24> = reciprocal.times(height);
        let bend: Fixed<29> = reciprocal.times(curvature.times::<24, 20>(newton));
        newton.saturating_add(newton.times(bend.scaled::<30>()))
    } else {
        let root = square_root(discriminant);
        if slope > Fixed::<26>::ZERO || discriminant <= Fixed::<52, i64>::ZERO {
            // -(u1 + r) / (S - k).
            if curvature == Fixed::<28>::ZERO {
                return (Fixed(0), false);
            }
            let reciprocal = Reciprocal::coarse(curvature.unsigned_abs());
            let step = reciprocal.times(slope.saturating_add(root.signed()));
            if curvature > Fixed::<28>::ZERO {
                -step
            } else {
                step
            }
        } else {
            // 2 u0 / (r - u1).
            let sum = root + slope.unsigned_abs();
            if sum == Fixed::<26, u32>::ZERO {
                return (Fixed(0), false);
            }
            let half: Fixed<25> = Reciprocal::coarse(sum).times(height);
            half.scaled()
        }
    };
    let farthest = Fixed::<24>::from_constant(2.9);
    (
        step.clamp(-farthest, farthest),
        discriminant > Fixed::<52, i64>::ZERO,
    )
}
