//! Sample-by-sample readings of the envelope plant, for cycles with saturation or averaging.

use super::EnvelopePlant;
use crate::model::drive::Ringing;
use crate::model::scene::SensorModel;
use kband::arithmetic::Phase;
use kband_control::Cycle;
use kband_control::signal_path::{OnsetDetector, SynchronousAverage};
use num_complex::Complex64 as Complex;

/// Constants that follow from the accelerometer's noise and sensitivity.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sense {
    /// Sensitivity over the configured one.
    pub factor: f64,
    /// RMS of its noise in m/s^2.
    pub noise: f64,
    /// RMS of white noise in the reading in m/s^2, the converter's rounding included.
    pub white: f64,
    /// RMS of this noise after the onset detector's filters, in the board's unit.
    pub residual: f64,
    /// Acceleration in m/s^2 that its axis measures of gravity at rest.
    pub rest: f64,
    /// Distance from the reading at rest to the nearer end of the converter's range, in m/s^2.
    pub headroom: f64,
    /// Converter step in m/s^2.
    pub floor: f64,
    /// Converter reading at rest, and its largest reading.
    pub zero: f64,
    pub full: f64,
}

/// Simulates a cycle's readings sample by sample: clipping is nonlinear, averaging needs each.
#[derive(Clone, Debug)]
pub(crate) struct Readings {
    ringing: Ringing,
    detector: OnsetDetector,
    average: SynchronousAverage,
    /// Whether averaging is active or a result is pending.
    pub averages: bool,
    /// Sample of the ringing's state.
    at: u64,
}

impl Readings {
    pub fn new(sensor: &SensorModel, sense: &Sense) -> Self {
        Self {
            ringing: Ringing::from_sensor(sensor),
            detector: OnsetDetector::new(sense.floor as f32),
            average: SynchronousAverage::empty(),
            averages: false,
            at: 0,
        }
    }

    /// Ends a cycle and sets the averaging of the next, as in the signal path.
    #[inline]
    pub fn finish(&mut self, from: Option<Phase>, step: u32, cycle: &mut Cycle) {
        if self.averages || from.is_some() {
            self.average.finish(from, step, &mut cycle.average);
            self.averages = !self.average.is_idle();
        }
    }
}

impl EnvelopePlant {
    /// Reads a cycle sample by sample; returns its demodulated acceleration in m/s^2.
    pub(super) fn read_each(&mut self, cycle: &mut Cycle) -> Complex {
        let (drive, sense, readings) = (&self.drive, self.sense, &mut self.readings);
        let sign = if self.timeline.inverted { -1.0 } else { 1.0 };
        let codes = sign * sense.factor / sense.floor;
        let samples = drive.samples();
        let (mut sum, mut low, mut high) = (Complex::new(0.0, 0.0), sense.full, 0.0_f64);
        if readings.at != self.sample {
            readings.ringing.silence();
        }
        let mut strikes = self.strikes.iter().peekable();
        for n in 0..samples {
            while let Some(strike) = strikes.peek() {
                let delay =
                    f64::from(n) - (strike.time as i64 - self.time) as f64 * drive.tuning.per_step;
                if delay < 0.0 {
                    break;
                }
                let height = f64::from(self.timeline.sensor.ringing) * strike.speed;
                (readings.ringing).strike(height as f32, delay.min(1.0) as f32);
                strikes.next();
            }
            let mut reading = drive.acceleration(n)
                + f64::from(readings.ringing.acceleration())
                + sense.noise * f64::from(self.noise.gauss())
                + sense.rest;
            if let Some(upper) = &self.upper {
                reading += upper.acceleration(f64::from(n), drive.phase_at(n).radians());
            }
            readings.ringing.step();
            let code = sense.zero + reading * codes + 0.5;
            let clipped_code = libm::floor(code.clamp(0.0, sense.full));
            if clipped_code < 1.0 || clipped_code >= sense.full {
                cycle.saturated += 1;
            }
            (low, high) = (low.min(clipped_code), high.max(clipped_code));
            // The signal path subtracts the mean before it demodulates.
            let read = (clipped_code - sense.zero) * sense.floor - sense.rest * sign * sense.factor;
            if readings.averages {
                let residual = readings.detector.residual(read as f32);
                readings.average.add(drive.phase_at(n), residual);
            }
            sum += drive.at(n) * read;
        }
        readings.at = self.sample + u64::from(samples);
        (cycle.low, cycle.high) = (low as u16, high as u16);
        sum * (2.0 / f64::from(samples) / (sign * sense.factor))
    }
}
