//! Table of sine and cosine at the 256 nodes `2 pi j / 256` of a turn.
//!
//! Each kernel evaluates the track at the nearest node and adds a short polynomial over at most
//! half a spacing (0.0123 rad). So no impact needs a trigonometric call. The compiler computes the
//! tables from the Taylor series in twofold arithmetic.

use core::f64::consts::TAU;

use super::fixed::Fixed;
use super::twofold::Twofold;

pub(crate) const COUNT: usize = 256;

/// Spacing of the nodes in rad.
pub(crate) const SPACING: f64 = TAU / COUNT as f64;

/// Upper 26 bits of the spacing; products with numbers up to 2^27 are exact.
pub(crate) const SPACING_HIGH: f64 = f64::from_bits(SPACING.to_bits() & !((1 << 27) - 1));

/// Exact spacing minus [`SPACING_HIGH`].
pub(crate) const SPACING_LOW: f64 = (SPACING - SPACING_HIGH) + SPACING_REST;

/// Exact spacing minus [`SPACING`].
pub(crate) const SPACING_REST: f64 = PI_REST / 128.0;

/// pi minus `PI`.
const PI_REST: f64 = 1.224_646_799_147_353_2e-16;

/// (sine, cosine) at each node, nearest f64.
pub(crate) static SINE_COSINE_DOUBLE: [[f64; 2]; COUNT] = TABLES.double;

/// The phase of each node in rad as a sum: its number times [`SPACING_HIGH`], exactly, and times
/// [`SPACING_LOW`].
pub(crate) static NODE_PHASES: [[f64; 2]; COUNT] = TABLES.phases;

/// (sine, cosine) at each node, nearest f32.
pub(crate) static SINE_COSINE_SINGLE: [[f32; 2]; COUNT] = TABLES.single;

/// Sine at the nodes of the first quarter turn with both ends, in steps of 2^-63.
pub(crate) static QUARTER_SINES: [u64; COUNT / 4 + 1] = {
    const STEPS: f64 = (1_u64 << 63) as f64;
    let mut table = [0; COUNT / 4 + 1];
    let mut j = 0;
    while j <= COUNT / 4 {
        let Twofold { high, low } = TWOFOLD_NODES[j][0];
        // Below 1 `high` is a whole number of steps, or differs from one by less than a step.
        let whole = (high * STEPS) as u64;
        let rest = (high * STEPS - whole as f64) + low * STEPS;
        table[j] =
            whole.wrapping_add_signed(if rest < 0.0 { rest - 0.5 } else { rest + 0.5 } as i64);
        j += 1;
    }
    table
};

/// Sine and cosine at a node, from [`QUARTER_SINES`].
pub(crate) fn sine_cosine(node: u32) -> [Fixed<60, i64>; 2] {
    let place = node as usize % (COUNT / 4);
    let quarter = [QUARTER_SINES[place], QUARTER_SINES[COUNT / 4 - place]];
    let [sine, cosine] = quarter.map(|steps| Fixed((steps >> 3) as i64));
    match node as usize / (COUNT / 4) % 4 {
        0 => [sine, cosine],
        1 => [cosine, -sine],
        2 => [-sine, -cosine],
        _ => [-cosine, sine],
    }
}

struct Tables {
    double: [[f64; 2]; COUNT],
    phases: [[f64; 2]; COUNT],
    single: [[f32; 2]; COUNT],
}

const TABLES: Tables = {
    let mut tables = Tables {
        double: [[0.0; 2]; COUNT],
        phases: [[0.0; 2]; COUNT],
        single: [[0.0; 2]; COUNT],
    };
    let mut j = 0;
    while j < COUNT {
        let [sine, cosine] = [TWOFOLD_NODES[j][0].high, TWOFOLD_NODES[j][1].high];
        tables.double[j] = [sine, cosine];
        tables.phases[j] = [j as f64 * SPACING_HIGH, j as f64 * SPACING_LOW];
        tables.single[j] = [sine as f32, cosine as f32];
        j += 1;
    }
    tables
};

/// Sine and cosine of `x` in 0..=pi/4 by their Taylor series.
const fn series(x: Twofold) -> [Twofold; 2] {
    let square = x.times(x).negative();
    let one = Twofold::from(1.0);
    let (mut sine, mut cosine) = (one, one);
    let mut n = 28.0;
    while n > 0.0 {
        cosine = one.plus(square.times(cosine).over(n * (n - 1.0)));
        sine = one.plus(square.times(sine).over(n * (n + 1.0)));
        n -= 2.0;
    }
    [x.times(sine), cosine]
}

const TWOFOLD_NODES: [[Twofold; 2]; COUNT] = {
    // 2 pi / 256 to 107 bits.
    let spacing = Twofold {
        high: SPACING,
        low: SPACING_REST,
    };
    let mut table = [[Twofold::from(0.0); 2]; COUNT];
    let mut j = 0;
    while j <= 32 {
        let [sine, cosine] = series(spacing.times(Twofold::from(j as f64)));
        table[j] = [sine, cosine];
        table[64 - j] = [cosine, sine];
        j += 1;
    }
    let mut j = 0;
    while j < 192 {
        let [sine, cosine] = table[j];
        table[j + 64] = [cosine, sine.negative()];
        j += 1;
    }
    table
};
