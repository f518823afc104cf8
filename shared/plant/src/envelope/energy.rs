//! Energy of the ringing after impacts, by sector of the drive's turn, in closed form.
//!
//! The squares of a decaying oscillation over whole samples are a geometric series.
//!
//! Input: complex height (m/s^2) of each ringing at its first sample. Output: sum of squared
//! residuals, in (m/s^2)^2, of each of 32 sectors, a quarter of them per cycle as on the board.

use super::onset::{RESIDUAL_SAMPLES, Response};
use super::recurrence::{Powers, exp, turn};
use core::f64::consts::TAU;
use kband::arithmetic::Phase;
use kband_control::signal_path::{SECTORS, SECTORS_PER_CYCLE, Sectors};
use num_complex::Complex64 as Complex;

/// Bits of a phase below its sector number.
const SECTOR_SHIFT: u32 = u32::BITS - SECTORS.trailing_zeros();
/// Squared height below which a ringing is 0, in (m/s^2)^2: a hundredth of a converter step.
const NEGLIGIBLE_HEIGHT_SQUARED: f64 = 1e-6;

/// Sum of all ringings: `Im(phasor e^(ringing n))`, plus the filters' transient of the last one.
#[derive(Clone, Copy, Debug, Default)]
pub struct RingingEnergy {
    /// Residual of a ringing of unit height in steady state, and its transient at first.
    steady: Complex,
    transient: Response,
    /// Decay of a ringing in one sample and in several.
    sample: Complex,
    decay: Powers,
    /// Sums of geometric series `1/(1 - |r|^2)` and `1/(1 - r^2)` for the ringing r of a sample.
    square_sum: f64,
    conjugate_sum: Complex,
    phasor: Complex,
    newest: Complex,
    begun: usize,
    /// Sample up to which the energy is summed.
    at: u64,
    /// Sample and phase at the start of the cycle, and the advance of the phase per sample.
    began: u64,
    phase: u32,
    step: u32,
    /// Whole samples in a sector, and the decay of a ringing over them and over one more.
    sector: u32,
    decays: [Complex; 2],
    sums: [f64; SECTORS],
    next: usize,
    /// `e^(2 i phase)` at the centre of each sector, and its mean over a sector relative to it.
    middles: [Complex; SECTORS],
    sector_attenuation: f64,
}

impl RingingEnergy {
    /// For a ringing (logarithm of its decay per sample) and the detector's response to it.
    pub fn new(ringing: Complex, response: &Response, steady: &Response) -> Self {
        let sample = exp(ringing);
        let decay = Powers::new(ringing);
        Self {
            steady: steady[0],
            transient: core::array::from_fn(|n| response[n] - steady[n]),
            sample: decay.at(1),
            decay,
            square_sum: 1.0 / (1.0 - sample.norm_sqr()),
            conjugate_sum: (Complex::ONE - sample * sample).inv(),
            begun: RESIDUAL_SAMPLES,
            step: 1,
            sector: 1 << SECTOR_SHIFT,
            middles: core::array::from_fn(|n| turn(2.0 * TAU * (n as f64 + 0.5) / SECTORS as f64)),
            sector_attenuation: libm::sin(TAU / SECTORS as f64) / (TAU / SECTORS as f64),
            ..Self::default()
        }
    }

    pub fn begin(&mut self, sample: u64, phase: Phase, step: u32) {
        let step = step.max(1);
        if step != self.step {
            self.sector = (1 << SECTOR_SHIFT) / step;
            self.decays = [0, 1].map(|more| self.decay.at(u64::from(self.sector + more)));
        }
        (self.began, self.phase, self.step) = (sample, phase.bits(), step);
    }

    pub fn strike(&mut self, sample: u64, began: Complex) {
        self.advance(sample);
        self.phasor += began * self.steady;
        (self.newest, self.begun) = (began, 0);
    }

    fn phase_at(&self, sample: u64) -> u32 {
        let since = sample.wrapping_sub(self.began) as u32;
        self.phase.wrapping_add(since.wrapping_mul(self.step))
    }

    pub fn advance(&mut self, to: u64) {
        if to <= self.at {
            return;
        }
        let mut samples = to - self.at;
        let mut phase = self.phase_at(self.at);
        self.at = to;
        let mut phasor = self.phasor;
        if self.begun < RESIDUAL_SAMPLES {
            let begins = (RESIDUAL_SAMPLES - self.begun).min(samples as usize);
            let step = self.step;
            let mut sector = (phase >> SECTOR_SHIFT) as usize;
            let mut sum = self.sums[sector];
            for transient in &self.transient[self.begun..self.begun + begins] {
                let now = (phase >> SECTOR_SHIFT) as usize;
                if now != sector {
                    self.sums[sector] = sum;
                    (sector, sum) = (now, self.sums[now]);
                }
                let residual =
                    phasor.im + (self.newest.re * transient.im + self.newest.im * transient.re);
                sum += residual * residual;
                phasor *= self.sample;
                phase = phase.wrapping_add(step);
            }
            self.sums[sector] = sum;
            self.begun += begins;
            samples -= begins as u64;
        }
        let mut height = phasor.norm_sqr();
        if samples > 0 && height > NEGLIGIBLE_HEIGHT_SQUARED {
            let mut before = self.tail(phasor, height);
            // The first sector is partial; each later one has one of two numbers of samples.
            let mut samples_in_sector = u64::from(phase_to_sector_end(phase).div_ceil(self.step));
            let mut advance = (samples_in_sector as u32).wrapping_mul(self.step);
            let mut decay = self.decay.at(samples_in_sector.min(samples));
            let shorter = self.sector * self.step;
            loop {
                phasor *= decay;
                height = phasor.norm_sqr();
                let after = self.tail(phasor, height);
                self.sums[(phase >> SECTOR_SHIFT) as usize] += before - after;
                before = after;
                if samples_in_sector >= samples || height <= NEGLIGIBLE_HEIGHT_SQUARED {
                    break;
                }
                samples -= samples_in_sector;
                phase = phase.wrapping_add(advance);
                let longer = phase_to_sector_end(phase) > shorter;
                advance = shorter + if longer { self.step } else { 0 };
                samples_in_sector = u64::from(self.sector) + u64::from(longer);
                decay = if samples_in_sector > samples {
                    self.decay.at(samples)
                } else {
                    self.decays[usize::from(longer)]
                };
            }
            samples = samples.saturating_sub(samples_in_sector);
        }
        self.phasor = if samples == 0 { phasor } else { Complex::ZERO };
    }

    /// Sum of the squares of `Im(phasor r^n)` for n >= 0; `height` is |left|^2.
    #[inline(always)]
    fn tail(&self, phasor: Complex, height: f64) -> f64 {
        let square = phasor * phasor;
        0.5 * (height * self.square_sum
            - (square.re * self.conjugate_sum.re - square.im * self.conjugate_sum.im))
    }

    /// Ends a cycle of `samples` samples; energy of the next group of sectors. Without ringing the
    /// residual is noise of `rms` and the drive's `Re(leak e^(i phase))`, in m/s^2.
    pub fn finish(&mut self, samples: u32, rms: f64, leak: Complex) -> Sectors {
        self.advance(self.began + u64::from(samples));
        let first = self.next;
        // A sector is returned once in as many cycles as there are groups.
        let waited = f64::from(samples) / SECTORS_PER_CYCLE as f64;
        let swing = 0.5 * leak.norm_sqr();
        let leak_squared = leak * leak;
        let level = rms * rms + swing;
        let mut handed = Sectors {
            first: first as u8,
            ..Sectors::default()
        };
        for (n, energy) in handed.energy.iter_mut().enumerate() {
            let sector = first + n;
            let wave = 0.5 * (leak_squared * self.middles[sector]).re * self.sector_attenuation;
            let ringing_energy = core::mem::take(&mut self.sums[sector]);
            *energy = (ringing_energy + waited * (level + wave)) as f32;
        }
        self.next = (first + SECTORS_PER_CYCLE) % SECTORS;
        handed
    }
}

#[inline(always)]
fn phase_to_sector_end(phase: u32) -> u32 {
    (1 << SECTOR_SHIFT) - (phase & ((1 << SECTOR_SHIFT) - 1))
}
