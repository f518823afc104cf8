//! Fits a train of impacts with one common damped ringing to an average, by linear least squares.
//!
//! Eight unknowns: complex height of the ringing, its derivative by decay and frequency
//! (Gauss-Newton step), and a cubic for the drive's remainder. They are solved by elimination.

use crate::angle::phase_of;
use crate::hear::{HighPass, OnsetDetector};
use crate::saturate::saturate;
use kband::arithmetic::sine_cosine_single;
use num_complex::Complex32 as Complex;

/// Number of columns: ringing and derivative, each in and out of phase, and a cubic.
const COLUMNS: usize = 8;
/// Index of the first column of the cubic.
const FIRST_CUBIC_COLUMN: usize = 4;
/// Corner of the high-passes that filtered the average.
const CORNER: f32 = OnsetDetector::CORNER as f32;
/// Scale of the derivative's columns, which makes them as large as the ringing's own.
const DERIVATIVE_SCALE: f32 = 0.01;
/// Pivot up to which a column is linearly dependent and left out.
const MIN_PIVOT: f32 = 1e-9;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ringing {
    /// Decay rate of the height per sample: positive.
    pub decay: f32,
    /// Angular frequency, in rad per sample.
    pub angle: f32,
}

impl Ringing {
    /// Complex amplitude after some samples, over the initial one.
    fn after(self, samples: f32) -> Complex {
        let (sine, cosine) = sine_cosine_single(phase_of(self.angle * samples));
        let decayed = libm::expf(-self.decay * samples);
        Complex::new(cosine, sine) * decayed
    }

    /// Limits this ringing to the trust region around another one, where the linearization holds.
    fn limit_to(self, other: Self) -> Self {
        let decay = saturate(self.decay, 0.5 * other.decay, 2.0 * other.decay);
        let angle = saturate(self.angle, other.angle - 0.1, other.angle + 0.1);
        Self {
            decay: saturate(decay, 0.002, 0.5),
            angle: saturate(angle, 0.05, 3.1),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainFit {
    pub residual_sum: f32,
    /// Residual sum of squares without any impact.
    pub baseline_sum: f32,
    /// Improved ringing after one Gauss-Newton step.
    pub refined: Ringing,
    /// Complex height of the ringing at unit strength.
    height: Complex,
}

/// Impact: time in samples from the beginning of the average, and strength.
pub type Pulse = (f32, f32);

/// Ringing of a train and its derivative by decay and frequency, sample by sample.
struct TrainRinging<'a> {
    impacts: core::slice::Iter<'a, Pulse>,
    ringing: Ringing,
    turn: Complex,
    now: Complex,
    change: Complex,
    sample: f32,
}

impl<'a> TrainRinging<'a> {
    fn new(ringing: Ringing, train: &'a [Pulse]) -> Self {
        Self {
            impacts: train.iter(),
            ringing,
            turn: ringing.after(1.0),
            now: Complex::default(),
            change: Complex::default(),
            sample: 0.0,
        }
    }

    #[inline(always)]
    fn next(&mut self) -> (Complex, Complex) {
        self.change = (self.change + self.now) * self.turn;
        self.now *= self.turn;
        let sample = self.sample;
        while let Some(&(time, strength)) = self.impacts.as_slice().first() {
            if time > sample {
                break;
            }
            self.impacts.next();
            let since = sample - time;
            let new = self.ringing.after(since) * strength;
            self.now += new;
            self.change += new * since;
        }
        self.sample = sample + 1.0;
        (self.now, self.change)
    }
}

/// Fits a train of impacts in order of time to an average with `stride` samples per bin.
///
/// `tuned` adds the derivative's columns, which improve the ringing.
#[inline(never)]
pub fn fit_train(
    residual: &[f32],
    stride: u32,
    ringing: Ringing,
    tuned: bool,
    train: &[Pulse],
) -> TrainFit {
    let mut ringing_train = TrainRinging::new(ringing, train);
    let mut passes = [HighPass::<Complex>::default(); 4];
    let mut matrix = [[0.0_f32; COLUMNS]; COLUMNS];
    let mut sums = [0.0_f32; COLUMNS];
    let mut squares = 0.0_f32;
    let share = 2.0 / residual.len().max(1) as f32;
    let changing = if tuned { DERIVATIVE_SCALE } else { 0.0 };
    for (bin, &x) in residual.iter().enumerate() {
        let skipped = if bin > 0 { stride } else { 1 };
        let (mut filtered, mut filtered_derivative) = (Complex::default(), Complex::default());
        for _ in 0..skipped {
            let (now, change) = ringing_train.next();
            filtered = passes[0].filter(CORNER, now);
            filtered = passes[1].filter(CORNER, filtered);
            filtered_derivative = passes[2].filter(CORNER, change);
            filtered_derivative = passes[3].filter(CORNER, filtered_derivative);
        }
        let u = bin as f32 * share - 1.0;
        let columns = [
            filtered.re,
            -filtered.im,
            changing * filtered_derivative.re,
            -changing * filtered_derivative.im,
            1.0,
            u,
            u * u,
            u * u * u,
        ];
        for (row, (entries, sum)) in matrix.iter_mut().zip(&mut sums).enumerate() {
            let value = columns[row];
            *sum += value * x;
            for (entry, other) in entries[..=row].iter_mut().zip(&columns) {
                *entry += value * other;
            }
        }
        squares += x * x;
    }
    let ([baseline_sum, residual_sum], [re, im, by_re, by_im]) =
        solve(&mut matrix, &mut sums, squares);
    let size = (re * re + im * im).max(f32::MIN_POSITIVE);
    // The quotient of both complex heights is the step of decay and frequency.
    let refined = Ringing {
        decay: ringing.decay - DERIVATIVE_SCALE * (by_re * re + by_im * im) / size,
        angle: ringing.angle + DERIVATIVE_SCALE * (by_im * re - by_re * im) / size,
    };
    TrainFit {
        // Lower limit: rounding error of a perfect fit.
        residual_sum: residual_sum.max(1e-6 * squares),
        baseline_sum,
        refined: refined.limit_to(ringing),
        height: Complex::new(re, im),
    }
}

/// Solves the normal equations in place by elimination from the last column to the first. Returns
/// the residual sums of squares without and with the train, and the coefficients of all columns but
/// the cubic's. Slices of unknown length prevent unrolling, which saves flash.
#[inline(never)]
fn solve(
    matrix: &mut [[f32; COLUMNS]],
    sums: &mut [f32],
    squares: f32,
) -> ([f32; 2], [f32; FIRST_CUBIC_COLUMN]) {
    let (mut residual_sum, mut baseline_sum) = (squares, squares);
    for pivot in (0..sums.len()).rev() {
        let (Some(&line), Some(&sum)) = (matrix.get(pivot), sums.get(pivot)) else {
            break;
        };
        let inverse = inverse(line[pivot % COLUMNS]);
        residual_sum -= sum * sum * inverse;
        if pivot == FIRST_CUBIC_COLUMN {
            baseline_sum = residual_sum;
        }
        let before = matrix.iter_mut().zip(&mut *sums).take(pivot);
        for ((entries, other), entry) in before.zip(&line) {
            let share = entry * inverse;
            *other -= share * sum;
            for (entry, other) in entries.iter_mut().zip(&line) {
                *entry -= share * other;
            }
        }
    }
    let mut solution = [0.0; FIRST_CUBIC_COLUMN];
    for (column, (line, sum)) in (matrix.iter().zip(&*sums).enumerate()).take(FIRST_CUBIC_COLUMN) {
        let solved = solution.iter().zip(line).take(column);
        let known: f32 = solved.map(|(solved, entry)| solved * entry).sum();
        solution[column] = (sum - known) * inverse(line[column]);
    }
    ([baseline_sum, residual_sum], solution)
}

fn inverse(diagonal: f32) -> f32 {
    if diagonal > MIN_PIVOT {
        1.0 / diagonal
    } else {
        0.0
    }
}

/// Correlation of a train's ringing with the sine of the drive's phase: its leakage into the
/// demodulator. The phase is `begin` at the first of `samples` and advances by `step`, in rad.
pub fn correlate_with_drive(
    fit: &TrainFit,
    ringing: Ringing,
    samples: u32,
    [begin, step]: [f32; 2],
    train: &[Pulse],
) -> f32 {
    let mut ringing_train = TrainRinging::new(ringing, train);
    let (mut phase, step) = (phase_of(begin), phase_of(step));
    let mut sum = 0.0;
    for _ in 0..samples {
        let ring = (ringing_train.next().0 * fit.height).re;
        sum += ring * sine_cosine_single(phase).0;
        phase += step;
    }
    sum
}
