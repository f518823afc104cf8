//! Tests of the accelerometer: its mean against the commissioned one, and a swing at each start.
//!
//! Limit checks on a block average and a ratio (Isermann, Fault-Diagnosis Systems, 2006).

use crate::{Cycle, Settings};
use kband::feeder::STANDARD_GRAVITY;

/// Averaging time of the mean reading, in s: at 50 Hz 0.03 mV of the converter's noise remain.
const REST_SECONDS: f32 = 0.1;
/// Permitted drift of the voltage at zero acceleration, in V: temperature, supply, age.
const OFFSET_DRIFT: f32 = 0.02;
/// Permitted relative drift of the sensitivity.
const SENSITIVITY_DRIFT: f32 = 0.05;
/// Amplitude of the test swing over the hard limit.
const SWING_SHARE: f32 = 0.05;
/// Smallest amplitude of the test swing over the smallest detectable one.
const SWING_RESOLUTION: f32 = 3.0;
/// Settling time of the test swing in time constants of the drive's envelope.
const SETTLING_TIME_CONSTANTS: f32 = 2.0;
/// Additional settling cycles of the test swing, for the dead time.
const SETTLING_CYCLES: f32 = 3.0;
/// Cycles over which the test swing is averaged.
const SWING_CYCLES: f32 = 8.0;
/// Value of the setting `gain_tolerance` at which no test swing runs: it was not commissioned.
pub const UNCOMMISSIONED_TOLERANCE: f32 = 2.5;

/// Compares the mean reading with the one at rest at commissioning; motion has no mean.
#[derive(Clone, Copy, Debug, Default)]
pub struct RestTest {
    /// Commissioned mean acceleration and largest deviation from it, in m/s^2.
    commissioned: Option<[f32; 2]>,
    /// Drive cycles per average.
    length: f32,
    cycles: f32,
    sum: f32,
    deviates: Option<bool>,
}

impl RestTest {
    pub fn build(settings: &Settings) -> Self {
        let per_volt = STANDARD_GRAVITY as f32 / settings.sensitivity;
        let step = settings.converter_reference / libm::exp2f(settings.converter_bits);
        let rest = (settings.sensor_rest - settings.sensor_zero) * per_volt;
        // The sensitivity drifts by a share of full gravity, whatever component the axis measures.
        let bound = (OFFSET_DRIFT + step) * per_volt + SENSITIVITY_DRIFT * STANDARD_GRAVITY as f32;
        Self {
            commissioned: (settings.sensor_rest > 0.0).then_some([rest, bound]),
            length: libm::ceilf(REST_SECONDS * settings.frequency),
            ..Self::default()
        }
    }

    pub fn restart(&mut self) {
        (self.sum, self.cycles, self.deviates) = (0.0, 0.0, None);
    }

    pub fn cycle(&mut self, cycle: &Cycle) {
        let Some([rest, bound]) = self.commissioned else {
            return;
        };
        self.sum += cycle.mean;
        self.cycles += 1.0;
        if self.cycles >= self.length {
            let mean = self.sum / self.cycles;
            self.deviates = Some((mean - rest).abs() > bound);
            (self.sum, self.cycles) = (0.0, 0.0);
        }
    }

    /// Whether the mean deviates; `None` before the first average.
    pub fn deviates(&self) -> Option<bool> {
        self.commissioned.map_or(Some(false), |_| self.deviates)
    }
}

/// A small swing at each start, compared with the predictions from output and from current.
#[derive(Clone, Copy, Debug, Default)]
pub struct TestSwing {
    /// Largest factor between the two; `None` without commissioning.
    tolerance: Option<f32>,
    /// Settling cycles before the average begins.
    settling: f32,
    passed: bool,
    /// Whether the reference is held at the swing, and for how many cycles.
    pub held: bool,
    cycles: f32,
    /// Sums of the measured and predicted amplitudes, in m.
    measured: f32,
    expected: [f32; 2],
}

impl TestSwing {
    /// The swing for these settings; `envelope`: time constant of the drive's envelope, in cycles.
    pub fn build(settings: &Settings, envelope: f32) -> Self {
        let tolerance = settings.gain_tolerance;
        Self {
            tolerance: (tolerance < UNCOMMISSIONED_TOLERANCE).then_some(tolerance),
            settling: SETTLING_TIME_CONSTANTS * envelope + SETTLING_CYCLES,
            ..Self::default()
        }
    }

    pub fn begin(&mut self) {
        (self.passed, self.held) = (false, false);
        self.restart();
    }

    fn restart(&mut self) {
        (self.cycles, self.measured, self.expected) = (0.0, 0.0, [0.0; 2]);
    }

    /// Limits until the swing has passed, in m: of the reference, now at `now`, and of the outputs'
    /// amplitude. `ceiling`: hard limit; `min_amplitude`: smallest detectable one.
    pub fn limits(&self, now: f32, ceiling: f32, min_amplitude: f32) -> Option<[f32; 2]> {
        let tolerance = self.tolerance.filter(|_| !self.passed)?;
        let swing = (SWING_SHARE * ceiling).max(SWING_RESOLUTION * min_amplitude);
        let swing = swing.max(now);
        Some([swing, tolerance * swing])
    }

    /// Adds the measured amplitude of a cycle and those predicted from output and current, in m. At
    /// the end of the swing it returns whether their ratios are within the tolerance.
    pub fn cycle(&mut self, measured: f32, expected: [f32; 2]) -> Option<bool> {
        let Some(tolerance) = self.tolerance.filter(|_| self.held && !self.passed) else {
            self.restart();
            return None;
        };
        self.cycles += 1.0;
        if self.cycles <= self.settling {
            return None;
        }
        self.measured += measured;
        for (sum, expected) in self.expected.iter_mut().zip(expected) {
            *sum += expected;
        }
        if self.cycles < self.settling + SWING_CYCLES {
            return None;
        }
        let [by_output, by_current] = self.expected.map(|expected| self.measured / expected);
        self.restart();
        // A ratio that is not a number fails too.
        let plausible = |ratio: f32| (1.0..=tolerance * tolerance).contains(&(ratio * tolerance));
        self.passed = plausible(by_output) && plausible(by_current);
        Some(self.passed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;

    /// Settings of a commissioned machine whose sensor measures the share `mean` of 1 g at rest.
    fn commissioned(mean: f32) -> Settings {
        with(Settings::default(), |it| {
            (it.gain_tolerance, it.load_tolerance) = (1.3, 1.3);
            it.sensor_rest = 1.65 + 0.1 * mean;
        })
    }

    /// Result of the test at rest after a time in s, for a reading that deviates by a voltage.
    fn after(settings: &Settings, seconds: f32, volts: f32) -> Option<bool> {
        let mut test = RestTest::build(settings);
        let rest = settings.sensor_rest + volts - settings.sensor_zero;
        let mean = rest / settings.sensitivity * STANDARD_GRAVITY as f32;
        let cycle = with(Cycle::default(), |it| it.mean = mean);
        for _ in 0..(seconds * settings.frequency) as usize {
            test.cycle(&cycle);
        }
        test.deviates()
    }

    #[test]
    fn a_mean_beyond_drift_and_a_step_deviates() {
        // 20 mV of offset, 5 % of 0.1 V and a step of 0.8 mV.
        for mean in [-1.0, 0.0, 1.0] {
            let settings = commissioned(mean);
            for (volts, deviates) in [(0.0255, false), (0.0262, true)] {
                for sign in [-1.0, 1.0] {
                    assert_eq!(after(&settings, 0.11, sign * volts), Some(deviates));
                }
                assert_eq!(after(&settings, 0.09, volts), None);
            }
        }
        let uncommissioned = Settings::default();
        assert_eq!(after(&uncommissioned, 0.0, 1.0), Some(false));
        assert_eq!(after(&uncommissioned, 1.0, 1.0), Some(false));
    }

    fn held_swing() -> TestSwing {
        let swing = TestSwing::build(&commissioned(0.0), 8.0);
        with(swing, |it| it.held = true)
    }

    #[test]
    fn a_swing_that_is_too_strong_for_its_output_ends() {
        let mut swing = held_swing();
        let passed = (0..40).find_map(|_| swing.cycle(1e-4, [0.0; 2]));
        assert_eq!(passed, Some(false));
    }

    #[test]
    fn the_swing_is_averaged_after_it_has_settled() {
        let mut swing = held_swing();
        // 19 cycles to settle, in which the sensor measures nothing yet.
        let results: std::vec::Vec<_> = (1..=27)
            .map(|n| swing.cycle(if n > 19 { 1e-4 } else { 0.0 }, [1e-4; 2]))
            .collect();
        assert!(results[..26].iter().all(Option::is_none));
        assert_eq!(results[26], Some(true));
    }

    #[test]
    fn an_uncommissioned_gain_has_no_test_swing() {
        let limits = |gain_tolerance| {
            let settings = with(commissioned(0.0), |it| it.gain_tolerance = gain_tolerance);
            TestSwing::build(&settings, 8.0).limits(0.0, 1e-3, 1e-6)
        };
        assert!(limits(2.4).is_some());
        assert_eq!(limits(UNCOMMISSIONED_TOLERANCE), None);
    }
}
