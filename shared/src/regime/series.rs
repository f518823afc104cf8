//! Standard error of the mean of correlated values, by the integrated autocorrelation time with
//! automatic windowing (Madras and Sokal 1988; Wolff 2004).

/// Standard error of the mean of successive `values`: `sqrt(variance tau/(n - 1))`; infinite for
/// fewer than two values. The autocorrelation time is `tau = 1 + 2 sum rho(t)` over the smallest
/// window of at least `5 tau`. The bias of a finite series is corrected. For the exponent at k =
/// 0.34, R = 0.2, the spread of 48 runs of 20 000 impacts is 0.9 to 1.2 times the estimate.
pub(super) fn standard_error(count: usize, value: impl Fn(usize) -> f64) -> f64 {
    if count < 2 {
        return f64::INFINITY;
    }
    let n = count as f64;
    let mean = (0..count).map(&value).sum::<f64>() / n;
    let deviation = |i: usize| value(i) - mean;
    let covariance = |lag: usize| {
        (lag..count)
            .map(|i| deviation(i) * deviation(i - lag))
            .sum::<f64>()
            / n
    };
    let variance = covariance(0);
    // Smallest window in values; negative autocorrelation shows within it.
    const MIN_WINDOW: usize = 8;
    let mut time = 1.0;
    let mut window = 0;
    while variance > 0.0 && window + 1 < count / 2 {
        window += 1;
        time += 2.0 * covariance(window) / variance;
        if window >= MIN_WINDOW && window as f64 >= 5.0 * time {
            break;
        }
    }
    let bias = 1.0 + (2.0 * window as f64 + 1.0) / n;
    libm::sqrt(variance * (time * bias).max(0.02) / (n - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::Noise;

    #[test]
    fn constant_values_have_no_error() {
        assert_eq!(standard_error(1, |_| 1.0), f64::INFINITY);
        assert_eq!(standard_error(30, |_| 1.0), 0.0);
    }

    /// The autoregression x' = a x + noise has tau = (1 + a)/(1 - a).
    #[test]
    fn correlated_errors_match_the_theory() {
        let mut noise = Noise::new(3);
        for a in [0.0_f64, 0.5, 0.8, -0.5] {
            let mut mean = 0.0;
            for _ in 0..40 {
                let mut x = 0.0;
                let values: [f64; 512] = core::array::from_fn(|_| {
                    x = a * x + 2.0 * f64::from(noise.uniform()) - 1.0;
                    x
                });
                mean += standard_error(values.len(), |n| values[n]) / 40.0;
            }
            let tau = (1.0 + a) / (1.0 - a);
            let expected = libm::sqrt(tau / 3.0 / (1.0 - a * a) / 512.0);
            // A window of 5 tau omits 1 % of the sum; its noise adds a few per cent.
            assert!((mean / expected - 1.0).abs() < 0.1, "{a}: {mean}");
        }
    }
}
