//! Heights and slopes of a flight over several tones, and where its parabola falls.

use super::constants::{Constants, Level};
use crate::arithmetic::fixed::{Fixed, wide};
use crate::impact::integer::anchored::{Anchored, Local, Motion};
use crate::impact::integer::approach::{StepsFrom, approach};
use crate::impact::integer::ballistic::product_32;
use crate::impact::integer::constants::{RADIANS_PER_TURN, REACH};
use crate::impact::integer::settle::square_root;

/// What an expansion takes of a track: A'/6 and A''/24 at the node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bends {
    sixth: Fixed<13>,
    part: Fixed<13>,
}

/// A flight.
pub(super) struct Ballistic<'a> {
    pub constants: &'a Constants,
    pub phase: u32,
    /// S at launch.
    pub start: Level,
    pub velocity: Fixed<26, u32>,
    /// Launch velocity in the frame of the feeder, psi + S'.
    pub rise: Fixed<48, i64>,
}

/// Below this the fine height, known modulo 4, is the true one; beyond, the coarse one is taken, clamped below 2.
const FAR: Fixed<27> = Fixed::<27>::of(1.9);

impl Ballistic<'_> {
    /// Mean velocity `v - k d / 2` and velocity `v - k d` after `steps`.
    #[inline(always)]
    fn velocities(&self, steps: i64) -> (Fixed<48, i64>, Fixed<48, i64>) {
        let fall = product_32(steps, self.constants.half_turn_fall);
        let mean = self.rise - fall;
        (mean, mean - fall)
    }

    /// Velocity after `steps`.
    #[inline(always)]
    pub fn falling(&self, steps: i64) -> Fixed<26> {
        self.velocities(steps).1.narrow()
    }

    /// Height over `level` after `steps`, saturating near 2; and velocity.
    #[inline(never)]
    pub fn over(&self, steps: i64, level: Level) -> (Fixed<30>, Fixed<26>) {
        const TURN: i64 = 1 << 32;
        let (mean, velocity) = self.velocities(steps);
        let Fixed(turns) = product_32(steps, mean).to::<32>();
        let height = if turns >= TURN {
            Fixed(i32::MAX)
        } else if turns < -TURN {
            Fixed(-i32::MAX)
        } else {
            // The rise in steps of 2^-60: below 2 pi.
            let mut rise = wide(turns as u32, RADIANS_PER_TURN.0 as u32) as i64;
            if turns < 0 {
                rise -= i64::from(RADIANS_PER_TURN.0) << 32;
            }
            let rise = Fixed::<60, i64>(rise);
            let coarse = rise.narrow::<27>() + self.start.coarse - level.coarse;
            if coarse < FAR && coarse > -FAR {
                rise.narrow::<30>()
                    .wrapping_add(self.start.fine)
                    .wrapping_sub(level.fine)
            } else {
                let most = Fixed::<27>::of(1.99);
                coarse.clamp(-most, most).to()
            }
        };
        (height, velocity.narrow())
    }

    /// The impact of a tall flight, nearly; see the search of the kernels with an FPU.
    #[inline(always)]
    pub fn fall(&self) -> Option<(i32, Fixed<34>)> {
        approach(self, self.crossing(self.constants.tall)?)
    }

    /// Where the parabola crosses height 0 on its fall, if the square of the speed there is at least
    /// `least`.
    #[inline(always)]
    pub fn crossing(&self, least: Fixed<52, i64>) -> Option<StepsFrom<Fixed<29>>> {
        let rise = self.rise.narrow::<26>();
        if rise <= Fixed::<26>::ZERO {
            return None;
        }
        let lift: Fixed<54, i64> = self.constants.k.wide(self.start.coarse);
        let square = rise.wide::<26, 52>(rise) + lift.scaled::<53>().to();
        if square < least {
            return None;
        }
        let rise = rise.unsigned();
        let inverse = self.constants.inverse;
        let speed = square_root(square);
        Some(StepsFrom::fall(
            self.phase,
            rise,
            speed,
            || square,
            inverse,
            Fixed(0),
        ))
    }
}

/// `A' d / 6` and `A'' d^2 / 24`, for d below [`REACH`].
#[inline(always)]
fn bent(bends: Bends, d: Fixed<34>) -> (Fixed<27>, Fixed<27>) {
    let d = d.to::<20>();
    let square: Fixed<26> = d.short_times(d);
    (bends.sixth.short_times(d), bends.part.short_times(square))
}

impl Anchored<27> for Ballistic<'_> {
    type Track = Bends;
    type Height = Fixed<29>;

    #[inline(always)]
    fn phase(&self) -> u32 {
        self.phase
    }

    #[inline(always)]
    fn restitution(&self) -> Fixed<32, u32> {
        self.constants.restitution
    }

    #[inline(always)]
    fn k(&self) -> Fixed<12> {
        self.constants.k.to()
    }

    #[inline(always)]
    fn motion(&self, node: i32, base: Fixed<29>) -> Motion {
        let parts = self.constants.near_node(node);
        let most = Fixed::<13>::of(7.99);
        let curvature = (self.constants.k - parts.push()).to::<13>();
        Motion {
            below: (parts.height().coarse.to::<29>() - base).to(),
            speed: parts.speed().to(),
            curvature: curvature.clamp(-most, most),
        }
    }

    #[inline(never)]
    fn local(&self, node: i32) -> Local<27, Bends> {
        let parts = self.constants.at_node(node);
        let (height, velocity) = self.over(self.steps_to(node), parts.height());
        let part = |value: Fixed<13>, share: Fixed<14>| value.short_times(share);
        Local {
            height,
            slope: velocity - parts.speed(),
            curvature: parts.push() - self.constants.k,
            track: Bends {
                sixth: part(parts.surge().to(), Fixed::<14>::of(1.0 / 6.0)),
                part: part(parts.bend().to(), Fixed::<14>::of(1.0 / 24.0)),
            },
        }
    }

    #[inline(always)]
    fn expanded(&self, local: &Local<27, Bends>, d: Fixed<34>) -> (Fixed<30>, Fixed<26>) {
        let (third, fourth) = bent(local.track, d);
        // u1 + (A - k) d/2 + A' d^2/6 + A'' d^3/24.
        let half = local.curvature.to::<26>().scaled::<27>() + third + fourth;
        let mean = local.slope + half.times::<34, 26>(d);
        // (A - k) d + A' d^2/2 + A'' d^3/6.
        let rate = local.curvature + third.times_integer(3) + fourth.times_integer(4);
        (
            local.height.saturating_add(mean.times(d.to::<36>())),
            local.slope + rate.times(d),
        )
    }

    #[inline(always)]
    fn turned(local: &Local<27, Bends>, d: Fixed<34>) -> Fixed<27> {
        local.curvature + bent(local.track, d).0.times_integer(6)
    }

    #[inline(always)]
    fn bent(local: &Local<27, Bends>, curvature: Fixed<27>, d: Fixed<34>) -> Fixed<27> {
        let d = d.clamp(-REACH, REACH);
        curvature + bent(local.track, d).0.times_integer(3)
    }
}
