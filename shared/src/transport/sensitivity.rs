//! Sensitivity of the conveying speed to the amplitude (docs/theory-transport.md#t8.4).

use crate::regime::cascade::Estimate;

/// Relative change of the speed over relative change of the amplitude, `(dV/V)/(db/b)`, with its
/// standard error.
///
/// With `V = W b w` and b proportional to 1/k it is `1 - d ln W / d ln k`. Inputs are k, W in `b w`
/// and its standard error at two values of k, `low < high`. `None` if the signs of W differ.
pub fn sensitivity(
    (low, at_low, low_error): (f64, f64, f64),
    (high, at_high, high_error): (f64, f64, f64),
) -> Option<Estimate> {
    if !(at_low * at_high > 0.0 && low > 0.0 && high > low) {
        return None;
    }
    let span = libm::log(high / low);
    let value = 1.0 - libm::log(at_high / at_low) / span;
    let error = libm::hypot(low_error / at_low, high_error / at_high) / span;
    Some(Estimate { value, error })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_k_give_their_exponent() {
        for power in [-1.0, 0.0, 0.5, 1.0] {
            let at = |k: f64| (k, 3.0 * libm::pow(k, power), 0.0);
            let actual = sensitivity(at(0.4), at(0.5)).unwrap();
            assert!((actual.value - (1.0 - power)).abs() < 1e-13);
        }
        for (low, high) in [((0.4, 1.0), (0.5, -1.0)), ((0.5, 1.0), (0.4, 1.0))] {
            let between = sensitivity((low.0, low.1, 0.0), (high.0, high.1, 0.0));
            assert_eq!(between, None);
        }
    }
}
