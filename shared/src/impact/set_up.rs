//! Set-up constants of the microcontroller kernels, in integers: f64 is slow in software.

use core::f64::consts::TAU;

use crate::arithmetic::positive::{Positive, root, upper};
use crate::arithmetic::{Phase, node, square_root_single};
use crate::feeder::{OutOfRange, accept};

/// 1 in steps of 2^-61.
const ONE: u64 = 1 << 61;

#[derive(Clone, Copy, Debug)]
pub(crate) struct SetUp {
    pub k: Positive,
    /// k, rounded to nearest.
    pub single: f32,
    /// k in steps of 2^-61, which represent every f64 from 0.005 to 4 exactly.
    steps: u64,
    /// Phase where a hump begins, `arcsin k`; a quarter turn if k >= 1.
    pub lift_off: Phase,
    /// Length of a hump, `pi - 2 arcsin k`, in steps of a phase; 0 if k >= 1.
    pub hump: u32,
    /// Slope of the sine at `lift_off`, `sqrt(1 - k^2)`.
    pub lift_off_cosine: Positive,
}

impl SetUp {
    /// The constants for `k`; an error outside 0.005..=4.
    #[inline(always)]
    pub fn build(k: f64) -> Result<Self, OutOfRange> {
        // Positive floats compare like their bits; NaN and negative ones are above.
        if !(0.005_f64.to_bits()..=4.0_f64.to_bits()).contains(&k.to_bits()) {
            accept("k", k, false, "0.005..4")?;
        }
        let k = Positive::from_f64(k);
        let (steps, single) = (k.whole(61), k.single());
        let above = Self {
            k,
            single,
            steps,
            lift_off: Phase::from_bits(1 << 30),
            hump: 0,
            lift_off_cosine: Positive::ZERO,
        };
        if steps >= ONE {
            return Ok(above);
        }
        let (less, more) = (ONE - steps, ONE + steps);
        // Even, so that the root has an integer number of binary places.
        let shift = (less.leading_zeros() - 1) & !1;
        let root = root(upper(less << shift, more << 2));
        let lift_off = arcsine(steps, single, root >> ((shift / 2) & 31));
        Ok(Self {
            lift_off,
            hump: (1_u32 << 31) - 2 * lift_off.bits(),
            lift_off_cosine: Positive::from_many_steps(root, 62 + shift as i32 / 2),
            ..above
        })
    }

    /// Excess of k over 1, at least 0.
    pub fn excess(&self) -> f32 {
        if self.steps > ONE {
            Positive::from_steps(self.steps - ONE, 61).single()
        } else {
            0.0
        }
    }

    /// Smallest squared speed at height 0 of a tall flight, with a margin for rounding. Above it
    /// the speed at every height h exceeds the track's, `sqrt(1 - h^2)`.
    pub fn min_tall_speed_squared(&self) -> Positive {
        const TALL_ROUNDING_MARGIN: u64 = (0.01 * (1_u64 << 60) as f64) as u64;
        let lower = if self.hump > 0 {
            (1 << 60) + upper(2 * self.steps, 2 * self.steps)
        } else {
            self.steps
        };
        Positive::from_many_steps(TALL_ROUNDING_MARGIN + lower, 60)
    }

    /// `1 / k`, rounded to nearest.
    pub fn inverse(&self) -> f32 {
        self.k.inverse_single(self.single)
    }
}

/// Phase of a `sine` < 1 in steps of 2^-61, given approximately as f32 and with its cosine in steps
/// of 2^-62. From the nearest node by `sin(a - b) = sin a cos b - cos a sin b`; the error before
/// rounding is below 5e-7 steps.
#[inline(always)]
fn arcsine(sine: u64, single: f32, cosine: u64) -> Phase {
    /// `x` in steps of 2^-`places`.
    const fn to_steps(x: f64, places: i32) -> u64 {
        Positive::from_f64(x).nearest(places)
    }
    let high = |a: u32, b: u32| ((u64::from(a) * u64::from(b)) >> 32) as u32;
    let nearest = (nodes(single) as usize).min(QUARTER_NODES);
    let [below, beside] = [
        node::QUARTER_SINES[nearest],
        node::QUARTER_SINES[QUARTER_NODES - nearest],
    ];
    // In steps of 2^-61, below 2^-6.
    let difference = upper(2 * sine, beside) as i64 - upper(cosine, below) as i64;
    let x = difference.unsigned_abs();
    // Excess of the arc over its sine, from 32 bits: x in steps of 2^-38, its square of 2^-44, its
    // cube of 2^-50.
    let short = (x >> 23) as u32;
    let square = high(short, short);
    let fifth =
        to_steps(3.0 / 40.0, 32) as u32 + (high(square, to_steps(15.0 / 336.0, 32) as u32) >> 12);
    let third = to_steps(1.0 / 6.0, 34) as u32 + (high(square, fifth) >> 10);
    let more = high(high(square, short), third);
    // Turns in steps of 2^-63.
    let turns = upper(x + (u64::from(more) << 9), to_steps(1.0 / TAU, 66));
    let from = (nearest as u64) << 55;
    let angle = if difference < 0 {
        from - turns
    } else {
        from + turns
    };
    Phase::from_bits(((angle + (1 << 30)) >> 31) as u32)
}

const QUARTER_NODES: usize = node::COUNT / 4;

/// The node nearest to the arcsine of `x`, plus a half; error 0.002 (Abramowitz & Stegun 4.4.45).
#[inline(always)]
fn nodes(x: f32) -> f32 {
    const fn in_nodes(x: f64) -> f32 {
        (x * (node::COUNT as f64 / TAU)) as f32
    }
    let sum = ((in_nodes(-0.018_729_3) * x + in_nodes(0.074_261_0)) * x + in_nodes(-0.212_114_4))
        * x
        + in_nodes(1.570_728_8);
    (QUARTER_NODES as f32 + 0.5) - square_root_single(1.0 - x) * sum
}
