//! Samples of a cycle that the demodulator blanks during the ringing of an impact.

use kband_control::signal_path::MAX_BLANKED_SHARE;

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
        let from = from.max(self.until);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_most_a_third_of_a_cycle_is_blanked() {
        let mut blanking = Blanking::default();
        blanking.begin(1000, 300);
        assert_eq!(blanking.blank(1010, 1040), 1040);
        // Overlapping samples count once.
        assert_eq!(blanking.blank(1020, 1060), 1060);
        assert_eq!(blanking.until, 1060);
        assert!((blanking.share(300) - 50.0 / 300.0).abs() < 1e-12);
        assert_eq!(blanking.blank(1100, 1200), 1150);
        assert!((blanking.share(300) - 100.0 / 300.0).abs() < 1e-12);
        blanking.begin(1300, 300);
        assert_eq!(blanking.share(300), 0.0);
        assert_eq!(blanking.blank(1590, 1630), 1630);
        assert!((blanking.share(300) - 10.0 / 300.0).abs() < 1e-12);
        blanking.begin(1600, 300);
        assert!((blanking.share(300) - 30.0 / 300.0).abs() < 1e-12);
    }
}
