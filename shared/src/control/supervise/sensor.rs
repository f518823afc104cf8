//! Tests of the accelerometer: its mean against the commissioned one, and a small swing at each
//! start.
//!
//! The methods are limit checks: on a block average, and on the ratio of measured to predicted
//! amplitude (Isermann, Fault-Diagnosis Systems, 2006).

use crate::control::hear::Cycle;
use crate::control::settings::Settings;
use crate::feeder::STANDARD_GRAVITY;

/// Averaging time of the mean reading, in s: at 50 Hz the converter's noise leaves 0.03 mV.
const REST_SECONDS: f32 = 0.1;
/// Permitted drift of the voltage at zero acceleration, in V: temperature, supply, age.
const OFFSET_DRIFT: f32 = 0.02;
/// Permitted relative drift of the sensitivity.
const SENSITIVITY_DRIFT: f32 = 0.05;

/// Amplitude of the test swing over the hard limit.
const SWING_SHARE: f32 = 0.05;
/// Smallest amplitude of the test swing over the smallest detectable one: 24 steps of the
/// converter.
const SWING_RESOLUTION: f32 = 3.0;
/// Settling time of the test swing in time constants of the drive's envelope.
const SETTLING: f32 = 2.0;
/// Additional settling cycles of the test swing, for the dead time.
const SETTLING_CYCLES: f32 = 3.0;
/// Cycles over which the test swing is averaged.
const SWING_CYCLES: f32 = 8.0;
/// Value of the setting `gain_tolerance` from which no test swing runs: it was not commissioned.
pub const UNCOMMISSIONED: f32 = 2.5;

/// Compares the mean reading with the one at rest at commissioning, at rest and in operation. The
/// track's own acceleration has no mean.
#[derive(Clone, Copy, Debug)]
pub struct RestTest {
    /// Commissioned mean acceleration and largest deviation from it, in m/s^2; `None` without a
    /// commissioned one.
    commissioned: Option<[f32; 2]>,
    /// Drive cycles per average.
    length: f32,
    cycles: f32,
    sum: f32,
    /// Whether the last complete average deviates.
    deviates: Option<bool>,
}

impl RestTest {
    /// The test for these settings.
    pub fn build(settings: &Settings) -> Self {
        let Settings {
            sensitivity,
            sensor_zero,
            sensor_rest,
            converter_reference,
            converter_bits,
            ..
        } = *settings;
        let per_volt = STANDARD_GRAVITY as f32 / sensitivity;
        let step = converter_reference / libm::exp2f(converter_bits);
        let rest = (sensor_rest - sensor_zero) * per_volt;
        // The sensitivity drifts by a share of full gravity, whatever share the axis measures. A
        // wrong `sensor_zero` does not narrow the bound.
        let bound = (OFFSET_DRIFT + step) * per_volt + SENSITIVITY_DRIFT * STANDARD_GRAVITY as f32;
        Self {
            commissioned: (sensor_rest > 0.0).then_some([rest, bound]),
            length: libm::ceilf(REST_SECONDS * settings.frequency),
            cycles: 0.0,
            sum: 0.0,
            deviates: None,
        }
    }

    /// Restarts the average.
    pub fn restart(&mut self) {
        (self.sum, self.cycles, self.deviates) = (0.0, 0.0, None);
    }

    /// Adds the mean of a cycle.
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
        if self.commissioned.is_some() {
            self.deviates
        } else {
            Some(false)
        }
    }
}

/// Result of the test swing after a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SwingResult {
    /// There is no swing, or it still runs.
    Pending,
    /// Measured amplitude over predicted amplitude is within the tolerance.
    Passed,
    /// It is outside.
    Failed,
}

/// A small swing at each start. It compares the measured amplitude with the prediction from output
/// and commissioned gain.
#[derive(Clone, Copy, Debug)]
pub struct TestSwing {
    /// Largest factor between the two; `None` without commissioning.
    tolerance: Option<f32>,
    /// Settling cycles before the average begins.
    settling: f32,
    passed: bool,
    /// Whether the reference is held at the swing, and for how many cycles.
    held: bool,
    cycles: f32,
    /// Sums of the measured and predicted amplitudes, in m.
    measured: f32,
    expected: f32,
}

impl TestSwing {
    /// The swing for these settings. `envelope` is the time constant of the drive's envelope, in
    /// cycles.
    pub fn build(settings: &Settings, envelope: f32) -> Self {
        let tolerance = settings.gain_tolerance;
        Self {
            tolerance: (tolerance < UNCOMMISSIONED).then_some(tolerance),
            settling: SETTLING * envelope + SETTLING_CYCLES,
            passed: false,
            held: false,
            cycles: 0.0,
            measured: 0.0,
            expected: 0.0,
        }
    }

    /// Begins the test of a start.
    pub fn begin(&mut self) {
        *self = Self {
            passed: false,
            held: false,
            ..*self
        };
        self.restart();
    }

    fn restart(&mut self) {
        (self.cycles, self.measured, self.expected) = (0.0, 0.0, 0.0);
    }

    /// Limits until the swing has passed: for the reference, now at `now`, and for the amplitude
    /// that the outputs may drive without the accelerometer. All are in m. `ceiling` is the hard
    /// limit, `least` the smallest detectable amplitude.
    pub fn limits(&self, now: f32, ceiling: f32, least: f32) -> Option<[f32; 2]> {
        let tolerance = self.tolerance.filter(|_| !self.passed)?;
        let swing = (SWING_SHARE * ceiling).max(SWING_RESOLUTION * least);
        let swing = swing.max(now);
        Some([swing, tolerance * swing])
    }

    /// Sets whether the reference is held at the swing.
    pub fn hold(&mut self, held: bool) {
        self.held = held;
    }

    /// Adds the measured and predicted amplitudes of a cycle, in m.
    pub fn cycle(&mut self, measured: f32, expected: f32) -> SwingResult {
        let Some(tolerance) = self.tolerance.filter(|_| self.held && !self.passed) else {
            self.restart();
            return SwingResult::Pending;
        };
        self.cycles += 1.0;
        if self.cycles <= self.settling {
            return SwingResult::Pending;
        }
        self.measured += measured;
        self.expected += expected;
        if self.cycles < self.settling + SWING_CYCLES {
            return SwingResult::Pending;
        }
        let ratio = self.measured / self.expected;
        self.restart();
        // A ratio that is not a number fails too.
        if !(1.0..=tolerance * tolerance).contains(&(ratio * tolerance)) {
            return SwingResult::Failed;
        }
        self.passed = true;
        SwingResult::Passed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::state::{Fault, State};
    use crate::control::target::Target;
    use crate::plant::{Change, ClosedLoop, Disturbance, EnvelopeLoop, Scene};

    /// A commissioned machine whose sensor measures the share `seen` of 1 g at rest.
    fn commissioned(seen: f32) -> Scene {
        let mut scene = Scene {
            target: Target::Amplitude(0.5),
            ..Scene::default()
        };
        scene.parts.clear();
        scene.settings.sensor_rest = 1.65 + 0.1 * seen;
        scene.settings.gain_tolerance = 1.3;
        scene.settings.load_tolerance = 1.3;
        scene
    }

    /// Result of the test at rest after a time in s, for a reading that deviates by a voltage.
    fn after(settings: &Settings, seconds: f32, volts: f32) -> Option<bool> {
        let mut test = RestTest::build(settings);
        let rest = settings.sensor_rest + volts - settings.sensor_zero;
        let cycle = Cycle {
            mean: rest / settings.sensitivity * STANDARD_GRAVITY as f32,
            ..Cycle::default()
        };
        for _ in 0..(seconds * settings.frequency) as usize {
            test.cycle(&cycle);
        }
        test.deviates()
    }

    #[test]
    fn a_mean_beyond_drift_and_a_step_deviates() {
        // 20 mV of offset, 5 % of 0.1 V and a step of 0.8 mV.
        for seen in [-1.0, 0.0, 1.0] {
            let settings = commissioned(seen).settings;
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

    /// The fault of a scene within a time in s, the largest amplitude so far over the hard limit,
    /// and the time of the fault.
    fn run(scene: &Scene, seconds: f64) -> (Option<Fault>, f64, f64) {
        let mut closed = EnvelopeLoop::build(scene).unwrap();
        let limit = f64::from(scene.settings.amplitude_limit) * 1e-3;
        let mut largest = 0.0_f64;
        loop {
            let moment = closed.cycle();
            largest = largest.max(closed.amplitude() / limit);
            if moment.report.fault.is_some() || moment.time > seconds {
                return (moment.report.fault, largest, moment.time);
            }
        }
    }

    #[test]
    fn a_deviating_mean_at_rest_starts_nothing() {
        for (seen, sensitivity, refused) in [
            (1.0, 0.7, true),
            (1.0, 0.8, false),
            (-1.0, 1.3, true),
            (0.5, 0.45, true),
        ] {
            let mut scene = commissioned(seen);
            (scene.settings.gain_tolerance, scene.settings.load_tolerance) = (2.5, 2.5);
            scene.sensor.sensitivity = sensitivity;
            let (fault, largest, _) = run(&scene, 0.5);
            let expected = refused.then_some(Fault::SensorImplausible);
            assert_eq!(fault, expected, "{seen} {sensitivity}");
            assert_eq!(largest == 0.0, refused);
        }
        // An inverted sensor measures gravity with the other sign.
        let mut scene = commissioned(1.0);
        let inverted = Disturbance {
            at: 0.0,
            change: Change::SensorInverted(true),
        };
        scene.disturbances = core::iter::once(inverted).collect();
        let (fault, largest, _) = run(&scene, 0.5);
        assert_eq!((fault, largest), (Some(Fault::SensorImplausible), 0.0));
    }

    #[test]
    fn a_loss_just_before_the_enable_input_starts_nothing() {
        for at in [1.0, 1.93, 1.99] {
            let mut scene = commissioned(1.0);
            let changes = [
                (0.0, Change::Enable(false)),
                (at, Change::Sensitivity(0.55)),
                (2.0, Change::Enable(true)),
            ];
            let changes = changes.map(|(at, change)| Disturbance { at, change });
            scene.disturbances = changes.into_iter().collect();
            let (fault, largest, time) = run(&scene, 3.0);
            assert_eq!((fault, largest), (Some(Fault::SensorImplausible), 0.0));
            assert!((2.08..2.15).contains(&time), "{at}: {time}");
        }
    }

    #[test]
    fn a_mean_that_fades_during_the_run_is_a_fault_whatever_the_gain() {
        for gain in [1.0, 2.0] {
            let mut scene = commissioned(1.0);
            (scene.settings.gain_tolerance, scene.settings.load_tolerance) = (2.5, 2.5);
            scene.drive.gain = gain;
            let fades = (0..30).map(|n| Disturbance {
                at: 2.0 + 0.5 * f64::from(n),
                change: Change::Sensitivity(1.0 - 0.02 * n as f32),
            });
            scene.disturbances = fades.collect();
            let (fault, largest, time) = run(&scene, 17.0);
            assert_eq!(fault, Some(Fault::SensorImplausible));
            assert!(largest < 0.5 / 0.68, "{gain}: {largest}");
            // A quarter is lost after 8.5 s.
            assert!((8.4..10.1).contains(&time), "{gain}: {time}");
        }
    }

    #[test]
    fn a_test_swing_finds_what_the_tolerance_excludes() {
        // The sensor measures nothing of gravity: only the swing can detect it.
        for (sensitivity, gain, excluded) in [
            (1.0, 1.0, false),
            (0.8, 1.0, false),
            (1.0, 1.25, false),
            (0.75, 1.0, true),
            (0.55, 1.0, true),
            (1.0, 1.35, true),
            (1.0, 0.7, true),
            (0.55, 2.0, false),
        ] {
            let mut scene = commissioned(0.0);
            scene.sensor.sensitivity = sensitivity;
            scene.drive.gain = gain;
            let (fault, largest, time) = run(&scene, 2.0);
            let expected = excluded.then_some(Fault::SensorImplausible);
            assert_eq!(fault, expected, "{sensitivity} {gain}");
            if excluded {
                // 5 % of the limit, times tolerance and gain.
                let most = 0.05 * 1.3 * f64::from(gain) * 1.01;
                assert!(largest < most, "{sensitivity} {gain}: {largest}");
                assert!(time < 0.8, "{sensitivity} {gain}: {time}");
            }
        }
    }

    #[test]
    fn each_start_makes_a_test_swing() {
        let mut scene = commissioned(0.0);
        let changes = [
            (2.0, Change::Enable(false)),
            (3.5, Change::Sensitivity(0.55)),
            (4.0, Change::Enable(true)),
        ];
        let changes = changes.map(|(at, change)| Disturbance { at, change });
        scene.disturbances = changes.into_iter().collect();
        let mut closed = EnvelopeLoop::build(&scene).unwrap();
        let mut largest = [0.0_f64; 2];
        for _ in 0..250 {
            let moment = closed.cycle();
            let second = usize::from(moment.time > 4.0);
            largest[second] = largest[second].max(closed.amplitude());
        }
        let fault = closed.controller().report().fault;
        assert_eq!(fault, Some(Fault::SensorImplausible));
        assert!(largest[0] > 0.49e-3 && largest[1] < 0.07e-3, "{largest:?}");
    }

    #[test]
    fn the_reference_waits_at_the_swing_and_ready_stays_off() {
        let scene = commissioned(1.0);
        let mut closed = ClosedLoop::build(&scene).unwrap();
        let mut waited = 0;
        let mut held = None;
        for n in 0..200 {
            let report = closed.cycle().report;
            assert_eq!(report.fault, None);
            let ready = closed.controller().ready();
            // The default limit is 1 mm.
            if report.reference > 0.0 && report.reference <= 0.051e-3 {
                waited += 1;
                assert_eq!(report.state, State::Starting);
                assert!(!ready);
            }
            held = held.or(ready.then_some(n));
        }
        // 2 x 8 cycles of the envelope, 3 of dead time, 8 of averaging.
        assert!((27..=30).contains(&waited), "{waited}");
        assert!(held.is_some_and(|n| n < 70), "{held:?}");
    }

    #[test]
    fn a_swing_that_is_too_strong_for_its_output_ends() {
        let mut swing = TestSwing::build(&commissioned(0.0).settings, 8.0);
        swing.begin();
        swing.hold(true);
        let found = (0..40).find_map(|_| match swing.cycle(1e-4, 0.0) {
            SwingResult::Pending => None,
            other => Some(other),
        });
        assert_eq!(found, Some(SwingResult::Failed));
    }
}
