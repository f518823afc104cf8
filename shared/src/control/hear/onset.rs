//! Listening: impacts of parts, heard in what the drive does not explain of the track's acceleration.

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

/// Hears the onset of impacts, sample by sample.
///
/// Two high-passes of first order at 1/20 of the sample rate leave the drive's own acceleration at
/// (50 Hz / 1 kHz)^2 = 1/400 and the ringing of an impact nearly whole. What remains is compared with
/// six times its own noise (the running median of its height) and with the decaying memory of the
/// last impact, so that one ringing is one impact.
#[derive(Clone, Copy, Debug)]
pub struct Ear {
    low: [f32; 2],
    /// Running median of the residual's height, in m/s^2: 0.6745 of the noise's RMS.
    median: f32,
    /// Memory of the ringing, in m/s^2.
    ringing: f32,
    floor: f32,
    /// Samples during which a ringing that was heard may still rise.
    rising: u32,
    /// Samples before the filters have forgotten the start.
    settling: u32,
}

/// Corner of the high-passes as a share of the sample rate, times 2 pi: 1 kHz at 20 kHz.
pub const CORNER: f32 = 0.27;
/// Decay of the memory of a ringing per sample: 1.4 ms at 20 kHz.
const MEMORY: f32 = 0.965;
/// Samples within which a ringing reaches its height: 0.6 ms at 20 kHz, a quarter period at 420 Hz.
const RISE: u32 = 12;
/// Threshold over the running median: six times the RMS of Gaussian noise.
const THRESHOLD: f32 = 6.0 / 0.6745;
/// Height of a loud ringing over the running median: twice that threshold.
const LOUD: f32 = 2.0 * THRESHOLD;

impl Ear {
    /// An ear that never takes less than `floor` (m/s^2, the converter's own steps) for noise.
    #[must_use]
    pub fn new(floor: f32) -> Self {
        Self {
            low: [0.0; 2],
            median: floor,
            ringing: 0.0,
            floor,
            rising: 0,
            settling: 200,
        }
    }

    /// RMS of the residual's noise in m/s^2.
    #[must_use]
    pub fn noise(&self) -> f32 {
        self.median * (1.0 / 0.6745)
    }

    /// Whether an impact rings that was just heard, or loudly.
    #[inline]
    #[must_use]
    pub fn rings(&self) -> bool {
        self.rising > 0 || self.ringing > LOUD * self.median
    }

    /// Takes the acceleration of one sample in m/s^2; the height of the residual where an impact
    /// begins.
    #[inline]
    pub fn sample(&mut self, acceleration: f32) -> Option<f32> {
        let residual = self.residual(acceleration);
        self.hears(residual)
    }

    /// Takes the acceleration of one sample in m/s^2; what the drive does not explain of it.
    #[inline]
    pub fn residual(&mut self, acceleration: f32) -> f32 {
        self.low[0] += CORNER * (acceleration - self.low[0]);
        let once = acceleration - self.low[0];
        self.low[1] += CORNER * (once - self.low[1]);
        once - self.low[1]
    }

    /// Takes the residual of one sample in m/s^2, and gives its height where an impact begins.
    #[inline]
    pub fn hears(&mut self, residual: f32) -> Option<f32> {
        let height = if residual < 0.0 { -residual } else { residual };
        let step = self.median * (1.0 / 1024.0);
        if height > self.median {
            self.median += step;
        } else if self.median > self.floor {
            self.median -= step;
        }
        let loud = height > THRESHOLD * self.median;
        let heard = loud && height > 1.5 * self.ringing && self.rising == 0;
        self.rising = if heard {
            RISE
        } else {
            self.rising.saturating_sub(1)
        };
        self.ringing *= MEMORY;
        if loud && height > self.ringing {
            self.ringing = height;
        }
        if self.settling > 0 {
            self.settling -= 1;
            return None;
        }
        heard.then_some(height)
    }
}

#[cfg(all(test, feature = "plant"))]
mod tests {
    use super::*;
    use crate::plant::Noise;

    /// Ringing of 2.4 kHz and 1 ms on the acceleration of a 50 Hz drive, with noise; the delays in
    /// samples from each impact to its stamp, and how many stamps there were.
    fn stamps(noise_to_impact: f32) -> (std::vec::Vec<f32>, usize) {
        let mut ear = Ear::new(0.01);
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
            let heard = ear.sample(drive + ringing + height * noise_to_impact * noise.gauss());
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
        let mut ear = Ear::new(0.01);
        let mut noise = Noise::new(6);
        let heard = (0..400_000)
            .filter(|n| ear.sample(0.3 * noise.gauss()).is_some() && *n > 8000)
            .count();
        assert_eq!(heard, 0);
    }
}
