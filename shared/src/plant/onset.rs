//! What the board's onset detector makes of an impact, without its samples.

use core::f64::consts::TAU;
use core::marker::PhantomData;

use num_complex::Complex64 as Complex;

use super::blanking::Blanking;
use super::energy::{Ground, RingingEnergy};
use super::noise::Noise;
use super::powers::Powers;
use super::recurrence::{exp, exp_small, product, turn};
use super::scene::SensorModel;
use crate::arithmetic::Phase;
use crate::control::{HighPass, Onset, QUARTILE, SAMPLE_RATE, Sectors, Standard};

/// Samples after an impact in which its ringing is looked at: the first quarter turn of the slowest that
/// a scene may have (500 Hz), and the first full turn of the default one.
const LOOKED: usize = 10;
/// No sample of these.
const NEVER: usize = usize::MAX;
/// Places within a sample at which a ringing's begin is tabulated.
const SHARES: usize = 8;
/// Share of its height at which the detector's memory of a ringing counts as gone: less than the noise of any ringing that a board can read.
const FORGOTTEN: f64 = 1.354e-4;
/// Weight of a sample in the memory of hidden time: 2000 samples, twice the memory of the detector's median, which it stands
/// for. From 5e-5 to 5e-3 every test passes.
const WEIGHT: f64 = 5e-4;

/// The onset detector's response to impacts in closed form: both its high-passes are linear, so that what a ringing
/// leaves of itself n samples after its first is one complex number for each n.
#[derive(Clone, Copy, Debug)]
pub struct OnsetModel<O = Standard> {
    ringing: Complex,
    /// Residual of a ringing of unit height that begins at a sample, n samples later: the imaginary part of this, both parts
    /// of it for all n.
    response: [[f64; LOOKED]; 2],
    /// Its limit, once the filters' own transient is over.
    steady: [[f64; LOOKED]; 2],
    /// Height of a ringing in the residual over its own.
    share: f64,
    /// RMS of the residual over the RMS of white noise in the reading.
    noise_gain: f64,
    /// Share of time that a ringing hides for each decay time that it does.
    filling: f64,
    /// What follows from the drive's frequency.
    tuning: Tuning,
    /// Share of time in which ringing hides the noise, over some cycles.
    hidden: f64,
    /// `e^(ringing n/8)`.
    onset: [Complex; SHARES + 1],
    /// What is left of a ringing, and of the memory, after whole samples.
    decay: Powers,
    oblivion: Powers,
    /// What the demodulator blanks.
    blanking: Blanking,
    /// What all of it rings with.
    energy: RingingEnergy,
    /// Logarithm of what a sample leaves of the detector's memory of a loud ringing.
    forgetting: f64,
    /// Samples after which it counts as gone.
    forgotten: u64,
    /// The last ringing that was loud.
    last: Ring,
    /// First sample at which another impact may be detected.
    open: u64,
    constants: PhantomData<O>,
}

/// What the detector makes of a drive that turns by `theta` rad a sample.
#[derive(Clone, Copy, Debug)]
struct Tuning {
    theta: f64,
    /// `1/(1 - e^(i theta) r)` for the ringing r of a sample and for its conjugate, times i/2.
    sums: [Complex; 2],
    /// `e^(i theta) r` for both to whole exponents.
    turns: [Powers; 2],
    /// `e^(i theta)`.
    turn: Complex,
    /// What both high-passes leave of the drive's own swing, and as a turn and a share of it.
    leak: f64,
    passed: Complex,
}

/// A ringing that was loud, as far as the detector's memory of it is known.
#[derive(Clone, Copy, Debug)]
struct Ring {
    /// `e^(i angle)` and height at its first sample, and that sample.
    began: Complex,
    sample: u64,
    /// The same of all earlier ones, at that sample.
    under: Complex,
    /// Samples of it that the memory has taken in.
    known: usize,
    memory: f64,
    /// Least height that is loud, and that is blanked.
    loud: f64,
    least: f64,
    /// First of its samples at which the memory is that high, or [`NEVER`].
    out: usize,
}

impl Ring {
    const NONE: Self = Self {
        began: Complex::new(0.0, 0.0),
        sample: 0,
        under: Complex::new(0.0, 0.0),
        known: LOOKED,
        memory: 0.0,
        loud: 0.0,
        least: f64::INFINITY,
        out: NEVER,
    };

    /// Whether nothing of earlier ones is left.
    fn is_alone(&self) -> bool {
        self.under == Complex::new(0.0, 0.0)
    }

    /// Feeds the detector's memory the height of the residual at the next sample.
    // Without branches: nothing foresees where a ringing is high.
    #[inline(always)]
    fn remember<O: Onset>(&mut self, residual: f64) {
        let memory = self.memory * O::MEMORY;
        let high = if residual > self.loud { residual } else { 0.0 };
        self.memory = if high > memory { high } else { memory };
        let out = if self.memory > self.least {
            self.known
        } else {
            NEVER
        };
        self.out = self.out.min(out);
        self.known += 1;
    }

    /// Feeds the detector's memory the samples of the last ringing that it has not taken in. The noise is that of the onset: what follows only says
    /// how long an impact soon after is taken for the same ringing.
    fn complete<O: Onset>(&mut self, residuals: &[f64; LOOKED]) {
        for residual in residuals.iter().skip(self.known) {
            self.remember::<O>(residual.abs());
        }
    }

    /// Residuals of all of them in the samples from its first on, without noise.
    #[inline(always)]
    fn residuals<O>(&self, model: &OnsetModel<O>) -> [f64; LOOKED] {
        let mut residuals = sines(self.began, &model.response);
        if !self.is_alone() {
            let before = sines(self.under, &model.steady);
            for (residual, before) in residuals.iter_mut().zip(before) {
                *residual += before;
            }
        }
        residuals
    }

    /// What is left at a sample of its ringing and of the detector's memory of it.
    fn left<O: Onset>(&self, model: &OnsetModel<O>, sample: u64) -> (Complex, f64) {
        let since = sample.saturating_sub(self.sample);
        if since >= model.forgotten {
            return (Complex::new(0.0, 0.0), 0.0);
        }
        let memory = if self.known < LOOKED {
            let mut whole = *self;
            whole.complete::<O>(&self.residuals(model));
            whole.memory
        } else {
            self.memory
        };
        let rings = self.began + self.under;
        let forgotten = since.saturating_sub(LOOKED as u64);
        (
            product(rings, model.decay.at(since)),
            memory * model.oblivion.at(forgotten).re,
        )
    }
}

/// Imaginary parts of the products of a number with others, of which all real and all imaginary parts are given.
#[inline(always)]
fn sines(number: Complex, [real, imaginary]: &[[f64; LOOKED]; 2]) -> [f64; LOOKED] {
    core::array::from_fn(|n| number.re * imaginary[n] + number.im * real[n])
}

/// An impact that is to be heard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Struck {
    /// The first sample after it, counted since the start of the scene.
    pub sample: u64,
    /// Its time before that sample in samples, 0..1.
    pub share: f64,
    /// Height of its ringing in m/s^2 as the board reads it.
    pub height: f64,
}

/// What the detector compares an impact with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Background {
    /// The detector's running median of the residual in m/s^2.
    pub median: f64,
    /// RMS of the residual's noise in m/s^2.
    pub rms: f64,
    /// What the detector's filters leave of the drive's own swing, in m/s^2: its real part at the impact's sample.
    pub leak: Complex,
}

/// An impact heard.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeardAt {
    /// Number of the sample since the start of the scene.
    pub sample: u64,
    /// Height of the residual in m/s^2.
    pub strength: f64,
}

impl OnsetModel {
    /// The detector's response to the ringing of a sensor.
    #[must_use]
    pub fn new(sensor: &SensorModel) -> Self {
        Self::with(sensor)
    }
}

impl<O: Onset> OnsetModel<O> {
    /// Threshold over the running median.
    const THRESHOLD: f64 = O::THRESHOLD / QUARTILE;

    /// As [`OnsetModel::new`], with other constants.
    #[must_use]
    pub fn with(sensor: &SensorModel) -> Self {
        let h = 1.0 / f64::from(SAMPLE_RATE);
        let ringing = Complex::new(
            -h / (f64::from(sensor.ringing_decay) * 1e-3),
            TAU * f64::from(sensor.ringing_frequency) * h,
        );
        let high_passed = |passes: &mut [HighPass<Complex>; 2], sample| {
            let once = passes[0].pass(O::CORNER, sample);
            passes[1].pass(O::CORNER, once)
        };
        let mut passes = [HighPass::default(); 2];
        let response: [Complex; LOOKED] =
            core::array::from_fn(|n| high_passed(&mut passes, exp(ringing * n as f64)));
        // What is left of one sample of noise, until the filters have forgotten it.
        let (mut passes, mut power, mut sample) = ([HighPass::default(); 2], 0.0, 1.0.into());
        for _ in 0..O::SETTLING {
            let left = high_passed(&mut passes, sample).re;
            power += left * left;
            sample = 0.0.into();
        }
        let forgetting = libm::log(O::MEMORY);
        let steady: [Complex; LOOKED] = core::array::from_fn(|n| {
            let since = n as f64 - (LOOKED - 1) as f64;
            response[LOOKED - 1] * exp(ringing * since)
        });
        let apart = |numbers: &[Complex; LOOKED]| [numbers.map(|n| n.re), numbers.map(|n| n.im)];
        Self {
            ringing,
            response: apart(&response),
            steady: apart(&steady),
            energy: RingingEnergy::new(ringing, &response, &steady),
            share: libm::sqrt(steady[0].norm_sqr()),
            noise_gain: libm::sqrt(power),
            filling: -WEIGHT / ringing.re,
            tuning: Tuning::new(ringing, 0.0, O::CORNER),
            hidden: 0.0,
            onset: core::array::from_fn(|n| exp(ringing * (n as f64 / SHARES as f64))),
            decay: Powers::new(ringing),
            oblivion: Powers::new(forgetting.into()),
            blanking: Blanking::default(),
            forgetting: forgetting.max(ringing.re),
            forgotten: (libm::log(FORGOTTEN) / forgetting) as u64,
            last: Ring::NONE,
            open: u64::from(O::SETTLING),
            constants: PhantomData,
        }
    }

    /// Takes over the speed of the drive: `theta` rad a sample.
    pub fn tune(&mut self, theta: f64) {
        if theta != self.tuning.theta {
            self.tuning = Tuning::new(self.ringing, theta, O::CORNER);
        }
    }

    /// What both high-passes leave of the drive's swing of unit amplitude.
    #[must_use]
    pub fn leak(&self) -> f64 {
        self.tuning.leak
    }

    /// RMS of the residual for a RMS of white noise in the reading.
    #[must_use]
    pub fn residual(&self, noise: f64) -> f64 {
        self.noise_gain * noise
    }

    /// The detector's median of a residual of a RMS, of whose square the drive's own swing is a share: the share of time
    /// that ringing fills lies above it.
    #[must_use]
    pub fn median(&self, rms: f64, swing: f64) -> f64 {
        // Of noise 0.6745 of the RMS, of a sine all of it; between them within 0.013, by numerical integration.
        let square = swing * swing;
        let alone = QUARTILE + square * (0.14 + (0.86 - QUARTILE) * square);
        // P(|n| > m) = (1/2 - q)/(1 - q), solved for m within a fiftieth: of noise, and less of a sine, which does not go beyond its crest.
        let hidden = self.hidden.min(0.4);
        let of_noise = 0.787 + hidden * (0.287 + 5.44 * hidden);
        let of_sine = 0.80 + 0.33 * hidden;
        // Between them within a twentieth, by numerical integration.
        let sine = (2.5 * swing - 1.5).max(0.0);
        rms * (alone + hidden * (of_noise + (of_sine - of_noise) * sine))
    }

    /// What the filters leave of a swing of the drive, both the complex amplitude of its cosine.
    #[must_use]
    pub fn leaked(&self, swing: Complex) -> Complex {
        swing * self.tuning.passed
    }

    /// Begins the cycle of so many samples from a sample on, and from a phase of the output, which a sample takes on by a
    /// step.
    pub fn begin(&mut self, sample: u64, samples: u32, phase: Phase, step: u32) {
        self.blanking.begin(sample, samples);
        self.energy.begin(sample, phase, step);
    }

    /// Energy of the residual in some sectors of the turn, at the end of a cycle of so many samples, under a RMS of its
    /// noise and a swing of the drive (complex amplitude of its cosine), both in m/s^2.
    pub fn sectors(&mut self, samples: u32, rms: f64, swing: Complex) -> Sectors {
        let leak = self.leaked(swing);
        self.energy.finish(samples, &Ground { rms, leak })
    }

    /// Whether nothing is blanked in the next cycle.
    pub fn keep_whole(&mut self, whole: bool) {
        self.blanking.keep_whole(whole);
    }

    /// Share of the cycle under way, of so many samples, that the demodulator blanks.
    #[must_use]
    pub fn blanked(&self, samples: u32) -> f64 {
        self.blanking.share(samples)
    }

    /// Lets an impact ring, `share` of a sample before one.
    #[cfg(test)]
    pub fn ring(&mut self, sample: u64, share: f64, height: f64) {
        self.energy.strike(sample, self.began(share) * height);
    }

    /// Takes an impact: whether it is heard, and the sum of its ringing against the drive's turn from its
    /// first sample on, as far as the demodulator does not leave it out.
    pub fn impact(
        &mut self,
        struck: Struck,
        background: Background,
        noise: &mut Noise,
    ) -> (Option<HeardAt>, Complex) {
        let Struck {
            sample,
            share,
            height,
        } = struck;
        let Background {
            median,
            rms,
            mut leak,
        } = background;
        let began = self.began(share) * height;
        self.energy.strike(sample, began);
        let (under, memory) = self.last.left(self, sample);
        let loud = Self::THRESHOLD * median;
        let mut ring = Ring {
            began,
            sample,
            under,
            known: 0,
            memory,
            loud,
            least: O::LOUD * loud,
            out: NEVER,
        };
        let residuals = ring.residuals(self);
        // Nothing that a ringing leaves is higher than itself.
        let quiet = height + under.l1_norm() + leak.l1_norm() + 3.5 * rms < loud;
        let mut heard = None;
        while ring.known < LOOKED && !quiet {
            let left = residuals[ring.known] + leak.re + rms * f64::from(noise.gauss());
            leak = product(leak, self.tuning.turn);
            let residual = left.abs();
            let at = sample + ring.known as u64;
            let above = residual > O::OVER_MEMORY * ring.memory;
            ring.remember::<O>(residual);
            if residual > loud && above && at >= self.open {
                heard = Some(HeardAt {
                    sample: at,
                    strength: residual,
                });
                // Blind while a ringing may still rise.
                self.open = at + u64::from(O::RISE) + 1;
                ring.out = ring.out.min(ring.known - 1);
                break;
            }
        }
        let sum = self.heeded(&mut ring, &residuals, heard.is_some());
        self.last = ring;
        if !quiet {
            let rings = height * self.share / median;
            self.hidden += hiding(logarithm(rings.max(1.0) as f32)) * self.filling;
        }
        (heard, sum)
    }

    /// Sum of a ringing as far as it is not blanked; it and those before are, where it is high, from then until
    /// the detector has forgotten it.
    #[inline(always)]
    fn heeded(&mut self, ring: &mut Ring, residuals: &[f64; LOOKED], heard: bool) -> Complex {
        let sample = ring.sample;
        let since = |at: u64| at.saturating_sub(sample);
        let held = self.blanking.until().max(sample);
        let began = self.sums(ring.began);
        let own = self.tail(began, since(held));
        let rings = ring.began + ring.under;
        // Without this, each impact of a quiet part would have its memory worked out.
        if !heard && rings.l1_norm() < ring.least && ring.memory < ring.least {
            return own;
        }
        ring.complete::<O>(residuals);
        if ring.out == NEVER {
            return own;
        }
        let from = (sample + ring.out as u64).max(held);
        // To a fifth of a sample.
        let lasts = logarithm((ring.memory / ring.least) as f32) / -self.forgetting;
        let mut forgotten = sample + (LOOKED as f64 + lasts).max(0.0) as u64;
        if heard {
            forgotten = forgotten.max(self.open);
        }
        let until = self.blanking.blank(from, forgotten).max(from);
        let sums = if ring.is_alone() {
            began
        } else {
            self.sums(rings)
        };
        own - self.tail(sums, since(from)) + self.tail(sums, since(until))
    }

    /// What both terms of a ringing's sum are at its first sample.
    fn sums(&self, began: Complex) -> [Complex; 2] {
        let [ahead, back] = self.tuning.sums;
        [product(began, ahead), product(began.conj(), back)]
    }

    /// Sum of a ringing against the drive's turn, from so many samples after its first on.
    #[inline(always)]
    fn tail(&self, [mut left, mut conjugate]: [Complex; 2], samples: u64) -> Complex {
        if samples > 0 {
            left = product(left, self.tuning.turns[0].at(samples));
            conjugate = product(conjugate, self.tuning.turns[1].at(samples));
        }
        conjugate - left
    }

    /// `e^(ringing share)`, `share` in 0..1.
    fn began(&self, share: f64) -> Complex {
        let nearest = (share * SHARES as f64 + 0.5) as usize;
        let Some(node) = self.onset.get(nearest) else {
            return exp(self.ringing * share);
        };
        let apart = share - nearest as f64 * (1.0 / SHARES as f64);
        product(*node, exp_small(self.ringing * apart))
    }

    /// Lets a cycle of this many samples pass.
    pub fn pass(&mut self, samples: u32) {
        self.hidden *= (1.0 - f64::from(samples) * WEIGHT).max(0.0);
    }
}

/// Decay times for which a ringing, that many e-folds over the detector's median as it begins, has the noise above the median as if
/// it were there all the time: twice the integral of what it adds to a half, within a tenth by numerical integration.
fn hiding(folds: f64) -> f64 {
    if folds < 2.0 {
        0.24 * folds * folds
    } else {
        folds - 1.06
    }
}

/// `ln x` within 0.007, for normal x: the exponent, and a parabola through the mantissa.
fn logarithm(x: f32) -> f64 {
    let bits = x.to_bits();
    let mantissa = f32::from_bits(bits & 0x007f_ffff | 0x3f80_0000);
    let exponent = (bits >> 23) as i32 - 127;
    let binary = exponent as f32 + (mantissa * (2.0 - mantissa * (1.0 / 3.0)) - 5.0 / 3.0);
    f64::from(binary * core::f32::consts::LN_2)
}

impl Tuning {
    fn new(ringing: Complex, theta: f64, corner: f64) -> Self {
        let one = Complex::new(1.0, 0.0);
        let turning = Complex::new(0.0, theta);
        // (1 - c)(1 - z^-1) / (1 - (1 - c) z^-1), twice.
        let back = turn(-theta);
        let once = (one - back) * (1.0 - corner) / (one - back * (1.0 - corner));
        let logs = [ringing + turning, ringing.conj() + turning];
        Self {
            theta,
            sums: logs.map(|log| (one - exp(log)).inv() * Complex::new(0.0, 0.5)),
            turns: logs.map(Powers::new),
            turn: back.conj(),
            leak: once.norm_sqr(),
            passed: once * once,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::super::drive::Ringing;
    use super::*;
    use crate::control::OnsetDetector;

    /// Impacts through the detector itself, sample by sample, and through its closed form.
    fn both<O: Onset>(height: f32, spacing: f64, sigma: f32) -> [Vec<u64>; 2] {
        let sensor = SensorModel::default();
        let mut detector = OnsetDetector::<O>::with(0.01);
        let mut ringing = Ringing::new(2400.0, 1e-3);
        let mut fast = OnsetModel::<O>::with(&sensor);
        let mut noise = [Noise::new(3), Noise::new(4)];
        let mut heard = [Vec::new(), Vec::new()];
        let mut next = 9000.25;
        for sample in 0..60_000_u64 {
            if next <= sample as f64 {
                let share = sample as f64 - next;
                ringing.strike(height, share as f32);
                let rms = fast.residual(f64::from(sigma));
                let median = fast.median(rms, 0.0).max(0.01);
                let struck = Struck {
                    sample,
                    share,
                    height: f64::from(height),
                };
                let background = Background {
                    median,
                    rms,
                    leak: Complex::default(),
                };
                let (found, _) = fast.impact(struck, background, &mut noise[1]);
                heard[1].extend(found.map(|found| found.sample));
                next += spacing;
            }
            let reading = ringing.acceleration() + sigma * noise[0].gauss();
            // The detector first learns its noise.
            if detector.sample(reading).is_some() && sample > 8000 {
                heard[0].push(sample);
            }
            ringing.step();
            if sample % 400 == 0 {
                fast.pass(400);
            }
        }
        heard
    }

    #[test]
    fn it_finds_what_the_detector_finds_when_the_detector_finds_it() {
        for (height, spacing, sigma) in [(6.0, 400.3, 0.15), (6.0, 133.7, 0.15), (2.0, 811.1, 0.1)]
        {
            let [slow, fast] = both::<Standard>(height, spacing, sigma);
            assert!(slow.len() > 50);
            assert_eq!(slow.len(), fast.len(), "{height} {spacing}");
            for (slow, fast) in slow.iter().zip(&fast) {
                // Each has its own noise, which may carry a slow rise over the threshold a sample early.
                assert!(slow.abs_diff(*fast) <= 2, "{slow} {fast}");
            }
        }
        let [slow, fast] = both::<Standard>(0.4, 400.3, 0.15);
        assert!(slow.is_empty() && fast.is_empty());
    }

    /// Impacts of a height at a phase of a drive of 100 Hz and 25 m/s^2 that are heard, of 500, by the detector and by its
    /// closed form.
    fn on_a_swing(height: f32, phase: f64, swing: f64) -> [u32; 2] {
        let theta = TAU / 200.0;
        let mut detector = OnsetDetector::new(0.01);
        let mut ringing = Ringing::new(2400.0, 1e-3);
        let mut fast = OnsetModel::new(&SensorModel::default());
        fast.tune(theta);
        let mut noise = [Noise::new(3), Noise::new(4)];
        let swing = Complex::new(swing, 0.0);
        let rms = fast.residual(0.15);
        let leaked = fast.leaked(swing);
        let square = rms * rms + 0.5 * leaked.norm_sqr();
        let swinging = 0.5 * leaked.norm_sqr() / square;
        let at = (phase / theta) as u64;
        let mut heard = [0, 0];
        for sample in 0..120_000_u64 {
            let turned = turn(theta * sample as f64);
            if sample % 200 == at {
                ringing.strike(height, 0.25);
                let background = Background {
                    median: fast.median(libm::sqrt(square), swinging),
                    rms,
                    leak: leaked * turned,
                };
                let struck = Struck {
                    sample,
                    share: 0.25,
                    height: f64::from(height),
                };
                let (found, _) = fast.impact(struck, background, &mut noise[1]);
                heard[1] += u32::from(found.is_some() && sample >= 20_000);
            }
            let drive = (swing * turned).re as f32;
            let reading = drive + ringing.acceleration() + 0.15 * noise[0].gauss();
            heard[0] += u32::from(detector.sample(reading).is_some() && sample >= 20_000);
            ringing.step();
            if sample % 200 == 199 {
                fast.pass(200);
            }
        }
        heard
    }

    #[test]
    fn a_swing_that_the_filters_leave_over_helps_or_hides_an_impact_in_both() {
        for (swing, lowest, step) in [(0.0, 0.5, 0.25), (25.0, 1.25, 0.25), (60.0, 2.5, 0.5)] {
            for phase in [0.4, 3.5] {
                // The height at which half of them are heard.
                let mut thresholds = [lowest; 2];
                for n in 0..9 {
                    let heard = on_a_swing((lowest + step * f64::from(n)) as f32, phase, swing);
                    for (threshold, heard) in thresholds.iter_mut().zip(heard) {
                        *threshold += step * (1.0 - f64::from(heard) / 500.0);
                    }
                }
                let [slow, fast] = thresholds;
                assert!(lowest + step < slow && slow < lowest + 8.0 * step, "{slow}");
                assert!(
                    (fast / slow - 1.0).abs() < 0.05,
                    "{swing} {phase}: {slow} {fast}"
                );
            }
        }
    }

    /// The standard constants but for one.
    macro_rules! but {
        ($($name:ident: $constant:ident: $kind:ty = $value:expr;)+) => { $(
            #[derive(Clone, Copy)]
            struct $name;
            impl Onset for $name {
                const $constant: $kind = $value;
            }
        )+ };
    }

    but! {
        Corner: CORNER: f64 = 0.8;
        Memory: MEMORY: f64 = 0.998;
        Rise: RISE: u32 = 200;
        Threshold: THRESHOLD: f64 = 20.0;
        OverMemory: OVER_MEMORY: f64 = 150.0;
        Loud: LOUD: f64 = 0.5;
        Settling: SETTLING: u32 = 30_000;
    }

    #[test]
    fn a_changed_constant_of_the_detector_changes_the_closed_form_with_it() {
        fn changed<O: Onset>(height: f32, spacing: f64, sigma: f32) {
            let [standard, _] = both::<Standard>(height, spacing, sigma);
            let [slow, fast] = both::<O>(height, spacing, sigma);
            assert!(slow.len() < 3 * standard.len() / 4, "{}", slow.len());
            assert!(slow.len().abs_diff(fast.len()) <= 1, "{slow:?} {fast:?}");
        }
        changed::<Corner>(1.5, 811.1, 0.1);
        changed::<Memory>(6.0, 133.7, 0.15);
        changed::<Rise>(6.0, 133.7, 0.15);
        changed::<Threshold>(1.5, 811.1, 0.1);
        changed::<OverMemory>(6.0, 133.7, 0.15);
        changed::<Settling>(6.0, 133.7, 0.15);
    }

    /// Samples of an impact's ringing that the demodulator blanks, by the detector and by its closed form.
    fn blanked<O: Onset>() -> [f64; 2] {
        let mut detector = OnsetDetector::<O>::with(0.1);
        let mut ringing = Ringing::new(2400.0, 1e-3);
        let rings = (0..4000).filter(|&sample| {
            if sample == 400 {
                ringing.strike(6.0, 0.25);
            }
            detector.sample(ringing.acceleration());
            ringing.step();
            detector.rings()
        });
        let rings = rings.count() as f64;
        let mut fast = OnsetModel::<O>::with(&SensorModel::default());
        fast.begin(400, 4000, Phase::ZERO, 1 << 20);
        let struck = Struck {
            sample: 400,
            share: 0.25,
            height: 6.0,
        };
        // As the detector has it, which begins with its floor for a median.
        let background = Background {
            median: 0.1,
            rms: 0.0,
            leak: Complex::default(),
        };
        fast.impact(struck, background, &mut Noise::new(1));
        [rings, fast.blanked(4000) * 4000.0]
    }

    #[test]
    fn a_changed_loudness_changes_what_is_blanked_in_both() {
        let ([slow, fast], [standard, _]) = (blanked::<Loud>(), blanked::<Standard>());
        // A quarter of the height takes ln 4 / 0.0356 = 39 samples longer; the detector's median falls meanwhile.
        assert!(
            (30.0..50.0).contains(&(slow - standard)),
            "{slow} {standard}"
        );
        assert!((slow - fast).abs() < 6.0, "{slow} {fast}");
    }

    #[test]
    fn the_demodulator_s_share_of_a_ringing_is_its_sum() {
        let mut fast = OnsetModel::new(&SensorModel::default());
        fast.tune(0.0157);
        let mut ringing = Ringing::new(2400.0, 1e-3);
        ringing.strike(1.0, 0.3);
        let mut sum = Complex::new(0.0, 0.0);
        for n in 0..2000 {
            sum += turn(0.0157 * f64::from(n)) * f64::from(ringing.acceleration());
            ringing.step();
        }
        // 2000 terms in f32.
        let struck = Struck {
            sample: 1000,
            share: 0.3,
            height: 1.0,
        };
        let background = Background {
            median: 0.1,
            rms: 0.1,
            leak: Complex::default(),
        };
        let (_, found) = fast.impact(struck, background, &mut Noise::new(1));
        assert!((sum - found).norm_sqr() < 1e-9);
    }
}
