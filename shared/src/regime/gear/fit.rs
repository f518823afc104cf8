//! Response surface of the share of time in gear, fitted to short runs by ridge regression.
//!
//! Sources: response surfaces (Box and Wilson, J. R. Stat. Soc. B 13 (1951) 1) and ridge regression
//! (Hoerl and Kennard, Technometrics 12 (1970) 55). The planner begins a new fit for each region.

use crate::arithmetic::square_root_single;

/// Number of coefficients: a quadratic in three coordinates, the cube of the first, and a quadratic
/// of the part's restitution within the lot.
const TERMS: usize = 13;
const TRIANGLE_ENTRIES: usize = TERMS * (TERMS + 1) / 2;

/// Rows of a packed lower triangle; each ends on the diagonal.
fn rows(triangle: &[f32]) -> impl Iterator<Item = &[f32]> {
    let mut rest = triangle;
    (1..=TERMS).map_while(move |length| {
        let (row, after) = rest.split_at_checked(length)?;
        rest = after;
        Some(row)
    })
}

/// Solves `L x = b` by forward substitution, in place.
fn forward_substitute(triangle: &[f32], rhs: &mut [f32]) {
    for (n, row) in rows(triangle).enumerate() {
        let (Some((before, [value, ..])), Some((diagonal, row))) =
            (rhs.split_at_mut_checked(n), row.split_last())
        else {
            return;
        };
        for (factor, previous) in row.iter().zip(&*before) {
            *value -= factor * previous;
        }
        *value /= diagonal;
    }
}

/// Solves `L^T x = b` by back substitution, in place.
fn back_substitute(triangle: &[f32], rhs: &mut [f32; TERMS]) {
    for n in (0..TERMS).rev() {
        // Row n is the first with column n, on the diagonal.
        let mut column = rows(triangle).filter_map(|row| row.get(n));
        let (Some((_, [value, after @ ..])), Some(diagonal)) =
            (rhs.split_at_mut_checked(n), column.next())
        else {
            return;
        };
        for (factor, previous) in column.zip(&*after) {
            *value -= factor * previous;
        }
        *value /= diagonal;
    }
}

/// Normal equations of the fit over k and one tone's amplitude and angle about a centre. The
/// coordinates are normalized to half-widths of the region; an amplitude error may exceed them. The
/// restitution within the lot has terms of its own, with mean 0 over the lot. They remove the
/// effect of the random restitutions.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    /// Packed lower triangle of the normal equations, and their right side.
    normal: [f32; TRIANGLE_ENTRIES],
    rhs: [f32; TERMS],
}

impl Fit {
    /// No run yet.
    pub const EMPTY: Self = Self {
        normal: [0.0; TRIANGLE_ENTRIES],
        rhs: [0.0; TERMS],
    };

    /// Adds a run: its point, its part's normalized restitution in the lot (-1..1, `None` for a
    /// single restitution), its share.
    pub fn add_run(&mut self, point: [f32; 3], lot: Option<f32>, share: f32) {
        let terms = terms(point, lot);
        let mut sums = self.normal.iter_mut();
        for (n, (term, rhs)) in terms.iter().zip(&mut self.rhs).enumerate() {
            // The terms come first in the zip, so that its end consumes no sum of the next row.
            for (other, sum) in terms.iter().take(n + 1).zip(&mut sums) {
                *sum += term * other;
            }
            *rhs += term * share;
        }
    }

    pub fn solve(&self) -> FittedShare {
        // Ridge in runs. It keeps coefficients without data at 0, as of an absent second tone.
        const RIDGE: f32 = 0.3;
        let mut factor = self.normal;
        // Cholesky factorization by rows, then both substitutions.
        let mut begin = 0;
        for n in 0..TERMS {
            let Some((above, [row @ .., diagonal])) = factor
                .get_mut(..=begin + n)
                .and_then(|rows| rows.split_at_mut_checked(begin))
            else {
                break;
            };
            forward_substitute(above, row);
            *diagonal += if n == 0 { 1e-3 } else { RIDGE };
            for factor in &*row {
                *diagonal -= factor * factor;
            }
            *diagonal = square_root_single(diagonal.max(1e-6));
            begin += n + 1;
        }
        let mut coefficients = self.rhs;
        forward_substitute(&factor, &mut coefficients);
        back_substitute(&factor, &mut coefficients);
        FittedShare(coefficients)
    }
}

#[derive(Clone, Copy, Debug)]
pub struct FittedShare([f32; TERMS]);

impl FittedShare {
    /// Mean share at a point whose first coordinate has an error uniform within +-`error`.
    pub fn mean_share(&self, point: [f32; 3], error: f32) -> f32 {
        // With a uniform error d, the mean of (x + d)^2 is x^2 + error^2/3, of (x + d)^3 it is x^3
        // + x error^2.
        let spread = error * error / 3.0;
        let terms = terms(point, None);
        let Self(coefficients) = self;
        let mut sum =
            coefficients[SQUARE_TERM] * spread + coefficients[CUBE_TERM] * 3.0 * point[0] * spread;
        for (factor, term) in coefficients.iter().zip(&terms).take(POINT_TERMS) {
            sum += factor * term;
        }
        sum
    }
}

/// Number of terms of the point; indices of the first coordinate's square and cube.
const POINT_TERMS: usize = 11;
const SQUARE_TERM: usize = 4;
const CUBE_TERM: usize = 10;

fn terms([x, y, z]: [f32; 3], lot: Option<f32>) -> [f32; TERMS] {
    let [first, second] = lot.map_or([0.0; 2], |lot| [lot, lot * lot - 1.0 / 3.0]);
    [
        1.0,
        x,
        y,
        z,
        x * x,
        y * y,
        z * z,
        x * y,
        x * z,
        y * z,
        x * x * x,
        first,
        second,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fitted(runs: u32, noise: f32, lots: bool) -> FittedShare {
        let mut fit = Fit::EMPTY;
        for n in 0..runs {
            let part = |step: u32| 2.0 * (n.wrapping_mul(step) >> 8) as f32 / 16_777_216.0 - 1.0;
            let point = [part(0xD1B5_4A33), part(0xABC9_8388), part(0x8CB9_2BA7)];
            let lot = lots.then(|| part(0x9E37_79B9));
            let of_lot = lot.map_or(0.0, |lot| 0.3 * lot - 0.2 * (lot * lot - 1.0 / 3.0));
            let share = exact_value(point) + of_lot;
            fit.add_run(point, lot, share + noise * part(0x6A09_E667));
        }
        fit.solve()
    }

    fn exact_value([x, y, z]: [f32; 3]) -> f32 {
        0.9 - 0.1 * (x - 0.3) * (x - 0.3) - 0.05 * (y + 0.2 * x) * (y + 0.2 * x) - 0.02 * z * z
            + 0.03 * x * x * x
    }

    #[test]
    fn smooth_share_is_recovered_for_any_lot() {
        for lots in [false, true] {
            let coefficients = fitted(400, 0.0, lots);
            for point in [[0.0; 3], [0.3, -0.1, 0.0], [-0.8, 0.7, 0.9]] {
                let error = coefficients.mean_share(point, 0.0) - exact_value(point);
                assert!(error.abs() < 3e-3, "{lots} {point:?} {error}");
            }
        }
        // Noise of 0.17 RMS in 400 runs leaves a standard error of 0.17 sqrt(13/400) = 0.03. The
        // bound is four of them.
        let error =
            fitted(400, 0.3, true).mean_share([0.3, 0.0, 0.0], 0.0) - exact_value([0.3, 0.0, 0.0]);
        assert!(error.abs() < 0.12, "{error}");
    }
}
