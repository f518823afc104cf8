//! Fit of the mixture: weighted non-negative least squares by the active set of Lawson and Hanson
//! (Solving Least Squares Problems, 1974, chapter 23).

use super::super::energy::SECTORS;
use kband::arithmetic::square_root_single;
use kband::regime::gear::GROUPS;

/// Components of the mixture: one per group in gear, two out of gear (apart, merged), and noise.
pub const COMPONENTS: usize = GROUPS + 3;
pub const NOISE_INDEX: usize = GROUPS + 2;

pub type SectorEnergy = [f32; SECTORS];
pub type Covariance = [[f32; COMPONENTS]; COMPONENTS];

/// Energy of each component by sector; rows of a multiple of four allow the compiler to vectorize.
pub type DesignMatrix = [[f32; PADDED_COMPONENTS]; SECTORS];
/// Number of components, rounded up to a multiple of four.
pub const PADDED_COMPONENTS: usize = COMPONENTS.next_multiple_of(4);

/// Moving average over three sectors: the weights of the equations before the first mixture.
pub fn moving_average(measured: &SectorEnergy) -> SectorEnergy {
    core::array::from_fn(|n| {
        (measured[(n + SECTORS - 1) % SECTORS] + measured[n] + measured[(n + 1) % SECTORS]) / 3.0
    })
}

/// Fits the mixture from `start` on: non-negative weights of the rows, and their covariance for a
/// dispersion of 1. `variance`: expected energy of each sector, proportional to it (Poisson).
pub fn fit_mixture(
    measured: &SectorEnergy,
    rows: &DesignMatrix,
    variance: &SectorEnergy,
    start: &[f32; COMPONENTS],
) -> ([f32; COMPONENTS], Covariance) {
    let variance_floor = variance_floor(measured);
    let mut matrix = [[0.0; PADDED_COMPONENTS]; COMPONENTS];
    let mut sums = [0.0; PADDED_COMPONENTS];
    for ((row, variance), measured) in rows.iter().zip(variance).zip(measured) {
        let weight = 1.0 / (variance + variance_floor);
        let weighted = row.map(|part| part * weight);
        for (sum, weighted) in sums.iter_mut().zip(weighted) {
            *sum += weighted * measured;
        }
        for (a, (line, weighted)) in matrix.iter_mut().zip(weighted).enumerate() {
            // Lower triangle, up to the end of the vector of four that holds the diagonal.
            for (product, part) in line.iter_mut().zip(row).take((a | 3) + 1) {
                *product += weighted * part;
            }
        }
    }
    solve(&matrix, &sums, start)
}

/// Lower limit of a sector's expected energy, which keeps its weight finite.
fn variance_floor(measured: &SectorEnergy) -> f32 {
    0.01 / SECTORS as f32 * measured.iter().sum::<f32>() + f32::MIN_POSITIVE
}

pub fn predict_energy(rows: &DesignMatrix, weights: &[f32; COMPONENTS]) -> SectorEnergy {
    rows.map(|row| (row.iter().zip(weights).map(|(part, weight)| part * weight)).sum())
}

/// Weighted residual sum of squares (chi-square for unit dispersion).
pub fn residual_sum([measured, predicted, variance]: [&SectorEnergy; 3]) -> f32 {
    let variance_floor = variance_floor(measured);
    let sectors = measured.iter().zip(predicted).zip(variance);
    sectors
        .map(|((measured, predicted), variance)| {
            (measured - predicted) * (measured - predicted) / (variance + variance_floor)
        })
        .sum()
}

/// Active set of Lawson and Hanson, started at `start`; only the lower triangle of the matrix is
/// read. Returns the weights and their covariance, whose rows and columns of weights at 0 are 0.
fn solve(
    matrix: &[[f32; PADDED_COMPONENTS]; COMPONENTS],
    sums: &[f32; PADDED_COMPONENTS],
    start: &[f32; COMPONENTS],
) -> ([f32; COMPONENTS], Covariance) {
    // Scaled to a diagonal of 1.
    let scale: [f32; COMPONENTS] = core::array::from_fn(|n| {
        if matrix[n][n] > 0.0 {
            1.0 / square_root_single(matrix[n][n])
        } else {
            0.0
        }
    });
    let mut scaled = [[0.0; COMPONENTS]; COMPONENTS];
    for a in 0..COMPONENTS {
        for b in 0..COMPONENTS {
            scaled[a][b] = matrix[a.max(b)][a.min(b)] * scale[a] * scale[b];
        }
        // Tikhonov regularization keeps the matrix invertible.
        scaled[a][a] += 1e-5;
    }
    let sums: [f32; COMPONENTS] = core::array::from_fn(|n| sums[n] * scale[n]);
    let tolerance = 1e-4 * sums.iter().fold(0.0_f32, |largest, sum| largest.max(*sum));
    let mut weights: [f32; COMPONENTS] = core::array::from_fn(|n| {
        if scale[n] > 0.0 {
            // `max` replaces NaN by 0.
            (start[n] / scale[n]).max(0.0)
        } else {
            0.0
        }
    });
    let mut free: [bool; COMPONENTS] = core::array::from_fn(|n| weights[n] > 0.0);
    let mut inverse = [[0.0; COMPONENTS]; COMPONENTS];
    for _ in 0..3 * COMPONENTS {
        loop {
            inverse = invert_free_block(&scaled, &free);
            let mut trial = [0.0; COMPONENTS];
            let (mut step_length, mut blocking) = (1.0_f32, None);
            for a in 0..COMPONENTS {
                trial[a] = (0..COMPONENTS).map(|b| inverse[a][b] * sums[b]).sum();
                if free[a] && trial[a] <= 0.0 {
                    let limit = weights[a] / (weights[a] - trial[a]).max(f32::MIN_POSITIVE);
                    if blocking.is_none() || limit < step_length {
                        (step_length, blocking) = (limit, Some(a));
                    }
                }
            }
            let Some(blocking) = blocking else {
                weights = trial;
                break;
            };
            for a in 0..COMPONENTS {
                if a == blocking {
                    free[a] = false;
                    weights[a] = 0.0;
                } else if free[a] {
                    weights[a] += step_length * (trial[a] - weights[a]);
                }
            }
        }
        let (mut largest_gradient, mut entering) = (tolerance, None);
        for a in 0..COMPONENTS {
            if !free[a] && scale[a] > 0.0 {
                let gradient =
                    sums[a] - ((0..COMPONENTS).map(|b| scaled[a][b] * weights[b])).sum::<f32>();
                if gradient > largest_gradient {
                    (largest_gradient, entering) = (gradient, Some(a));
                }
            }
        }
        let Some(entering) = entering else {
            break;
        };
        for (a, free) in free.iter_mut().enumerate() {
            *free |= a == entering;
        }
    }
    for a in 0..COMPONENTS {
        weights[a] *= scale[a];
        for b in 0..COMPONENTS {
            inverse[a][b] *= scale[a] * scale[b];
        }
    }
    (weights, inverse)
}

/// Inverse of the submatrix of the free weights by Gauss-Jordan elimination; 0 elsewhere.
fn invert_free_block(matrix: &Covariance, free: &[bool; COMPONENTS]) -> Covariance {
    let mut inverse = [[0.0; COMPONENTS]; COMPONENTS];
    for a in 0..COMPONENTS {
        for b in 0..COMPONENTS {
            if free[a] && free[b] {
                inverse[a][b] = matrix[a][b];
            }
        }
    }
    // In place: each eliminated column holds a column of the inverse.
    for a in 0..COMPONENTS {
        if !free[a] {
            continue;
        }
        let pivot = 1.0 / inverse[a][a];
        inverse[a][a] = 1.0;
        let row = inverse[a].map(|part| part * pivot);
        inverse[a] = row;
        for other in 0..COMPONENTS {
            if other != a && free[other] {
                let factor = core::mem::take(&mut inverse[other][a]);
                for (part, row) in inverse[other].iter_mut().zip(row) {
                    *part -= factor * row;
                }
            }
        }
    }
    inverse
}

/// Energy of sectors with few predicted impacts beyond the predicted one and the noise, and that of
/// the noise. A sector has few if at most 1 % of the largest energy is predicted there. The noise is
/// that of the quietest one.
pub fn stray_energy(measured: &SectorEnergy, expected: &SectorEnergy) -> [f32; 2] {
    let least = expected.iter().copied().fold(f32::INFINITY, f32::min);
    let most = expected.iter().copied().fold(0.0, f32::max);
    let pairs = measured.iter().zip(expected);
    let beyond = pairs.filter_map(|(measured, expected)| {
        let impacts = expected - least;
        (impacts <= 0.01 * most).then_some(measured - impacts)
    });
    let noise = beyond.clone().fold(f32::INFINITY, f32::min).max(0.0);
    let (sum, count) = beyond.fold((0.0, 0.0), |(sum, count), energy| {
        (sum + energy, count + 1.0)
    });
    [sum - count * noise, count * noise]
}

/// Half of the sum of absolute differences: energy in other sectors than predicted.
pub fn unexplained_energy(measured: &SectorEnergy, expected: &SectorEnergy) -> f32 {
    let pairs = measured.iter().zip(expected);
    let halves = pairs.map(|(measured, expected)| 0.5 * (measured - expected).abs());
    halves.sum()
}
