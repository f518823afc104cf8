//! Approach in 15 bits: Chebyshev's method (Traub 1964) on nodes, from the fall or from the cubic
//! near launch.

use core::f64::consts::{PI, TAU};

use super::ballistic::Ballistic;
use super::constants::HALF_RADIAN;
use crate::arithmetic::fixed::{Fixed, Reciprocal, square_root_scaled};
use crate::arithmetic::node;

/// Start of the steps: a node, `late` rad after the part fell through height `base` at `speed`.
pub(super) struct StepsFrom {
    pub node: i32,
    pub late: Fixed<17>,
    pub speed: Fixed<13>,
    pub base: Fixed<30>,
}

/// Node spacing in rad.
const SPACING: Fixed<17> = Fixed::<17>::from_constant(node::SPACING);
/// Nodes in a radian.
const NODES_PER_RADIAN: Fixed<6> = Fixed::<6>::from_constant(node::COUNT as f64 / TAU);
/// Longest last step in rad; after it settling uses all digits.
const MAX_LAST_STEP: Fixed<16> = Fixed::<16>::from_constant(0.03967);

/// The node nearest to a time in turns, and its distance in rad from that time.
#[inline(always)]
fn nearest_node(time: Fixed<18>) -> (i32, Fixed<17>) {
    let Fixed(node) = (time + Fixed::<18>(1 << 9)).to::<8>();
    let half_turns = (Fixed::<8>(node).to::<18>() - time).scaled::<17>();
    (node, half_turns.short_times(Fixed::<10>::from_constant(PI)))
}

impl StepsFrom {
    /// The start `near` rad after a launch at `phase` and height `base`.
    #[inline(always)]
    pub(super) fn launch(phase: u32, near: Fixed<17>, speed: Fixed<13>, base: Fixed<30>) -> Self {
        let turns = near
            .to::<14>()
            .short_times(Fixed::<17>::from_constant(1.0 / TAU));
        let (node, late) = nearest_node(phase_in_turns(phase).signed() + turns);
        Self {
            node,
            late: near + late,
            speed,
            base,
        }
    }

    /// The start where a part falls through height 0, from a launch at `phase` with velocity
    /// `rise`.
    ///
    /// `speed` is the approximate speed there, `square` its square, `inverse` the time in turns per
    /// velocity lost.
    #[inline(always)]
    pub(super) fn fall(
        phase: u32,
        rise: Fixed<26, u32>,
        mut speed: Fixed<26, u32>,
        square: impl FnOnce() -> Fixed<52, i64>,
        inverse: Fixed<24, u32>,
        base: Fixed<30>,
    ) -> Self {
        let time_of = |speed: Fixed<26, u32>| -> Fixed<18, u32> {
            let turns: Fixed<50, u64> = (rise + speed).wide(inverse);
            Fixed(turns.to::<18>().0 as u32)
        };
        let mut turns = time_of(speed);
        if turns > Fixed::<18, u32>::from_constant(3.0) {
            // A long flight amplifies the error of the root: one step of Heron's method.
            let reached = Fixed::<52, i64>(speed.wide::<26, 52>(speed).0 as i64);
            let rest = (square() - reached).narrow::<30>();
            let gain: Fixed<25> = Reciprocal::coarse(speed).times(rest);
            speed = Fixed(speed.0.saturating_add_signed(gain.scaled::<26>().0));
            turns = time_of(speed);
        }
        let (node, late) = nearest_node(phase_in_turns(phase).wrapping_add(turns).signed());
        Self {
            node,
            late,
            speed: speed.to::<13>().signed(),
            base,
        }
    }
}

/// A phase in turns.
#[inline(always)]
fn phase_in_turns(phase: u32) -> Fixed<18, u32> {
    Fixed::<32, u32>(phase).to()
}

/// Time in rad, from `minimum` to 4, at which the height `d (psi - a1 d + a2 d^2)` returns to 0.
///
/// `Some(None)` where it does not return so soon, `None` where it returns sooner.
#[inline(always)]
pub(super) fn near_launch(
    a1: Fixed<15>,
    a2: Fixed<15>,
    psi: Fixed<15>,
    minimum: Fixed<17>,
) -> Option<Option<Fixed<17>>> {
    let square: Fixed<29> = a1.short_times(a1);
    let product: Fixed<30> = a2.short_times(psi);
    let discriminant = square - product.scaled::<28>().to::<29>();
    let zero = Fixed::<15>::ZERO;
    let falls = a1 > zero && discriminant > -square.to::<25>().scaled();
    if !falls && (a1 > zero || a2 >= zero) {
        return Some(None);
    }
    let positive = discriminant.max(Fixed::<29>::ZERO).to::<28>();
    let root = positive.unsigned().root::<15>().signed();
    let (over, under) = if falls {
        (psi + psi, a1 + root)
    } else {
        (root - a1, -(a2 + a2))
    };
    if under <= zero {
        return None;
    }
    let near: Fixed<17> = Reciprocal::coarse(under.unsigned()).times(over);
    if near < minimum {
        return None;
    }
    Some(Some(near).filter(|near| *near < Fixed::<17>::from_constant(4.0)))
}

/// Steps on nodes until one is short: a node and the distance from it in rad.
#[inline(never)]
pub(super) fn approach(flight: &Ballistic<'_>, from: StepsFrom) -> Option<(i32, Fixed<34>)> {
    let StepsFrom {
        mut node,
        mut late,
        speed,
        base,
    } = from;
    let k = flight.constants.k.to::<12>();
    for _ in 0..8 {
        let motion = flight.motion(node, base);
        let fall = k.wrapping_times::<17, 13>(late) + speed;
        // Below 8 in size.
        let mean = (speed + fall).to::<12>().scaled::<13>();
        let fallen: Fixed<16> = mean.wrapping_times(late.to::<15>());
        let u0 = fallen + motion.below;
        let u1 = fall + motion.speed;
        if u1 < Fixed::<13>::from_constant(1.0 / 32.0) {
            return None;
        }
        // Newton's step and the quadratic correction b2 u0 / u1^2.
        let reciprocal = Reciprocal::short(u1.unsigned());
        let one = Fixed::<16>::ONE;
        let newton: Fixed<16> = reciprocal.short_times(u0, one);
        let ratio: Fixed<16> = reciprocal.short_times(newton, one + one);
        let twice: Fixed<15> = motion.curvature.short_times(ratio.to::<14>());
        let half = Fixed::<15>::from_constant(0.5);
        let bend = twice.to::<14>().scaled::<15>().clamp(-half, half);
        let step = -(newton + newton.short_times(bend));
        let nodes: Fixed<22> = step.short_times(NODES_PER_RADIAN);
        let jump = (nodes + Fixed::<22>::from_constant(0.5)).to::<0>().0;
        node += jump;
        let distance = Fixed::<17>(jump * SPACING.0);
        if step.unsigned_abs() < MAX_LAST_STEP.unsigned() {
            return Some((node, (step - distance.to::<16>()).to()));
        }
        late = late + distance;
    }
    None
}

impl Ballistic<'_> {
    /// Node and offset near the impact of a tall flight, see `anchor/approach.rs`.
    #[inline(always)]
    pub(super) fn fall(&self) -> Option<(i32, Fixed<34>)> {
        let crossing = self.crossing(self.constants.min_tall_speed_squared)?;
        approach(self, crossing)
    }

    /// Launch velocity in the frame of the feeder, in `b w`.
    #[inline(always)]
    fn rise(&self) -> Fixed<26> {
        self.velocity.signed() + self.cosine.to()
    }

    /// Crossing of height 0 on the parabola's fall, if the squared speed there is at least
    /// `minimum`.
    #[inline(always)]
    pub(super) fn crossing(&self, minimum: Fixed<27>) -> Option<StepsFrom> {
        let constants = self.constants;
        let Fixed(rise) = self.rise();
        if rise <= 0 {
            return None;
        }
        // The velocity in 15 bits, steps of 2^-scale, its square in 32 with room for 2 k.
        let mut scale = 14;
        while rise >> (26 - scale) > 0x7fff {
            scale -= 1;
        }
        let v = (rise >> (26 - scale)) as u32;
        let shift = 28 - 2 * scale;
        // 2 k sin, for the squared speed at the top of the track and at height 0.
        let lift = constants.k.times::<30, 28>(self.sine).scaled::<27>();
        let needed = minimum.wrapping_sub(lift).0 as u32;
        if lift < minimum && (v * v) >> 1 < needed >> shift {
            return None;
        }
        let square = (v * v).wrapping_add(((lift.0 >> shift) << 1) as u32);
        let rise = Fixed::<26, u32>(rise as u32);
        let speed = Fixed::<26, u32>(square_root_scaled(square) >> (scale - 10));
        let square = || {
            Fixed::<52, i64>(rise.wide::<26, 52>(rise).0 as i64)
                + Fixed::<27, i64>(i64::from(lift.0)).to()
        };
        let inverse = constants.inverse;
        Some(StepsFrom::fall(
            self.phase,
            rise,
            speed,
            square,
            inverse,
            Fixed(0),
        ))
    }

    /// Approximate place of a low flight's first impact, see `anchor/candidate.rs`.
    #[inline(always)]
    pub(super) fn candidate(&self) -> Option<(i32, Fixed<34>)> {
        // Half the pull, a sixth of the cosine, the velocity.
        let pull: Fixed<28> = self.constants.k - self.sine.to();
        let a1 = pull.to::<14>().scaled::<15>();
        let a2: Fixed<15> = self
            .cosine
            .to::<15>()
            .short_times(Fixed::<16>::from_constant(1.0 / 6.0));
        if a1.unsigned_abs() < Fixed::<15, u32>::from_constant(1.0)
            && self.velocity < Fixed::<26, u32>::from_constant(1.5)
        {
            let psi = self.velocity.to::<15>().signed();
            if let Some(near) = near_launch(a1, a2, psi, Fixed::<17>::from_constant(1.0 / 8.0))? {
                let speed = -self.rise().to::<13>();
                return approach(self, StepsFrom::launch(self.phase, near, speed, self.sine));
            }
        }
        let crossing = self.crossing(Fixed::<27>::from_constant(0.1))?;
        // A root more than half a rad before the crossing does not belong to a fall.
        let limit = self.constants.limit(self.phase) + HALF_RADIAN;
        (self.steps_to(crossing.node) < limit)
            .then(|| approach(self, crossing))
            .flatten()
    }
}
