//! Sensitivity of the conveying speed to the amplitude (docs/theory-transport.md#t8.4).

/// Relative change of the speed over relative change of the amplitude, `(dV/V)/(db/b)`.
///
/// With `V = W b w` and b proportional to 1/k it is `1 - d ln W / d ln k`. It is 1 where W does not
/// depend on k. It is 0 where W is proportional to k, as in lock at gamma = 0: there the speed does
/// not depend on b.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensitivity {
    /// The value.
    pub value: f64,
    /// Its standard error.
    pub error: f64,
}

impl Sensitivity {
    /// Sensitivity from the velocities W (in `b w`, with standard errors) at two values of k,
    /// `low < high`. `None` if they differ in sign.
    ///
    /// ```
    /// use kband::transport::Sensitivity;
    ///
    /// // In lock W is proportional to k: a change of amplitude changes nothing.
    /// let lock = Sensitivity::between((0.40, 0.80, 0.0), (0.44, 0.88, 0.0)).unwrap();
    /// assert!(lock.value.abs() < 1e-12 && lock.error == 0.0);
    /// ```
    pub fn between(
        (low, at_low, low_error): (f64, f64, f64),
        (high, at_high, high_error): (f64, f64, f64),
    ) -> Option<Self> {
        if !(at_low * at_high > 0.0 && low > 0.0 && high > low) {
            return None;
        }
        let span = libm::log(high / low);
        let value = 1.0 - libm::log(at_high / at_low) / span;
        let error = libm::hypot(low_error / at_low, high_error / at_high) / span;
        Some(Self { value, error })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{Kernel, Map, Tangential, TangentialSettings};
    use crate::transport::{Effort, Motion, Origin, SampleMean, measure};

    const SETTINGS: TangentialSettings = TangentialSettings {
        restitution: 0.3,
        amplitude_ratio: 2.0,
        phase_lead: 0.0,
        incline_tangent: 0.02,
    };

    fn sensitivity(
        low: f64,
        high: f64,
        restitution: f64,
        start: (f64, f64),
        impacts: u64,
    ) -> Sensitivity {
        let at = |k: f64| {
            let map = Map::build(k, restitution).unwrap();
            let tangential = Tangential::build(k, SETTINGS).unwrap();
            let spread = SampleMean::from_values((0..8).map(|n| {
                let state = Map::state(start.0 + 1e-3 * f64::from(n), start.1).unwrap();
                let effort = Effort {
                    settle: 300,
                    impacts,
                };
                let run = measure(&map, tangential, Origin::Hop(state), effort, &mut ());
                assert_eq!(run.motion, Motion::Hopping);
                run.conveyed.time_mean().unwrap()
            }));
            (k, spread.mean().unwrap(), spread.error().unwrap())
        };
        Sensitivity::between(at(low), at(high)).unwrap()
    }

    #[test]
    fn locked_speed_is_independent_of_the_amplitude() {
        let lock = sensitivity(0.42, 0.44, 0.2, (0.457, 0.45), 200);
        // W is proportional to k within the rounding of phases.
        assert!(lock.value.abs() < 1e-9 && lock.error < 1e-9, "{lock:?}");
    }

    #[test]
    fn chaotic_speed_is_proportional_to_the_amplitude() {
        let chaos = sensitivity(0.035, 0.07, 0.9, (0.4, 4.0), 6000);
        // Reference of a long run: 1.000 +- 0.002.
        assert!(
            chaos.error < 0.05 && (chaos.value - 1.0).abs() < 5.0 * chaos.error + 0.01,
            "{chaos:?}"
        );
    }

    #[test]
    fn powers_of_k_give_their_exponent() {
        for power in [-1.0, 0.0, 0.5, 1.0] {
            let at = |k: f64| (k, 3.0 * libm::pow(k, power), 0.0);
            let found = Sensitivity::between(at(0.4), at(0.5)).unwrap();
            assert!((found.value - (1.0 - power)).abs() < 1e-13);
        }
        assert_eq!(
            Sensitivity::between((0.4, 1.0, 0.0), (0.5, -1.0, 0.0)),
            None
        );
        assert_eq!(Sensitivity::between((0.5, 1.0, 0.0), (0.4, 1.0, 0.0)), None);
    }
}
