//! Short hops over several tones, below 1/16 rad, in a form that keeps every digit.

use super::constants::Parts;
use super::flight::Ballistic;
use crate::arithmetic::fixed::{Fixed, Reciprocal, high, wide, wide_signed};
use crate::impact::integer::constants::TURNS_PER_RADIAN;

/// The longest short hop, in rad.
pub(super) const LONGEST: Fixed<34> = Fixed::<34>::of(1.0 / 16.0);

/// A hop of so many rad in steps of a phase.
#[inline(always)]
pub(super) fn steps_of(d: Fixed<34>) -> i64 {
    let turns: Fixed<34> = d.times(TURNS_PER_RADIAN);
    i64::from((turns + Fixed::<34>(2)).to::<32>().0)
}

/// The flight near launch: its height is `d (2 psi - d G) / 2` with
/// `G = k - A - A' d/3 - A'' d^2/12 - A''' d^3/60 - ...`. How many places its numbers have is known as it flies
/// only.
#[derive(Clone, Copy)]
pub(super) struct Near {
    /// `k - A` at launch: steps of 2^(down - 30).
    pull: i32,
    /// A'/3, A''/12, A'''/60, A''''/360, and the fifth over 2520.
    terms: (Fixed<28>, Fixed<28>, Fixed<15>, Fixed<15>, Fixed<15>),
    /// 2 psi, steps of 2^(down - 64), at most 1/4 (4 where `down` is 4), which no short hop reaches.
    twice: i64,
    /// psi.
    velocity: Fixed<26, u32>,
    down: u32,
}

/// A hop: its duration in rad and arrival speed.
pub(super) struct Hop {
    pub duration: Fixed<34>,
    pub arrival: Fixed<26>,
}

/// Height and slope of the gap near launch.
pub(super) struct Gap {
    pub height: Fixed<30>,
    pub slope: Fixed<26>,
}

impl Near {
    pub fn new(flight: &Ballistic<'_>, parts: &Parts, throws: bool) -> Self {
        let far = flight.constants.k - parts.push();
        let near = Fixed::<27>::of(0.02);
        let fine = if far < near && far > -near {
            flight.constants.fine_pull(flight.phase)
        } else {
            flight.constants.pull(parts)
        };
        // At lift-off itself the pull must not be rounded against the phase, nor to 0.
        let one = Fixed::<27>::of(1.0);
        let (pull, down) = if far < one && far > -one {
            (fine.0, 0)
        } else {
            (far.to::<26>().0, 4)
        };
        let pull = if throws { pull.min(-1) } else { pull.max(1) };
        let (third, fourth, fifth) = parts.higher();
        let share = |value: Fixed<14>, part: Fixed<14>| value.short_times::<14, 15>(part);
        Self {
            pull,
            terms: (
                parts.surge().times(Fixed::<32>::of(1.0 / 3.0)),
                parts.bend().times(Fixed::<32>::of(1.0 / 12.0)),
                share(third.to::<12>().scaled(), Fixed::<14>::of(4.0 / 60.0)),
                share(fourth.to::<10>().scaled(), Fixed::<14>::of(16.0 / 360.0)),
                share(fifth.to::<8>().scaled(), Fixed::<14>::of(64.0 / 2520.0)),
            ),
            twice: i64::from(flight.velocity.0.min(1 << (23 + down))) << (39 - down),
            velocity: flight.velocity,
            down,
        }
    }

    /// `G` and the derivative of `d G` at `d`, at most [`LONGEST`].
    #[inline(always)]
    fn mean_and_slope(&self, d: Fixed<34>) -> (i32, i32) {
        let (g1, g2, g3, g4, g5) = self.terms;
        // Fourteen and twelve bits of d are enough for the higher terms.
        let times = |x: Fixed<15>| x.short_times::<18, 15>(d.to());
        let second = g2 + times(g3 + times(g4 + times(g5))).to();
        let mean: Fixed<30> = (g1 + second.times::<34, 28>(d)).times(d);
        let times = |x: Fixed<15>| x.short_times::<16, 15>(d.to());
        let inner = times(g4.times_integer(5) + times(g5.times_integer(6)));
        let inner = times(g3.times_integer(4) + inner);
        let second = g2.to::<26>().times_integer(3) + inner.to();
        let slope: Fixed<30> = (g1.scaled::<27>().to::<26>() + second.times::<34, 26>(d)).times(d);
        (
            self.pull - (mean.0 >> self.down),
            self.pull - (slope.0 >> self.down),
        )
    }

    /// `2 psi - d G`, steps of 2^(down - 64).
    #[inline(always)]
    fn rest(&self, d: Fixed<34>, mean: i32) -> i64 {
        self.twice - wide_signed(d.0, mean)
    }

    /// Newton's step from `d` to where `d G` reaches 2 psi, for a slope above 0.
    #[inline(always)]
    fn newton(rest: i64, slope: i32) -> Fixed<34> {
        // As if `down` were 0: what it is cancels.
        let reciprocal = Reciprocal::coarse(Fixed::<30, u32>(slope as u32));
        // So that the shortest hops from rest keep their digits.
        if rest == i64::from(rest as i32) {
            return reciprocal.times(Fixed::<64>(rest as i32));
        }
        // A saturated one still leads towards the root.
        let rest = (rest >> 24).clamp(-i64::from(i32::MAX), i64::from(i32::MAX)) as i32;
        reciprocal.times(Fixed::<40>(rest))
    }

    /// Whether a step is the last.
    #[inline(always)]
    fn ends(step: Fixed<34>, d: Fixed<34>) -> bool {
        step.unsigned_abs() <= d.to::<22>().unsigned_abs().scaled()
    }

    /// The hop that ends with a last `step` at `duration`, from the slope of `d G` before it.
    #[inline(always)]
    fn ended(&self, duration: Fixed<34>, step: Fixed<34>, slope: i32) -> Hop {
        // u' = -d (d G)' / 2 at the root; half a step rounds.
        let turned: Fixed<30> = self.terms.0.scaled::<27>().times(step);
        let slope = (slope - (turned.0 >> self.down)).max(0);
        let up = 7 - self.down;
        Hop {
            duration,
            arrival: Fixed((high(duration.0, slope) + (1 << (up - 1))) >> up),
        }
    }

    /// Where the first terms lead from launch; `None` beyond the longest hop and in a hump.
    #[inline(always)]
    pub fn first(&self) -> Option<Fixed<34>> {
        if self.pull <= 0 {
            return None;
        }
        let reciprocal = Reciprocal::fine(Fixed::<30, u32>(self.pull as u32));
        // 2 psi / pull.
        let ratio = wide(self.velocity.0, reciprocal.mantissa);
        let shift = (23 + self.down).checked_sub(reciprocal.shift)?;
        let first = ratio >> shift;
        if first >= u64::from(LONGEST.unsigned().0) {
            return None;
        }
        let first = Fixed::<34>(first as i32);
        // d = z (1 + e + 2 e^2) with z = 2 psi / pull, e = A' z / (3 pull).
        let turned = self.terms.0.times::<34, 30>(first).0 >> self.down;
        let bend: Fixed<30> = reciprocal.times(Fixed::<30>(turned));
        // Larger, the first terms say nothing.
        (bend.abs() < Fixed::<30>::of(1.0 / 16.0)).then(|| {
            let square: Fixed<30> = bend.times(bend);
            first + first.times(bend + square + square)
        })
    }

    /// A hop by Newton's steps from near it.
    #[inline(always)]
    pub fn hop(&self, mut d: Fixed<34>) -> Option<Hop> {
        for _ in 0..6 {
            let (mean, slope) = self.mean_and_slope(d);
            // Where it turns the stretch has to be known.
            if slope <= self.pull >> 2 {
                return None;
            }
            let step = Self::newton(self.rest(d, mean), slope);
            d = d.saturating_add(step).max(Fixed::<34>::ZERO);
            if d >= LONGEST {
                return None;
            }
            if Self::ends(step, d) {
                return Some(self.ended(d, step, slope));
            }
        }
        None
    }

    /// The hop that ends between `low` and `high`, at most [`LONGEST`], where the gap is above 0 and below.
    #[inline(never)]
    pub fn hop_between(&self, mut low: Fixed<34>, mut high: Fixed<34>) -> Hop {
        let mut d = self
            .first()
            .filter(|&d| d > low && d < high)
            .unwrap_or(Fixed((low.0 + high.0) / 2));
        let mut round = 0;
        loop {
            let (mean, slope) = self.mean_and_slope(d);
            let rest = self.rest(d, mean);
            if rest > 0 {
                low = d;
            } else {
                high = d;
            }
            let step = if slope > 0 {
                Self::newton(rest, slope)
            } else {
                Fixed(i32::MAX)
            };
            let next = d.saturating_add(step);
            let inside = slope > 0 && next >= low && next <= high;
            round += 1;
            if inside && Self::ends(step, next) || round >= 80 || high.0 - low.0 <= 1 {
                let next = if inside { next } else { high };
                let last = Fixed(next.0 - d.0);
                return self.ended(next, last, slope);
            }
            d = if inside && round < 40 {
                next
            } else {
                Fixed((low.0 + high.0) / 2)
            };
        }
    }

    /// The gap after `d`, at most [`LONGEST`]: of the sign that all digits say.
    #[inline(always)]
    pub fn gap(&self, d: Fixed<34>) -> Gap {
        let (mean, slope) = self.mean_and_slope(d);
        let rest = self.rest(d, mean);
        // In steps of 2^(down - 32), its upper half.
        let upper = (rest >> 32) as i32;
        // u = d rest / 2, u' = rest / 2 - d (d G)' / 2.
        let height = (high(upper, d.0) >> (5 - self.down)).max(i32::from(rest > 0));
        let speed = (upper >> (7 - self.down)) - (high(d.0, slope) >> (7 - self.down));
        Gap {
            height: Fixed(if rest <= 0 { height.min(0) } else { height }),
            slope: Fixed(speed),
        }
    }
}
