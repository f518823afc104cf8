//! The onset detector: impacts of parts, in what the drive does not explain of the track's acceleration.

use core::marker::PhantomData;
use core::ops::{Add, Mul, Sub};

use crate::arithmetic::Phase;

/// Most impacts that one drive cycle reports; more are counted, not stamped.
pub const HEARD_PER_CYCLE: usize = 8;

/// One impact heard.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Heard {
    /// Phase of the drive output when the residual rose.
    pub phase: Phase,
    /// Height of the residual where it rose over the threshold, in m/s^2.
    pub strength: f32,
}

/// The constants of the onset detector: one home for the detector itself and for its closed form in the
/// plant, so that a constant that is changed changes both.
pub trait Onset: Copy {
    /// Corner of both high-passes as a share of the sample rate, times 2 pi: 1 kHz at 20 kHz, which leaves a
    /// drive of 50 Hz (50/1000)^2 = 1/400 of its acceleration.
    const CORNER: f64 = 0.27;
    /// What a sample leaves of the memory of a ringing: a time constant of 1.4 ms at 20 kHz.
    const MEMORY: f64 = 0.965;
    /// Samples within which a ringing reaches its height: 0.6 ms at 20 kHz, a quarter period at 420 Hz.
    const RISE: u32 = 12;
    /// Least height of an impact over the RMS of the noise. Gaussian noise is that high twice in 10^9
    /// samples, or once in 7 hours at 20 kHz.
    const THRESHOLD: f64 = 6.0;
    /// Height of an impact over the memory of the last one: what is less is its own ringing.
    const OVER_MEMORY: f64 = 1.5;
    /// Memory of a ringing, over the threshold, from which on it is loud: the demodulator leaves it out.
    const LOUD: f64 = 2.0;
    /// Step of the running median of the noise a sample, as a share of it.
    const LEARNING: f64 = 1.0 / 1024.0;
    /// Samples before the first impact: 60 time constants of the high-passes.
    const SETTLING: u32 = 200;
}

/// Median of the height of Gaussian noise over its RMS: the third quartile of the normal distribution.
pub const QUARTILE: f64 = 0.6745;

/// The constants in use.
#[derive(Clone, Copy, Debug)]
pub struct Standard;

impl Onset for Standard {}

/// A high-pass of first order, on numbers of a kind.
#[derive(Clone, Copy, Debug, Default)]
pub struct HighPass<T>(T);

impl<T> HighPass<T> {
    /// Takes a sample; what is above the corner ([`Onset::CORNER`]).
    #[inline(always)]
    pub fn pass<F>(&mut self, corner: F, sample: T) -> T
    where
        T: Copy + Add<Output = T> + Sub<Output = T> + Mul<F, Output = T>,
    {
        self.0 = self.0 + (sample - self.0) * corner;
        sample - self.0
    }
}

/// Detects the onset of impacts, sample by sample.
///
/// Two high-passes of first order ([`Onset::CORNER`]) leave little of the drive's own acceleration and the
/// ringing of an impact nearly whole. What remains is compared with its own noise (the running median of its
/// height) and with the decaying memory of the last impact, so that one ringing is one impact.
#[derive(Clone, Copy, Debug)]
pub struct OnsetDetector<O = Standard> {
    passes: [HighPass<f32>; 2],
    /// Running median of the residual's height, in m/s^2: [`QUARTILE`] of the noise's RMS.
    median: f32,
    /// Memory of the ringing, in m/s^2.
    ringing: f32,
    floor: f32,
    /// Samples during which a ringing that was detected may still rise.
    rising: u32,
    /// Samples before the filters have forgotten the start.
    settling: u32,
    constants: PhantomData<O>,
}

impl OnsetDetector {
    /// A detector that never takes less than `floor` (m/s^2, the converter's own steps) for noise.
    #[must_use]
    pub fn new(floor: f32) -> Self {
        Self::with(floor)
    }
}

impl<O: Onset> OnsetDetector<O> {
    const CORNER: f32 = O::CORNER as f32;
    const MEMORY: f32 = O::MEMORY as f32;
    const OVER_MEMORY: f32 = O::OVER_MEMORY as f32;
    /// Threshold and loudness over the running median.
    const THRESHOLD: f32 = O::THRESHOLD as f32 / QUARTILE as f32;
    const LOUD: f32 = O::LOUD as f32 * Self::THRESHOLD;

    /// As [`OnsetDetector::new`], with other constants.
    #[must_use]
    pub fn with(floor: f32) -> Self {
        Self {
            passes: [HighPass::default(); 2],
            median: floor,
            ringing: 0.0,
            floor,
            rising: 0,
            settling: O::SETTLING,
            constants: PhantomData,
        }
    }

    /// RMS of the residual's noise in m/s^2.
    #[must_use]
    pub fn noise(&self) -> f32 {
        self.median * (1.0 / QUARTILE as f32)
    }

    /// Whether an impact rings that was just detected, or loudly.
    #[inline]
    #[must_use]
    pub fn rings(&self) -> bool {
        self.rising > 0 || self.ringing > Self::LOUD * self.median
    }

    /// Takes the acceleration of one sample in m/s^2; the height of the residual where an impact
    /// begins.
    #[cfg(test)]
    pub fn sample(&mut self, acceleration: f32) -> Option<f32> {
        let residual = self.residual(acceleration);
        self.detect(residual)
    }

    /// Takes the acceleration of one sample in m/s^2; what the drive does not explain of it.
    #[inline]
    pub fn residual(&mut self, acceleration: f32) -> f32 {
        let [first, second] = &mut self.passes;
        let once = first.pass(Self::CORNER, acceleration);
        second.pass(Self::CORNER, once)
    }

    /// Takes the residual of one sample in m/s^2, and gives its height where an impact begins.
    #[inline]
    pub fn detect(&mut self, residual: f32) -> Option<f32> {
        let height = if residual < 0.0 { -residual } else { residual };
        let step = self.median * O::LEARNING as f32;
        if height > self.median {
            self.median += step;
        } else if self.median > self.floor {
            self.median -= step;
        }
        let above = height > Self::THRESHOLD * self.median;
        let begins = above && height > Self::OVER_MEMORY * self.ringing && self.rising == 0;
        self.rising = if begins {
            O::RISE
        } else {
            self.rising.saturating_sub(1)
        };
        self.ringing *= Self::MEMORY;
        if above && height > self.ringing {
            self.ringing = height;
        }
        if self.settling > 0 {
            self.settling -= 1;
            return None;
        }
        begins.then_some(height)
    }
}

#[cfg(all(test, feature = "plant"))]
mod tests {
    use super::*;
    use crate::plant::Noise;

    /// Ringing of 2.4 kHz and 1 ms on the acceleration of a 50 Hz drive, with noise; the delays in
    /// samples from each impact to its stamp, and how many stamps there were.
    fn stamps(noise_to_impact: f32) -> (std::vec::Vec<f32>, usize) {
        let mut detector = OnsetDetector::new(0.01);
        let mut noise = Noise::new(5);
        let (mut delays, mut stamped) = (std::vec::Vec::new(), 0);
        let height = 5.0;
        let mut struck = f32::NEG_INFINITY;
        for n in 0..400_000_u32 {
            // One impact a cycle, at a place that wanders through the cycle and between the samples.
            if n % 400 == (n / 400) % 100 {
                struck = n as f32 + 0.37 * ((n / 400) % 3) as f32;
            }
            let since = (n as f32 - struck).max(0.0);
            let ringing = height * libm::expf(-since / 20.0) * libm::sinf(0.754 * since);
            let drive = 22.0 * libm::sinf((n % 400) as f32 * 0.015_708);
            let heard = detector.sample(drive + ringing + height * noise_to_impact * noise.gauss());
            if heard.is_some() && n > 8000 {
                stamped += 1;
                delays.push(n as f32 - struck);
            }
        }
        (delays, stamped)
    }

    #[test]
    fn impacts_at_26_decibels_are_stamped_within_a_twentieth_of_a_radian() {
        let (delays, stamped) = stamps(0.05);
        // 980 cycles after the noise is known; each impact once.
        assert!((978..=982).contains(&stamped), "{stamped}");
        let step = 0.015_708;
        for delay in delays {
            // The signal path stamps the sample before.
            assert!(((delay - 1.0) * step).abs() < 0.05, "{delay}");
        }
    }

    #[test]
    fn noise_alone_is_not_an_impact() {
        let mut detector = OnsetDetector::new(0.01);
        let mut noise = Noise::new(6);
        let heard = (0..400_000)
            .filter(|n| detector.sample(0.3 * noise.gauss()).is_some() && *n > 8000)
            .count();
        assert_eq!(heard, 0);
    }
}
