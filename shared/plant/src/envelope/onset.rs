//! Closed-form model of the board's onset detector for the envelope plant.
//!
//! The detector's filters are linear, so the residual of a ringing is a geometric series. Its
//! running median is modelled as the quantile of noise, the drive's leakage and ringing.

use super::energy::RingingEnergy;
use super::recurrence::{Powers, exp, exp_small, turn};
use crate::model::scene::SensorModel;
use core::f64::consts::{PI, TAU};
use kband::arithmetic::{Noise, Phase};
use kband_control::SAMPLE_RATE;
use kband_control::signal_path::{HighPass, MAX_BLANKED_SHARE, OnsetDetector, Sectors};
use num_complex::Complex64 as Complex;

/// Samples after an impact in which its residual is evaluated. They cover a quarter period at 500
/// Hz, the lowest ringing frequency of a scene, and a period at the default.
pub(super) const RESIDUAL_SAMPLES: usize = 10;
/// Residuals of these samples, and complex ones.
type Residuals = [f64; RESIDUAL_SAMPLES];
pub(super) type Response = [Complex; RESIDUAL_SAMPLES];
/// Sample index for "not within [`RESIDUAL_SAMPLES`] samples".
const NO_SAMPLE: usize = usize::MAX;
const START_SHARES: usize = 8;
/// Relative level, below any measurable ringing's noise, at which the peak memory counts as 0.
const NEGLIGIBLE_PEAK: f64 = 1.354e-4;
/// Forgetting per sample of the hidden share of time: twice the memory of the detector's median.
const HIDDEN_SHARE_FORGETTING: f64 = 5e-4;

/// The onset detector's response to impacts, in closed form.
///
/// The filters are linear: n samples on, a residual is the ringing's complex start times a number.
#[derive(Clone, Copy, Debug)]
pub struct OnsetModel {
    ringing: Complex,
    /// Residual of a ringing of unit height n samples after its start: real and imaginary parts.
    response: [Residuals; 2],
    /// The same after the transient of the filters.
    steady: [Residuals; 2],
    /// Height of a ringing in the residual over its height in the acceleration.
    share: f64,
    /// RMS of the residual over the RMS of white noise in the reading.
    noise_gain: f64,
    /// Increase of the hidden share of time per decay time of a hiding ringing.
    filling: f64,
    pub(super) tuning: Tuning,
    /// Share of time in which ringing hides the noise, with exponential forgetting.
    hidden: f64,
    /// Share of time by which ringing on the drive's leakage exceeds the median more than it alone.
    raised: f64,
    /// Start of a ringing within a sample: `e^(ringing n/8)`.
    onset: [Complex; START_SHARES + 1],
    /// Powers of the decay of a ringing, and of the detector's memory, over whole samples.
    decay: Powers,
    memory_decay: Powers,
    pub(super) blanking: Blanking,
    energy: RingingEnergy,
    /// Logarithm of the decay per sample of the detector's memory of a loud ringing.
    forgetting: f64,
    /// Samples after which this memory counts as 0.
    forgotten: u64,
    last: RingingState,
    /// First sample at which the next impact can be detected.
    rearm_sample: u64,
}

/// Constants of the detector for a drive phase of `theta` rad a sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tuning {
    theta: f64,
    /// Sums of geometric series `(i/2)/(1 - e^(i theta) r)` for the ringing r and its conjugate.
    sums: [Complex; 2],
    /// Powers of `e^(i theta) r` for both.
    turns: [Powers; 2],
    /// `e^(i theta)`.
    turn: Complex,
    /// Gain of both high-pass filters at the drive's frequency: magnitude, and complex number.
    pub(super) leak: f64,
    complex_gain: Complex,
}

#[derive(Clone, Copy, Debug, Default)]
struct RingingState {
    /// Complex height `e^(i angle)` times height at its first sample, and the index of that sample.
    began: Complex,
    sample: u64,
    /// Complex height of all earlier ringings at that sample.
    earlier_phasor: Complex,
    /// Number of its samples that the memory contains.
    sample_count: usize,
    peak_memory: f64,
    /// Residual of the drive's own acceleration at its first sample.
    leak: Complex,
    /// Threshold of a loud residual, and of a blanked one, in m/s^2.
    onset_threshold: f64,
    blanking_threshold: f64,
    /// First of its samples at which the memory exceeds the blanking threshold, or [`NO_SAMPLE`].
    first_blanked: usize,
}

impl RingingState {
    /// Whether the earlier ringings have decayed.
    fn is_single(&self) -> bool {
        self.earlier_phasor == Complex::ZERO
    }

    /// Updates the detector's decaying peak memory with the residual of the next sample.
    ///
    /// It is branch-free, because loud samples are unpredictable for the processor.
    #[inline(always)]
    fn add_residual(&mut self, residual: f64) {
        let peak_memory = self.peak_memory * OnsetDetector::ENVELOPE_DECAY;
        let is_high = residual > self.onset_threshold;
        let high = if is_high { residual } else { 0.0 };
        let is_peak = high > peak_memory;
        self.peak_memory = if is_peak { high } else { peak_memory };
        let blanks = self.peak_memory > self.blanking_threshold;
        let first_blanked = if blanks { self.sample_count } else { NO_SAMPLE };
        self.first_blanked = self.first_blanked.min(first_blanked);
        self.sample_count += 1;
    }

    /// Updates the memory with the remaining samples of the last ringing. The noise is omitted,
    /// because the result only affects whether a close impact counts as the same ringing.
    fn complete(&mut self, residuals: &Residuals) {
        for residual in residuals.iter().skip(self.sample_count) {
            self.add_residual(residual.abs());
        }
    }

    #[inline(always)]
    fn residuals(&self, model: &OnsetModel) -> Residuals {
        let mut residuals = sines(self.began, &model.response);
        if !self.is_single() {
            let before = sines(self.earlier_phasor, &model.steady);
            for (residual, before) in residuals.iter_mut().zip(before) {
                *residual += before;
            }
        }
        residuals
    }

    /// Remaining complex height and remaining memory of the ringing at a sample.
    fn remaining(&self, model: &OnsetModel, sample: u64) -> (Complex, f64) {
        let since = sample.saturating_sub(self.sample);
        if since >= model.forgotten {
            return (Complex::ZERO, 0.0);
        }
        let peak_memory = if self.sample_count < RESIDUAL_SAMPLES {
            let mut completed = *self;
            completed.complete(&self.residuals(model));
            completed.peak_memory
        } else {
            self.peak_memory
        };
        let ringing_level = self.began + self.earlier_phasor;
        let forgotten = since.saturating_sub(RESIDUAL_SAMPLES as u64);
        (
            ringing_level * model.decay.at(since),
            peak_memory * model.memory_decay.at(forgotten).re,
        )
    }
}

/// Imaginary parts of the products of a number with others, given by real and imaginary parts.
#[inline(always)]
fn sines(number: Complex, [real, imaginary]: &[Residuals; 2]) -> Residuals {
    core::array::from_fn(|n| number.re * imaginary[n] + number.im * real[n])
}

/// Samples of a cycle that the demodulator blanks during the ringing of an impact.
#[derive(Clone, Copy, Debug, Default)]
pub struct Blanking {
    /// First sample after the blanking, counted from the start of the scene, and end of the cycle.
    pub until: u64,
    end: u64,
    /// Number of blanked samples of the cycle, and how many more are allowed.
    samples: u64,
    remaining: u64,
    pub disabled: bool,
}

impl Blanking {
    pub fn begin(&mut self, sample: u64, samples: u32) {
        let limit = (MAX_BLANKED_SHARE * f64::from(samples)) as u64;
        let limit = if self.disabled { 0 } else { limit };
        self.end = sample + u64::from(samples);
        self.samples = self.until.saturating_sub(sample).min(limit);
        self.remaining = limit - self.samples;
        self.until = sample + self.samples;
    }

    /// Blanks the samples of a ringing up to the allowed number; returns the first sample after it.
    pub fn blank(&mut self, from: u64, until: u64) -> u64 {
        if until > from {
            let length = until.min(self.end).saturating_sub(from);
            let blank = length.min(self.remaining);
            self.samples += blank;
            self.remaining -= blank;
            self.until = if blank < length { from + blank } else { until };
        }
        self.until
    }

    pub fn share(&self, samples: u32) -> f64 {
        self.samples as f64 / f64::from(samples.max(1))
    }
}

/// An impact before detection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampledImpact {
    /// Index of the first sample after it, counted from the start of the scene.
    pub sample: u64,
    /// Time from the impact to that sample in samples, 0..1.
    pub share: f64,
    /// Height of its ringing in the board's reading, in m/s^2.
    pub height: f64,
}

/// Residual without impacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Background {
    /// Running median of the residual in m/s^2.
    pub median: f64,
    /// RMS of the noise in the residual in m/s^2.
    pub rms: f64,
    /// Residual of the drive's own acceleration in m/s^2: the real part, at the impact's sample.
    pub leak: Complex,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DetectedOnset {
    /// Index of the sample of detection, counted from the start of the scene.
    pub sample: u64,
    /// Residual at that sample in m/s^2.
    pub strength: f64,
}

impl OnsetModel {
    /// Detection threshold over the running median.
    const THRESHOLD: f64 = OnsetDetector::THRESHOLD / OnsetDetector::QUARTILE;

    pub fn new(sensor: &SensorModel) -> Self {
        let h = 1.0 / f64::from(SAMPLE_RATE);
        let decay = f64::from(sensor.ringing_decay) * 1e-3;
        let ringing = Complex::new(-h / decay, TAU * f64::from(sensor.ringing_frequency) * h);
        let high_passed = |passes: &mut [HighPass<Complex>; 2], sample| {
            let once = passes[0].filter(OnsetDetector::CORNER, sample);
            passes[1].filter(OnsetDetector::CORNER, once)
        };
        let mut passes = [HighPass::default(); 2];
        let response: Response =
            core::array::from_fn(|n| high_passed(&mut passes, exp(ringing * n as f64)));
        // Power gain of white noise: the sum of the squared impulse response.
        let (mut passes, mut power, mut sample) = ([HighPass::default(); 2], 0.0, 1.0.into());
        for _ in 0..OnsetDetector::SETTLING_SAMPLES {
            let output = high_passed(&mut passes, sample).re;
            power += output * output;
            sample = 0.0.into();
        }
        let forgetting = libm::log(OnsetDetector::ENVELOPE_DECAY);
        let steady: Response = core::array::from_fn(|n| {
            let since = n as f64 - (RESIDUAL_SAMPLES - 1) as f64;
            response[RESIDUAL_SAMPLES - 1] * exp(ringing * since)
        });
        let split = |numbers: &Response| [numbers.map(|n| n.re), numbers.map(|n| n.im)];
        Self {
            ringing,
            response: split(&response),
            steady: split(&steady),
            energy: RingingEnergy::new(ringing, &response, &steady),
            share: libm::sqrt(steady[0].norm_sqr()),
            noise_gain: libm::sqrt(power),
            filling: -HIDDEN_SHARE_FORGETTING / ringing.re,
            tuning: Tuning::new(ringing, 0.0, OnsetDetector::CORNER),
            hidden: 0.0,
            raised: 0.0,
            onset: core::array::from_fn(|n| exp(ringing * (n as f64 / START_SHARES as f64))),
            decay: Powers::new(ringing),
            memory_decay: Powers::new(forgetting.into()),
            blanking: Blanking::default(),
            forgetting: forgetting.max(ringing.re),
            forgotten: (libm::log(NEGLIGIBLE_PEAK) / forgetting) as u64,
            last: RingingState {
                sample_count: RESIDUAL_SAMPLES,
                blanking_threshold: f64::INFINITY,
                first_blanked: NO_SAMPLE,
                ..RingingState::default()
            },
            rearm_sample: u64::from(OnsetDetector::SETTLING_SAMPLES),
        }
    }

    /// Sets the drive's phase advance, `theta` rad a sample.
    pub fn tune(&mut self, theta: f64) {
        if theta != self.tuning.theta {
            self.tuning = Tuning::new(self.ringing, theta, OnsetDetector::CORNER);
        }
    }

    /// RMS of the residual for an RMS of white noise in the reading.
    pub fn residual(&self, noise: f64) -> f64 {
        self.noise_gain * noise
    }

    /// Median of the absolute residual in m/s^2, for an RMS and for the drive's share of its power.
    pub fn median(&self, rms: f64, swing: f64) -> f64 {
        // Noise has 0.6745 of the RMS, a sine its RMS; the interpolation errs by at most 0.013.
        let square = swing * swing;
        let single =
            OnsetDetector::QUARTILE + square * (0.14 + (0.86 - OnsetDetector::QUARTILE) * square);
        // Solves P(|n| > m) = (1/2 - q)/(1 - q) for m within 1/50.
        let hidden = self.hidden.min(0.4);
        let of_noise = hidden * (0.787 + hidden * (0.287 + 5.44 * hidden));
        // The interpolation is within 1/20 of numerical integration.
        let sine = (2.5 * swing - 1.5).max(0.0);
        // A sine exceeds its RMS times `sqrt 2 sin(pi/4 + pi q/2)` for a share 1/2 - q of the time.
        let raised = 0.5 * PI * self.raised.clamp(-0.4, 0.4);
        let of_sine = libm::sin(raised) + libm::cos(raised) - 1.0;
        rms * (single + of_noise + (of_sine - of_noise) * sine)
    }

    /// Residual of the drive's acceleration, both as complex amplitudes of the cosine.
    pub fn leaked(&self, swing: Complex) -> Complex {
        swing * self.tuning.complex_gain
    }

    /// Begins a cycle of `samples` samples at a sample and an output phase that advances by `step`.
    pub fn begin(&mut self, sample: u64, samples: u32, phase: Phase, step: u32) {
        self.blanking.begin(sample, samples);
        self.energy.begin(sample, phase, step);
    }

    /// Ends a cycle and returns the energy of the residual in some sectors of the turn. Inputs:
    /// number of samples, RMS of the noise and complex amplitude of the drive, both in m/s^2.
    pub fn sectors(&mut self, samples: u32, rms: f64, swing: Complex) -> Sectors {
        let leak = self.leaked(swing);
        self.energy.finish(samples, rms, leak)
    }

    /// Adds an impact. Its detection, and the sum of its unblanked ringing times the phasor.
    pub fn impact(
        &mut self,
        impact: SampledImpact,
        background: Background,
        noise: &mut Noise,
    ) -> (Option<DetectedOnset>, Complex) {
        let sample = impact.sample;
        let mut leak = background.leak;
        let began = self.initial_phasor(impact.share) * impact.height;
        self.energy.strike(sample, began);
        self.raised += HIDDEN_SHARE_FORGETTING * self.excess(&self.last, sample);
        let (earlier_phasor, peak_memory) = self.last.remaining(self, sample);
        let onset_threshold = Self::THRESHOLD * background.median;
        let mut ring = RingingState {
            began,
            sample,
            earlier_phasor,
            sample_count: 0,
            peak_memory,
            leak,
            onset_threshold,
            blanking_threshold: OnsetDetector::BLANKING_THRESHOLD * onset_threshold,
            first_blanked: NO_SAMPLE,
        };
        let residuals = ring.residuals(self);
        // The residual of a ringing never exceeds the ringing itself.
        let below_threshold =
            impact.height + earlier_phasor.l1_norm() + leak.l1_norm() + 3.5 * background.rms
                < onset_threshold;
        let mut detected = None;
        while ring.sample_count < RESIDUAL_SAMPLES && !below_threshold {
            let signed =
                residuals[ring.sample_count] + leak.re + background.rms * f64::from(noise.gauss());
            leak *= self.tuning.turn;
            let residual = signed.abs();
            let at = sample + ring.sample_count as u64;
            let above = residual > OnsetDetector::MIN_OVER_ENVELOPE * ring.peak_memory;
            ring.add_residual(residual);
            if residual > onset_threshold && above && at >= self.rearm_sample {
                detected = Some(DetectedOnset {
                    sample: at,
                    strength: residual,
                });
                // Dead time while the ringing may still rise.
                self.rearm_sample = at + u64::from(OnsetDetector::RISE_SAMPLES) + 1;
                ring.first_blanked = ring.first_blanked.min(ring.sample_count - 1);
                break;
            }
        }
        let sum = self.is_detected(&mut ring, &residuals, detected.is_some());
        self.last = ring;
        if !below_threshold {
            let ringing_level = impact.height * self.share / background.median;
            let folds = logarithm(ringing_level.max(1.0) as f32);
            // Decay times for which a ringing hides the noise, within a tenth of the integral.
            let (short, long) = (0.24 * folds * folds, folds - 1.06);
            self.hidden += self.filling * if folds < 2.0 { short } else { long };
        }
        (detected, sum)
    }

    /// Net change, in samples, of the time above the median due to ringing on the drive's leakage,
    /// from an impact to a sample. The phase of the ringing counts as random.
    fn excess(&self, ring: &RingingState, until: u64) -> f64 {
        const STEPS: usize = 12;
        let mut leak = ring.leak;
        let median = ring.onset_threshold / Self::THRESHOLD;
        if leak.norm_sqr() <= median * median {
            return 0.0;
        }
        let mut height = libm::sqrt((ring.began + ring.earlier_phasor).norm_sqr()) * self.share;
        // The sum ends at a tenth of the median.
        let duration = libm::log((10.0 * height / median).max(1.0)) / -self.ringing.re;
        let duration = duration.min(until.saturating_sub(ring.sample) as f64);
        let each = duration / STEPS as f64;
        let step = turn(0.5 * self.tuning.theta * each);
        let decay = libm::exp(0.5 * self.ringing.re * each);
        (leak, height) = (leak * step, height * decay);
        let mut sum = 0.0;
        for _ in 0..STEPS {
            // Probability that a sine of random phase exceeds a level.
            let exceedance = |level: f64| 0.5 - libm::asin((level / height).clamp(-1.0, 1.0)) / PI;
            let single = if leak.re.abs() > median { 1.0 } else { 0.0 };
            sum += exceedance(median - leak.re) + exceedance(median + leak.re) - single;
            leak *= step * step;
            height *= decay * decay;
        }
        sum * each
    }

    /// Sum of the ringing before its first loud sample and after the detector's memory has decayed.
    #[inline(always)]
    fn is_detected(
        &mut self,
        ring: &mut RingingState,
        residuals: &Residuals,
        detected: bool,
    ) -> Complex {
        let sample = ring.sample;
        let since = |at: u64| at.saturating_sub(sample);
        let blanked_until = self.blanking.until.max(sample);
        let began = self.sums(ring.began);
        let own_sum = self.tail(began, since(blanked_until));
        let ringing_level = ring.began + ring.earlier_phasor;
        // Early return for quiet impacts, which need no memory.
        if !detected
            && ringing_level.l1_norm() < ring.blanking_threshold
            && ring.peak_memory < ring.blanking_threshold
        {
            return own_sum;
        }
        ring.complete(residuals);
        if ring.first_blanked == NO_SAMPLE {
            return own_sum;
        }
        let from = (sample + ring.first_blanked as u64).max(blanked_until);
        // Accurate to 1/5 of a sample.
        let duration =
            logarithm((ring.peak_memory / ring.blanking_threshold) as f32) / -self.forgetting;
        let mut forgotten = sample + (RESIDUAL_SAMPLES as f64 + duration).max(0.0) as u64;
        if detected {
            forgotten = forgotten.max(self.rearm_sample);
        }
        let until = self.blanking.blank(from, forgotten).max(from);
        let single = ring.is_single();
        let sums = if single {
            began
        } else {
            self.sums(ringing_level)
        };
        own_sum - self.tail(sums, since(from)) + self.tail(sums, since(until))
    }

    fn sums(&self, began: Complex) -> [Complex; 2] {
        let [forward, backward] = self.tuning.sums;
        [began * forward, began.conj() * backward]
    }

    /// Sum of a ringing times the drive's phase factor, from `samples` after its first sample on.
    #[inline(always)]
    fn tail(&self, [mut direct, mut conjugate]: [Complex; 2], samples: u64) -> Complex {
        if samples > 0 {
            direct *= self.tuning.turns[0].at(samples);
            conjugate *= self.tuning.turns[1].at(samples);
        }
        conjugate - direct
    }

    /// `e^(ringing share)` for `share` in 0..1.
    fn initial_phasor(&self, share: f64) -> Complex {
        let nearest = (share * START_SHARES as f64 + 0.5) as usize;
        let Some(node) = self.onset.get(nearest) else {
            return exp(self.ringing * share);
        };
        let offset = share - nearest as f64 * (1.0 / START_SHARES as f64);
        *node * exp_small(self.ringing * offset)
    }

    pub fn age_background(&mut self, samples: u32) {
        let keep = (1.0 - f64::from(samples) * HIDDEN_SHARE_FORGETTING).max(0.0);
        self.hidden *= keep;
        self.raised *= keep;
    }
}

/// `ln x` within 0.007 for normal x: the exponent, and a parabola in the mantissa.
fn logarithm(x: f32) -> f64 {
    let bits = x.to_bits();
    let mantissa = f32::from_bits(bits & 0x007f_ffff | 0x3f80_0000);
    let exponent = (bits >> 23) as i32 - 127;
    let binary = exponent as f32 + (mantissa * (2.0 - mantissa * (1.0 / 3.0)) - 5.0 / 3.0);
    f64::from(binary * core::f32::consts::LN_2)
}

impl Tuning {
    fn new(ringing: Complex, theta: f64, corner: f64) -> Self {
        let one = Complex::ONE;
        let turning = Complex::new(0.0, theta);
        // Response of (1 - c)(1 - z^-1) / (1 - (1 - c) z^-1), twice.
        let backward = turn(-theta);
        let once = (one - backward) * (1.0 - corner) / (one - backward * (1.0 - corner));
        let logs = [ringing + turning, ringing.conj() + turning];
        Self {
            theta,
            sums: logs.map(|log| (one - exp(log)).inv() * Complex::new(0.0, 0.5)),
            turns: logs.map(Powers::new),
            turn: backward.conj(),
            leak: once.norm_sqr(),
            complex_gain: once * once,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::drive::Ringing;
    use std::vec::Vec;

    /// Detections from sample `from` on, of detector and closed form. Impacts of `height` (m/s^2)
    /// come from `next` on, every `spacing` samples; the drive turns by `theta`.
    fn onsets(
        height: f32,
        [mut next, spacing]: [f64; 2],
        [theta, swing]: [f64; 2],
        sigma: f32,
        [from, until]: [u64; 2],
    ) -> [Vec<u64>; 2] {
        let sensor = SensorModel::default();
        let mut detector = OnsetDetector::new(0.01);
        let mut ringing = Ringing::from_sensor(&sensor);
        let mut fast = OnsetModel::new(&sensor);
        fast.tune(theta);
        let mut noise = [Noise::new(3), Noise::new(4)];
        let swing = Complex::new(swing, 0.0);
        let rms = fast.residual(f64::from(sigma));
        let leaked = fast.leaked(swing);
        let square = rms * rms + 0.5 * leaked.norm_sqr();
        let median = |fast: &OnsetModel| {
            let swinging = 0.5 * leaked.norm_sqr() / square;
            fast.median(libm::sqrt(square), swinging).max(0.01)
        };
        let mut detected = [Vec::new(), Vec::new()];
        for sample in 0..until {
            let turned = turn(theta * sample as f64);
            if next <= sample as f64 {
                let share = sample as f64 - next;
                ringing.strike(height, share as f32);
                let impact = SampledImpact {
                    sample,
                    share,
                    height: f64::from(height),
                };
                let background = Background {
                    median: median(&fast),
                    rms,
                    leak: leaked * turned,
                };
                let (stamp, _) = fast.impact(impact, background, &mut noise[1]);
                let stamp = stamp.filter(|_| sample >= from);
                detected[1].extend(stamp.map(|stamp| stamp.sample));
                next += spacing;
            }
            let drive = (swing * turned).re as f32;
            let reading = drive + ringing.acceleration() + sigma * noise[0].gauss();
            // The detector first adapts to the noise.
            let residual = detector.residual(reading);
            if detector.detect(residual).is_some() && sample >= from {
                detected[0].push(sample);
            }
            ringing.step();
            if sample % 200 == 199 {
                fast.age_background(200);
            }
        }
        detected
    }

    #[test]
    fn model_detects_the_onsets_of_the_detector() {
        let onsets = |height, spacing, sigma| {
            onsets(height, [9000.25, spacing], [0.0; 2], sigma, [8001, 60_000])
        };
        for (height, spacing, sigma) in [(6.0, 400.3, 0.15), (6.0, 133.7, 0.15), (2.0, 811.1, 0.1)]
        {
            let [slow, fast] = onsets(height, spacing, sigma);
            assert!(slow.len() > 50);
            assert_eq!(slow.len(), fast.len(), "{height} {spacing}");
            for (slow, fast) in slow.iter().zip(&fast) {
                // Independent noise can shift a detection on a slow rise by a sample.
                assert!(slow.abs_diff(*fast) <= 2, "{slow} {fast}");
            }
        }
        let [slow, fast] = onsets(0.4, 400.3, 0.15);
        assert!(slow.is_empty() && fast.is_empty());
    }

    /// 500 impacts at one phase of a drive of 100 Hz.
    #[test]
    fn residual_swing_acts_alike_in_both() {
        let theta = TAU / 200.0;
        for (swing, lowest, step) in [(0.0, 0.5, 0.25), (25.0, 1.25, 0.25), (60.0, 2.5, 0.5)] {
            for phase in [0.4, 3.5] {
                // Height of an impact with half of the detections.
                let mut thresholds = [lowest; 2];
                let impacts = [(phase / theta).floor() - 0.25, 200.0];
                for n in 0..9 {
                    let height = (lowest + step * f64::from(n)) as f32;
                    let drive = [theta, swing];
                    let detected = onsets(height, impacts, drive, 0.15, [20_000, 120_000]);
                    for (threshold, detected) in thresholds.iter_mut().zip(detected) {
                        *threshold += step * (1.0 - detected.len() as f64 / 500.0);
                    }
                }
                let [slow, fast] = thresholds;
                assert!(lowest + step < slow && slow < lowest + 8.0 * step, "{slow}");
                let deviation = (fast / slow - 1.0).abs();
                assert!(deviation < 0.05, "{swing} {phase}: {slow} {fast}");
            }
        }
    }
}
