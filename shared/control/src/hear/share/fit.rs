//! Fit of the mixture: weighted non-negative least squares by the active set of Lawson and Hanson
//! (Solving Least Squares Problems, 1974, chapter 23).

use super::super::energy::SECTORS;
use kband::regime::gear::GROUPS;

/// Components of the mixture: one per group in gear, two out of gear (apart, merged), and noise.
pub const PARTS: usize = GROUPS + 3;
/// Index of the noise component.
pub const NOISE: usize = GROUPS + 2;

pub type Row = [f32; SECTORS];
/// Covariance of the weights.
pub type Covariance = [[f32; PARTS]; PARTS];

/// Energy of each component by sector; lanes of four allow the compiler to vectorize.
pub type Rows = [[f32; LANES]; SECTORS];
/// Number of components, rounded up to a multiple of four.
pub const LANES: usize = PARTS.next_multiple_of(4);

/// Moving average over three sectors: the weights of the equations before the first mixture.
pub fn evened(heard: &Row) -> Row {
    core::array::from_fn(|n| {
        (heard[(n + SECTORS - 1) % SECTORS] + heard[n] + heard[(n + 1) % SECTORS]) / 3.0
    })
}

/// Fits the mixture from `from` on: non-negative weights of the rows, and their covariance for a
/// dispersion of 1. A sector's variance is proportional to its expected energy `by` (Poisson).
pub fn unmix(
    heard: &Row,
    rows: &Rows,
    by: &Row,
    from: &[f32; PARTS],
) -> ([f32; PARTS], Covariance) {
    let least = least(heard);
    let mut matrix = [[0.0; LANES]; PARTS];
    let mut sums = [0.0; LANES];
    for ((row, by), heard) in rows.iter().zip(by).zip(heard) {
        let weight = 1.0 / (by + least);
        let weighed = row.map(|part| part * weight);
        for (sum, weighed) in sums.iter_mut().zip(weighed) {
            *sum += weighed * heard;
        }
        for (a, (line, weighed)) in matrix.iter_mut().zip(weighed).enumerate() {
            // Lower triangle, up to the end of the vector of four that holds the diagonal.
            for (product, part) in line.iter_mut().zip(row).take((a | 3) + 1) {
                *product += weighed * part;
            }
        }
    }
    solve(&matrix, &sums, from)
}

/// Lower limit of a sector's expected energy, which keeps its weight finite.
fn least(heard: &Row) -> f32 {
    0.01 / SECTORS as f32 * heard.iter().sum::<f32>() + f32::MIN_POSITIVE
}

/// Energy by sector that the weights predict.
pub fn mixed(rows: &Rows, weights: &[f32; PARTS]) -> Row {
    rows.map(|row| (row.iter().zip(weights).map(|(part, weight)| part * weight)).sum())
}

/// Weighted residual sum of squares (chi-square for unit dispersion).
pub fn off(heard: &Row, found: &Row, by: &Row) -> f32 {
    let least = least(heard);
    let sectors = heard.iter().zip(found).zip(by);
    sectors
        .map(|((heard, found), by)| (heard - found) * (heard - found) / (by + least))
        .sum()
}

/// Active set of Lawson and Hanson, started at `from`; only the lower triangle of the matrix is
/// read. Returns the weights and their covariance, whose rows and columns of weights at 0 are 0.
fn solve(
    matrix: &[[f32; LANES]; PARTS],
    sums: &[f32; LANES],
    from: &[f32; PARTS],
) -> ([f32; PARTS], Covariance) {
    // Scaled to a diagonal of 1.
    let scale: [f32; PARTS] = core::array::from_fn(|n| {
        if matrix[n][n] > 0.0 {
            1.0 / libm::sqrtf(matrix[n][n])
        } else {
            0.0
        }
    });
    let mut scaled = [[0.0; PARTS]; PARTS];
    for a in 0..PARTS {
        for b in 0..PARTS {
            scaled[a][b] = matrix[a.max(b)][a.min(b)] * scale[a] * scale[b];
        }
        // Tikhonov regularization keeps the matrix invertible.
        scaled[a][a] += 1e-5;
    }
    let sums: [f32; PARTS] = core::array::from_fn(|n| sums[n] * scale[n]);
    let tolerance = 1e-4 * sums.iter().fold(0.0_f32, |most, sum| most.max(*sum));
    let mut weights: [f32; PARTS] = core::array::from_fn(|n| {
        if scale[n] > 0.0 {
            // `max` replaces NaN by 0.
            (from[n] / scale[n]).max(0.0)
        } else {
            0.0
        }
    });
    let mut within: [bool; PARTS] = core::array::from_fn(|n| weights[n] > 0.0);
    let mut inverse = [[0.0; PARTS]; PARTS];
    for _ in 0..3 * PARTS {
        loop {
            inverse = inverted(&scaled, &within);
            let mut tried = [0.0; PARTS];
            let (mut share, mut beyond) = (1.0_f32, None);
            for a in 0..PARTS {
                tried[a] = (0..PARTS).map(|b| inverse[a][b] * sums[b]).sum();
                if within[a] && tried[a] <= 0.0 {
                    let reached = weights[a] / (weights[a] - tried[a]).max(f32::MIN_POSITIVE);
                    if beyond.is_none() || reached < share {
                        (share, beyond) = (reached, Some(a));
                    }
                }
            }
            let Some(beyond) = beyond else {
                weights = tried;
                break;
            };
            for a in 0..PARTS {
                if within[a] {
                    weights[a] += share * (tried[a] - weights[a]);
                }
            }
            for a in 0..PARTS {
                if a == beyond {
                    within[a] = false;
                    weights[a] = 0.0;
                }
            }
        }
        let (mut steepest, mut which) = (tolerance, None);
        for a in 0..PARTS {
            if !within[a] && scale[a] > 0.0 {
                let left = sums[a] - (0..PARTS).map(|b| scaled[a][b] * weights[b]).sum::<f32>();
                if left > steepest {
                    (steepest, which) = (left, Some(a));
                }
            }
        }
        let Some(which) = which else {
            break;
        };
        for (a, within) in within.iter_mut().enumerate() {
            *within |= a == which;
        }
    }
    for a in 0..PARTS {
        weights[a] *= scale[a];
        for b in 0..PARTS {
            inverse[a][b] *= scale[a] * scale[b];
        }
    }
    (weights, inverse)
}

/// Inverse of the submatrix of the free weights by Gauss-Jordan elimination; 0 elsewhere.
fn inverted(matrix: &Covariance, within: &[bool; PARTS]) -> Covariance {
    let mut inverse = [[0.0; PARTS]; PARTS];
    for a in 0..PARTS {
        for b in 0..PARTS {
            if within[a] && within[b] {
                inverse[a][b] = matrix[a][b];
            }
        }
    }
    // In place: each eliminated column holds a column of the inverse.
    for a in 0..PARTS {
        if !within[a] {
            continue;
        }
        let pivot = 1.0 / inverse[a][a];
        inverse[a][a] = 1.0;
        let row = inverse[a].map(|part| part * pivot);
        inverse[a] = row;
        for other in 0..PARTS {
            if other != a && within[other] {
                let factor = core::mem::take(&mut inverse[other][a]);
                for (part, row) in inverse[other].iter_mut().zip(row) {
                    *part -= factor * row;
                }
            }
        }
    }
    inverse
}

/// Half of the sum of absolute differences: energy in other sectors than predicted.
pub fn astray(heard: &Row, expected: &Row) -> f32 {
    let apart = heard.iter().zip(expected).map(|(heard, expected)| {
        let apart = heard - expected;
        0.5 * if apart < 0.0 { -apart } else { apart }
    });
    apart.sum()
}
