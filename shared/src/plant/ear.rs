//! What the board's ear makes of an impact, without its samples.

use core::f64::consts::TAU;

use num_complex::Complex64 as Complex;

use super::gap::Gap;
use super::noise::Noise;
use super::powers::Powers;
use super::recurrence::{exp, exp_small, turn};
use super::scene::SensorModel;
use crate::control::SAMPLE_RATE;

/// `ln MEMORY`.
const FORGETTING: f64 = -0.035_627_177_643_155_54;

/// Samples after an impact in which its ringing is looked at: the first quarter turn of the slowest that
/// a scene may have (500 Hz), and the first full turn of the default one.
const LOOKED: usize = 10;
/// Places within a sample at which a ringing's begin is tabulated.
const SHARES: usize = 8;
/// The ear's own constants (see [`Ear`](crate::control::Ear)): corner, memory, blind time, threshold.
const CORNER: f64 = 0.27;
const MEMORY: f64 = 0.965;
const BLIND: u64 = 13;
const THRESHOLD: f64 = 6.0 / 0.6745;
/// Memory over that threshold for which the demodulator leaves a sample out.
const LEFT_OUT: f64 = 2.0;
/// Weight of a sample in the memory of hidden time: 2000 samples.
const WEIGHT: f64 = 5e-4;

/// The ear's response to impacts in closed form: both its high-passes are linear, so that what a ringing
/// leaves of itself n samples after its first is one complex number for each n.
#[derive(Clone, Copy, Debug)]
pub struct ImpactEar {
    ringing: Complex,
    /// Residual of a ringing of unit height that begins at a sample, n samples later: its imaginary part.
    response: [Complex; LOOKED],
    /// What it tends to, once the filters have forgotten the begin.
    steady: [Complex; LOOKED],
    /// RMS of the residual over the RMS of white noise in the reading.
    noise_gain: f64,
    /// Share of time that a ringing hides for each e-fold of its height over the noise.
    filling: f64,
    /// What a drive's speed gives.
    tuning: Tuning,
    /// Share of time in which ringing hides the noise, over some cycles.
    hidden: f64,
    /// `e^(ringing n/8)`.
    onset: [Complex; SHARES + 1],
    /// What is left of a ringing, and of the memory, after whole samples.
    decay: Powers,
    oblivion: Powers,
    /// What the demodulator leaves out.
    gap: Gap,
    /// Logarithm of what a sample leaves of the ear's memory of a loud ringing.
    forgetting: f64,
    /// The last ringing that was loud.
    last: Ring,
    /// First sample at which another impact may be heard.
    open: u64,
}

/// What the ear makes of a drive that turns by `theta` rad a sample.
#[derive(Clone, Copy, Debug)]
struct Tuning {
    theta: f64,
    /// `1/(1 - e^(i theta) r)` for the ringing r of a sample and for its conjugate, times i/2.
    sums: [Complex; 2],
    /// `e^(i theta) r` for both to whole exponents.
    turns: [Powers; 2],
    /// What both high-passes leave of the drive's own swing.
    leak: f64,
}

/// A ringing that was loud, as far as the ear's memory of it is known.
#[derive(Clone, Copy, Debug)]
struct Ring {
    /// `e^(i angle)` and height at its first sample, and that sample.
    began: Complex,
    sample: u64,
    /// The same of all earlier ones, at that sample.
    under: Complex,
    /// Samples of it that the memory has.
    known: usize,
    memory: f64,
    /// Least height that is loud, and that is left out.
    loud: f64,
    least: f64,
    /// First of its samples at which the memory is that high.
    out: Option<usize>,
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
        out: None,
    };

    /// Residual so many samples after its first, without noise.
    fn residual(&self, ear: &ImpactEar, sample: usize) -> f64 {
        let own = self.began * ear.response[sample];
        if self.is_alone() {
            return own.im;
        }
        (own + self.under * ear.steady[sample]).im
    }

    /// Whether nothing of earlier ones is left.
    fn is_alone(&self) -> bool {
        self.under == Complex::new(0.0, 0.0)
    }

    /// Lets the ear's memory have the height of the residual at the next sample.
    fn remember(&mut self, residual: f64) {
        self.memory *= MEMORY;
        if residual > self.loud {
            self.memory = self.memory.max(residual);
        }
        if self.memory > self.least && self.out.is_none() {
            self.out = Some(self.known);
        }
        self.known += 1;
    }

    /// Lets the ear's memory have what it has not. The noise is that of the onset: what follows only says
    /// how long an impact soon after is taken for the same ringing.
    fn complete(&mut self, ear: &ImpactEar) {
        while self.known < LOOKED {
            self.remember(self.residual(ear, self.known).abs());
        }
    }

    /// What is left at a sample of its ringing and of the ear's memory of it.
    fn left(&self, ear: &ImpactEar, sample: u64) -> (Complex, f64) {
        let since = sample.saturating_sub(self.sample);
        // After 250 samples 1.4e-4 of it is left: less than the noise of any ringing that a board can read.
        if since >= 250 {
            return (Complex::new(0.0, 0.0), 0.0);
        }
        let mut whole = *self;
        whole.complete(ear);
        let rings = self.began + self.under;
        let forgotten = since.saturating_sub(LOOKED as u64);
        (
            rings * ear.decay.at(since),
            whole.memory * ear.oblivion.at(forgotten).re,
        )
    }
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

/// What the ear holds against impacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Background {
    /// The ear's running median of the residual in m/s^2.
    pub median: f64,
    /// RMS of the residual's noise in m/s^2.
    pub rms: f64,
}

/// An impact heard.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeardAt {
    /// Number of the sample since the start of the scene.
    pub sample: u64,
    /// Height of the residual in m/s^2.
    pub strength: f64,
}

impl ImpactEar {
    /// The ear for a sensor.
    #[must_use]
    pub fn new(sensor: &SensorModel) -> Self {
        let h = 1.0 / f64::from(SAMPLE_RATE);
        let ringing = Complex::new(
            -h / (f64::from(sensor.ringing_decay) * 1e-3),
            TAU * f64::from(sensor.ringing_frequency) * h,
        );
        let mut low = [Complex::new(0.0, 0.0); 2];
        let mut response = [Complex::new(0.0, 0.0); LOOKED];
        for (n, slot) in response.iter_mut().enumerate() {
            let input = exp(ringing * n as f64);
            low[0] += (input - low[0]) * CORNER;
            let once = input - low[0];
            low[1] += (once - low[1]) * CORNER;
            *slot = once - low[1];
        }
        let (mut low, mut power, mut input) = ([0.0; 2], 0.0, 1.0);
        // 200 samples are 60 time constants of either high-pass.
        for _ in 0..200 {
            low[0] += CORNER * (input - low[0]);
            let once: f64 = input - low[0];
            low[1] += CORNER * (once - low[1]);
            power += (once - low[1]) * (once - low[1]);
            input = 0.0;
        }
        Self {
            ringing,
            response,
            steady: core::array::from_fn(|n| {
                let since = n as f64 - (LOOKED - 1) as f64;
                response[LOOKED - 1] * exp(ringing * since)
            }),
            noise_gain: libm::sqrt(power),
            filling: -WEIGHT / ringing.re,
            tuning: Tuning::new(ringing, 0.0),
            hidden: 0.0,
            onset: core::array::from_fn(|n| exp(ringing * (n as f64 / SHARES as f64))),
            decay: Powers::new(ringing),
            oblivion: Powers::new(FORGETTING.into()),
            gap: Gap::default(),
            forgetting: FORGETTING.max(ringing.re),
            last: Ring::NONE,
            open: 200,
        }
    }

    /// Takes over the speed of the drive: `theta` rad a sample.
    pub fn tune(&mut self, theta: f64) {
        if theta != self.tuning.theta {
            self.tuning = Tuning::new(self.ringing, theta);
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

    /// The ear's median of a residual of a RMS: the share of time that ringing fills lies above it.
    #[must_use]
    pub fn median(&self, rms: f64) -> f64 {
        // P(|n| > m) = (1/2 - q)/(1 - q) around m = 0.6745: slope of the normal distribution there 0.636.
        rms * (0.6745 + 0.787 * self.hidden.min(0.4))
    }

    /// Begins the cycle of so many samples from a sample on.
    pub fn begin(&mut self, sample: u64, samples: u32) {
        self.gap.begin(sample, samples);
    }

    /// Whether nothing is left out of the next cycle.
    pub fn keep_whole(&mut self, whole: bool) {
        self.gap.keep_whole(whole);
    }

    /// Share of the cycle under way, of so many samples, that the demodulator leaves out.
    #[must_use]
    pub fn left_out(&self, samples: u32) -> f64 {
        self.gap.share(samples)
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
        let Background { median, rms } = background;
        let began = self.began(share) * height;
        let (under, memory) = self.last.left(self, sample);
        let loud = THRESHOLD * median;
        let mut ring = Ring {
            began,
            sample,
            under,
            known: 0,
            memory,
            loud,
            least: LEFT_OUT * loud,
            out: None,
        };
        // Nothing that a ringing leaves is higher than itself.
        let quiet = height + under.l1_norm() + 3.5 * rms < loud;
        let mut heard = None;
        while ring.known < LOOKED && !quiet {
            let left = ring.residual(self, ring.known) + rms * f64::from(noise.gauss());
            let residual = left.abs();
            let at = sample + ring.known as u64;
            let above = residual > 1.5 * ring.memory;
            ring.remember(residual);
            if residual > loud && above && at >= self.open {
                heard = Some(HeardAt {
                    sample: at,
                    strength: residual,
                });
                self.open = at + BLIND;
                ring.out = ring.out.or(Some(ring.known - 1));
                break;
            }
        }
        let sum = self.heeded(&mut ring, heard.is_some());
        self.last = ring;
        if !quiet {
            self.hidden += logarithm((height / median).max(1.0) as f32) * self.filling;
        }
        (heard, sum)
    }

    /// Sum of a ringing as far as it is not left out; it and those before are, where it is high, from then until
    /// the ear has forgotten it.
    fn heeded(&mut self, ring: &mut Ring, heard: bool) -> Complex {
        let sample = ring.sample;
        let since = |at: u64| at.saturating_sub(sample);
        let held = self.gap.until().max(sample);
        let began = self.sums(ring.began);
        let own = self.tail(began, since(held));
        let rings = ring.began + ring.under;
        // Without this, each impact of a quiet part would have its memory worked out.
        if !heard && rings.l1_norm() < ring.least && ring.memory < ring.least {
            return own;
        }
        ring.complete(self);
        let Some(out) = ring.out else {
            return own;
        };
        let from = (sample + out as u64).max(held);
        // To a fifth of a sample.
        let lasts = logarithm((ring.memory / ring.least) as f32) / -self.forgetting;
        let mut forgotten = sample + (LOOKED as f64 + lasts).max(0.0) as u64;
        if heard {
            forgotten = forgotten.max(self.open);
        }
        let until = self.gap.leave_out(from, forgotten).max(from);
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
        [began * ahead, began.conj() * back]
    }

    /// Sum of a ringing against the drive's turn, from so many samples after its first on.
    fn tail(&self, [mut left, mut conjugate]: [Complex; 2], samples: u64) -> Complex {
        if samples > 0 {
            left *= self.tuning.turns[0].at(samples);
            conjugate *= self.tuning.turns[1].at(samples);
        }
        conjugate - left
    }

    /// `e^(ringing share)`, `share` in 0..1.
    fn began(&self, share: f64) -> Complex {
        let nearest = (share * SHARES as f64 + 0.5) as usize;
        let Some(node) = self.onset.get(nearest) else {
            return exp(self.ringing * share);
        };
        node * exp_small(self.ringing * (share - nearest as f64 * (1.0 / SHARES as f64)))
    }

    /// Lets a cycle of this many samples pass.
    pub fn pass(&mut self, samples: u32) {
        self.hidden *= (1.0 - f64::from(samples) * WEIGHT).max(0.0);
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
    fn new(ringing: Complex, theta: f64) -> Self {
        let one = Complex::new(1.0, 0.0);
        let turning = Complex::new(0.0, theta);
        // (1 - c)(1 - z^-1) / (1 - (1 - c) z^-1), twice.
        let back = turn(-theta);
        let once = (one - back) * (1.0 - CORNER) / (one - back * (1.0 - CORNER));
        let logs = [ringing + turning, ringing.conj() + turning];
        Self {
            theta,
            sums: logs.map(|log| (one - exp(log)).inv() * Complex::new(0.0, 0.5)),
            turns: logs.map(Powers::new),
            leak: once.norm_sqr(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::super::drive::Ringing;
    use super::*;
    use crate::control::Ear;

    /// Impacts through the ear itself, sample by sample, and through its closed form.
    fn both(height: f32, spacing: f64, sigma: f32) -> [Vec<u64>; 2] {
        let sensor = SensorModel::default();
        let (mut ear, mut ringing) = (Ear::new(0.01), Ringing::new(2400.0, 1e-3));
        let mut fast = ImpactEar::new(&sensor);
        let mut noise = [Noise::new(3), Noise::new(4)];
        let mut heard = [Vec::new(), Vec::new()];
        let mut next = 9000.25;
        for sample in 0..60_000_u64 {
            if next <= sample as f64 {
                let share = sample as f64 - next;
                ringing.strike(height, share as f32);
                let rms = fast.residual(f64::from(sigma));
                let median = fast.median(rms).max(0.01);
                let struck = Struck {
                    sample,
                    share,
                    height: f64::from(height),
                };
                let background = Background { median, rms };
                let (found, _) = fast.impact(struck, background, &mut noise[1]);
                heard[1].extend(found.map(|found| found.sample));
                next += spacing;
            }
            let reading = ringing.acceleration() + sigma * noise[0].gauss();
            // The ear first learns its noise.
            if ear.sample(reading).is_some() && sample > 8000 {
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
    fn it_hears_what_the_ear_hears_when_the_ear_hears_it() {
        for (height, spacing, sigma) in [(6.0, 400.3, 0.15), (6.0, 133.7, 0.15), (2.0, 811.1, 0.1)]
        {
            let [slow, fast] = both(height, spacing, sigma);
            assert!(slow.len() > 50);
            assert_eq!(slow.len(), fast.len(), "{height} {spacing}");
            for (slow, fast) in slow.iter().zip(&fast) {
                // Each has its own noise, which may carry a slow rise over the threshold a sample early.
                assert!(slow.abs_diff(*fast) <= 2, "{slow} {fast}");
            }
        }
        let [slow, fast] = both(0.4, 400.3, 0.15);
        assert!(slow.is_empty() && fast.is_empty());
    }

    #[test]
    fn the_demodulator_s_share_of_a_ringing_is_its_sum() {
        let mut fast = ImpactEar::new(&SensorModel::default());
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
        };
        let (_, found) = fast.impact(struck, background, &mut Noise::new(1));
        assert!((sum - found).norm_sqr() < 1e-9);
    }
}
