//! The samples of a cycle that the demodulator blanks because an impact rings in it.

use crate::control::MOST_BLANKED;

/// The samples blanked in the cycle under way.
#[derive(Clone, Copy, Debug, Default)]
pub struct Blanking {
    /// First sample that is not blanked, counted since the start of the scene, and the end of the cycle.
    until: u64,
    end: u64,
    /// Samples of the cycle blanked, and how many more there may be.
    samples: u64,
    room: u64,
    /// Whether nothing is blanked in the next cycle.
    whole: bool,
}

impl Blanking {
    /// Begins the cycle of so many samples from a sample on.
    pub fn begin(&mut self, sample: u64, samples: u32) {
        let most = if self.whole {
            0
        } else {
            (MOST_BLANKED * f64::from(samples)) as u64
        };
        self.end = sample + u64::from(samples);
        self.samples = self.until.saturating_sub(sample).min(most);
        self.room = most - self.samples;
        self.until = sample + self.samples;
    }

    /// Whether nothing is blanked in the next cycle.
    pub fn keep_whole(&mut self, whole: bool) {
        self.whole = whole;
    }

    /// First sample that is not blanked.
    pub fn until(&self) -> u64 {
        self.until
    }

    /// Blanks the samples of a ringing, as far as there is room; the first that is not.
    pub fn blank(&mut self, from: u64, until: u64) -> u64 {
        let from = from.max(self.until);
        if until > from {
            let within = until.min(self.end).saturating_sub(from);
            let taken = within.min(self.room);
            self.samples += taken;
            self.room -= taken;
            self.until = if taken < within { from + taken } else { until };
        }
        self.until
    }

    /// Share of the cycle that is blanked, of so many samples.
    pub fn share(&self, samples: u32) -> f64 {
        self.samples as f64 / f64::from(samples.max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_third_of_a_cycle_is_blanked_at_most_and_what_goes_on_is_of_the_next() {
        let mut blanking = Blanking::default();
        blanking.begin(1000, 300);
        assert_eq!(blanking.blank(1010, 1040), 1040);
        // What overlaps counts once.
        assert_eq!(blanking.blank(1020, 1060), 1060);
        assert_eq!(blanking.until(), 1060);
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
