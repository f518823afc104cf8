//! Mean and standard error of independent values, by Welford's recurrence (Technometrics 4 (1962)
//! 419).

/// Mean and variance of successive values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleMean {
    count: u64,
    mean: f64,
    squares: f64,
}

impl SampleMean {
    /// Statistics of these values.
    pub fn from_values(values: impl IntoIterator<Item = f64>) -> Self {
        let mut spread = Self::default();
        for value in values {
            spread.add(value);
        }
        spread
    }

    /// Adds a value.
    pub fn add(&mut self, value: f64) {
        self.count += 1;
        let deviation = value - self.mean;
        self.mean += deviation / self.count as f64;
        self.squares += deviation * (value - self.mean);
    }

    /// Number of values.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Mean; `None` without a value.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then_some(self.mean)
    }

    /// Standard error of the mean for independent values; `None` with fewer than two.
    pub fn error(&self) -> Option<f64> {
        let count = self.count as f64;
        (self.count > 1).then(|| libm::sqrt(self.squares / (count - 1.0) / count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_error_match_the_textbook() {
        let spread = SampleMean::from_values([2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]);
        assert_eq!((spread.count(), spread.mean()), (8, Some(5.0)));
        // Sum of squares 32, over 7 and 8.
        assert!((spread.error().unwrap() - libm::sqrt(32.0 / 56.0)).abs() < 1e-15);
        assert_eq!(SampleMean::default().mean(), None);
        assert_eq!(SampleMean::from_values([1.0]).error(), None);
        // A large offset does not reduce the precision of the variance.
        let far = SampleMean::from_values([1e9 + 1.0, 1e9 + 2.0, 1e9 + 3.0]);
        assert!((far.error().unwrap() - libm::sqrt(1.0 / 3.0)).abs() < 1e-9);
    }
}
