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
    /// Samples before the filters have forgotten the start.
    settling: u32,
}

/// Corner of the high-passes as a share of the sample rate, times 2 pi: 1 kHz at 20 kHz.
const CORNER: f32 = 0.27;
/// Decay of the memory of a ringing per sample: 1.4 ms at 20 kHz.
const MEMORY: f32 = 0.965;
/// Threshold over the running median: six times the RMS of Gaussian noise.
const THRESHOLD: f32 = 6.0 / 0.6745;

impl Ear {
    /// An ear that never takes less than `floor` (m/s^2, the converter's own steps) for noise.
    #[must_use]
    pub fn new(floor: f32) -> Self {
        Self {
            low: [0.0; 2],
            median: floor,
            ringing: 0.0,
            floor,
            settling: 200,
        }
    }

    /// RMS of the residual's noise in m/s^2.
    #[must_use]
    pub fn noise(&self) -> f32 {
        self.median * (1.0 / 0.6745)
    }

    /// Takes the acceleration of one sample in m/s^2; the height of the residual where an impact
    /// begins.
    #[inline]
    pub fn sample(&mut self, acceleration: f32) -> Option<f32> {
        self.low[0] += CORNER * (acceleration - self.low[0]);
        let once = acceleration - self.low[0];
        self.low[1] += CORNER * (once - self.low[1]);
        let residual = once - self.low[1];
        let height = if residual < 0.0 { -residual } else { residual };
        let step = self.median * (1.0 / 1024.0);
        if height > self.median {
            self.median += step;
        } else if self.median > self.floor {
            self.median -= step;
        }
        let heard = height > THRESHOLD * self.median && height > 1.5 * self.ringing;
        self.ringing *= MEMORY;
        if height > self.ringing {
            self.ringing = height;
        }
        if self.settling > 0 {
            self.settling -= 1;
            return None;
        }
        heard.then_some(height)
    }
}
