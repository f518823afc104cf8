//! The energy of what impacts ring with, by the phase of the drive: what the signal path sums sample by sample.

use core::f64::consts::TAU;

use num_complex::Complex64 as Complex;

use super::powers::Powers;
use super::recurrence::{exp, turn};
use crate::arithmetic::Phase;
use crate::control::{SECTORS, SECTORS_HANDED, Sectors};

/// Bits of a phase below its sector.
const BELOW: u32 = u32::BITS - SECTORS.trailing_zeros();
/// Square of the height in m/s^2 below which a ringing is none: a hundredth of the converter's steps.
const SILENT: f64 = 1e-6;
/// Samples in which a ringing begins.
const BEGIN: usize = 10;

/// What lies under all ringing in the residual.
#[derive(Clone, Copy, Debug)]
pub struct Ground {
    /// RMS of its noise in m/s^2.
    pub rms: f64,
    /// The drive's own swing in it, in m/s^2: `Re(leak e^(i phase))`.
    pub leak: Complex,
}

/// All ringing together: `Im(left e^(ringing n))` n samples later, and what a fresh one has besides as it begins.
#[derive(Clone, Copy, Debug)]
pub struct RingingEnergy {
    /// What the filters leave of a ringing that they have known for long, and besides in its first samples.
    steady: Complex,
    besides: [Complex; BEGIN],
    decay: Powers,
    /// `1/(1 - |r|^2)` and `1/(1 - r^2)` for the ringing r of a sample.
    straight: f64,
    across: Complex,
    left: Complex,
    fresh: Complex,
    begun: usize,
    /// The sample up to which it is summed.
    at: u64,
    /// Sample and phase at which the cycle began, and the advance of the phase per sample.
    began: u64,
    phase: u32,
    step: u32,
    /// Whole samples in a sector.
    sector: u32,
    sums: [f64; SECTORS],
    next: usize,
    /// `e^(2 i phase)` in the middle of each sector.
    middles: [Complex; SECTORS],
}

impl RingingEnergy {
    /// For a ringing (logarithm of what a sample leaves of it) and the detector's response to it.
    pub fn new(ringing: Complex, response: &[Complex; BEGIN], steady: &[Complex; BEGIN]) -> Self {
        let one = Complex::new(1.0, 0.0);
        let sample = exp(ringing);
        Self {
            steady: steady[0],
            besides: core::array::from_fn(|n| response[n] - steady[n]),
            decay: Powers::new(ringing),
            straight: 1.0 / (1.0 - sample.norm_sqr()),
            across: (one - sample * sample).inv(),
            left: Complex::new(0.0, 0.0),
            fresh: Complex::new(0.0, 0.0),
            begun: BEGIN,
            at: 0,
            began: 0,
            phase: 0,
            step: 1,
            sector: 1 << BELOW,
            sums: [0.0; SECTORS],
            next: 0,
            middles: core::array::from_fn(|n| turn(2.0 * TAU * (n as f64 + 0.5) / SECTORS as f64)),
        }
    }

    /// Begins a cycle at a sample and a phase of the output.
    pub fn begin(&mut self, sample: u64, phase: Phase, step: u32) {
        let step = step.max(1);
        if step != self.step {
            self.sector = (1 << BELOW) / step;
        }
        (self.began, self.phase, self.step) = (sample, phase.bits(), step);
    }

    /// A ringing that begins at a sample with `e^(i angle)` times its height.
    pub fn strike(&mut self, sample: u64, began: Complex) {
        self.advance(sample);
        self.left += began * self.steady;
        (self.fresh, self.begun) = (began, 0);
    }

    fn phase_at(&self, sample: u64) -> u32 {
        let since = sample.wrapping_sub(self.began) as u32;
        self.phase.wrapping_add(since.wrapping_mul(self.step))
    }

    /// Sums what rings before a sample.
    pub fn advance(&mut self, to: u64) {
        let (mut left, mut phase) = (self.left, self.phase_at(self.at));
        let decay = self.decay.at(1);
        let fresh = self.besides.iter().skip(self.begun);
        let begins = (to.saturating_sub(self.at) as usize).min(BEGIN - self.begun);
        for besides in fresh.take(begins) {
            let residual = (left + self.fresh * besides).im;
            self.sums[(phase >> BELOW) as usize] += residual * residual;
            left *= decay;
            phase = phase.wrapping_add(self.step);
        }
        self.begun += begins;
        self.at += begins as u64;
        let mut before = self.tail(left);
        while self.at < to && left.norm_sqr() > SILENT {
            let ahead = (1 << BELOW) - (phase & ((1 << BELOW) - 1));
            let samples = (to - self.at).min(u64::from(self.samples_in(ahead)));
            left *= self.decay.at(samples);
            let after = self.tail(left);
            self.sums[(phase >> BELOW) as usize] += before - after;
            before = after;
            phase = phase.wrapping_add((samples as u32).wrapping_mul(self.step));
            self.at += samples;
        }
        self.left = left;
        if self.at < to {
            self.left = Complex::new(0.0, 0.0);
            self.at = to;
        }
    }

    /// Samples that begin within so much of the phase, at most a sector.
    fn samples_in(&self, ahead: u32) -> u32 {
        // What begins within a step of a sector's beginning needs no division.
        let step = i64::from(self.step);
        let left = i64::from(ahead) - i64::from(self.sector) * step;
        if left > step || left <= -step {
            return ahead.div_ceil(self.step);
        }
        self.sector + u32::from(left > 0)
    }

    /// Sum of the squares of `Im(left r^n)` over all n from 0 on.
    fn tail(&self, left: Complex) -> f64 {
        0.5 * (left.norm_sqr() * self.straight - (left * left * self.across).re)
    }

    /// The end of a cycle of so many samples: what is handed over.
    pub fn finish(&mut self, samples: u32, ground: &Ground) -> Sectors {
        self.advance(self.began + u64::from(samples));
        let first = self.next;
        // Each waits as many cycles as there are hands.
        let waited = f64::from(samples) / SECTORS_HANDED as f64;
        let swing = 0.5 * ground.leak.norm_sqr();
        let squeezed = libm::sin(TAU / SECTORS as f64) / (TAU / SECTORS as f64);
        let level = ground.rms * ground.rms + swing;
        let mut handed = Sectors {
            first: first as u8,
            ..Sectors::default()
        };
        for (n, energy) in handed.energy.iter_mut().enumerate() {
            let sector = first + n;
            let wave = 0.5 * (ground.leak * ground.leak * self.middles[sector]).re * squeezed;
            let rung = core::mem::take(&mut self.sums[sector]);
            *energy = (rung + waited * (level + wave)) as f32;
        }
        self.next = (first + SECTORS_HANDED) % SECTORS;
        handed
    }
}

#[cfg(test)]
mod tests {
    use super::super::drive::Ringing;
    use super::super::onset::OnsetModel;
    use super::super::scene::SensorModel;
    use super::*;
    use crate::control::{Energy, HighPass, Onset, Standard};

    #[test]
    fn samples_of_a_sector_are_counted_without_a_division() {
        let none = [Complex::new(0.0, 0.0); BEGIN];
        let mut energy = RingingEnergy::new(Complex::new(-0.05, 0.754), &none, &none);
        let sector = 1_u32 << BELOW;
        for step in [
            1,
            12_345_679,
            u32::MAX / 400 + 1,
            sector - 1,
            sector,
            sector + 1,
            1 << 30,
        ] {
            energy.begin(0, Phase::ZERO, step);
            for ahead in [
                1,
                step - 1,
                step,
                step + 1,
                sector / 3,
                sector - step.min(sector - 1),
                sector,
            ] {
                let ahead = ahead.clamp(1, sector);
                assert_eq!(
                    energy.samples_in(ahead),
                    ahead.div_ceil(step),
                    "{step} {ahead}"
                );
            }
        }
    }

    /// Impacts at random, two of them almost at once: each sector's energy is that of the samples.
    #[test]
    fn it_is_the_energy_of_the_samples() {
        let sensor = SensorModel::default();
        let mut model = OnsetModel::new(&sensor);
        let mut ringing = Ringing::new(sensor.ringing_frequency, sensor.ringing_decay * 1e-3);
        let mut passes = [HighPass::default(); 2];
        let mut energy = Energy::EMPTY;
        let step = u32::MAX / 400 + 1;
        let swing = Complex::new(7.0, -20.0);
        model.tune(TAU / 400.0);
        let (mut slow, mut fast) = ([0.0_f64; SECTORS], [0.0_f64; SECTORS]);
        let (mut phase, mut next) = (0_u32, 30.3_f64);
        for cycle in 0..200_u64 {
            model.begin(400 * cycle, 400, Phase::from_bits(phase), step);
            for n in 0..400 {
                let sample = 400 * cycle + n;
                while next <= sample as f64 {
                    let share = sample as f64 - next;
                    ringing.strike(5.0, share as f32);
                    model.ring(sample, share, 5.0);
                    next += if sample % 3 == 0 {
                        4.7
                    } else {
                        61.3 + (sample % 17) as f64
                    };
                }
                let drive = swing.re * libm::cos(TAU * (n as f64) / 400.0)
                    - swing.im * libm::sin(TAU * (n as f64) / 400.0);
                let reading = ringing.acceleration() + drive as f32;
                let once = passes[0].pass(Standard::CORNER as f32, reading);
                let residual = passes[1].pass(Standard::CORNER as f32, once);
                energy.add(Phase::from_bits(phase), residual);
                ringing.step();
                phase = phase.wrapping_add(step);
            }
            let mut heard = Sectors::default();
            energy.finish(&mut heard);
            let handed = [heard, model.sectors(400, 0.0, swing)];
            assert_eq!(handed[0].first, handed[1].first);
            for (sums, handed) in [&mut slow, &mut fast].into_iter().zip(handed) {
                for (n, energy) in handed.energy.iter().enumerate() {
                    sums[usize::from(handed.first) + n] += f64::from(*energy);
                }
            }
        }
        for (slow, fast) in slow.iter().zip(fast) {
            // What the drive leaves and what rings are added as if they knew nothing of each other.
            assert!((fast / slow - 1.0).abs() < 0.05, "{slow} {fast}");
        }
    }
}
