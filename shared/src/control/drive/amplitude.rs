//! The amplitude loop: track amplitude b to its reference, cycle by cycle.

use crate::control::saturate::saturate;
use crate::control::settings::Settings;
use crate::feeder::OutOfRange;

/// Time constant of the closed loop in cycles. The loop's dead time is two cycles (half a cycle of averaging, one
/// of latching, half of output), so six leave a phase margin of 70 degrees and a gain margin above four. With 4 the
/// scene `identification` fails, with 9 `settles_to_a_percent_within_a_second_whatever_the_gain`.
const CLOSED_LOOP: f32 = 6.0;
/// Weight of a cycle in the running estimate of the drive's gain: a memory of 25 cycles, four times that of the
/// closed loop, so that neither follows the other. At 0.01 `settles_to_a_percent_within_a_second_whatever_the_gain`
/// fails, at 0.4 identifications do.
const LEARNING: f32 = 0.04;
/// How far the estimate of the drive's gain may go from its setting: a drive weaker than that is none (see the
/// fault detector), a stronger one is out of its scale. From 1.2 to 16 every scene passes.
const GAIN_RANGE: f32 = 4.0;
/// Share of the full envelope from which on the gain is learned: at default settings and 50 Hz, 2 m/s^2 of
/// acceleration, 13 times the noise of a reading. At 0 and at 0.1 identifications fail.
const TELLING: f32 = 0.02;

/// Fixed values of the loop, from settings.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tuning {
    /// Share of the envelope that survives one cycle: exp(-pi / Q).
    keep: f32,
    /// Integral gain over proportional gain, per cycle.
    integral: f32,
    /// Proportional gain times the drive's gain.
    proportional: f32,
    low: f32,
    high: f32,
    nominal: f32,
}

/// A PI controller on b with feedforward through the inverse of the drive's envelope, anti-windup and
/// a running estimate of the drive's gain.
///
/// The reference itself is the model: a reference that moves as the drive's envelope can follow is
/// tracked by the feedforward alone, and the PI only sees what the model does not explain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AmplitudeLoop {
    tuning: Tuning,
    /// Estimated track amplitude for full output, in m.
    gain: f32,
    /// Share of full output.
    integral_term: f32,
    /// Reference at the ends of the last cycles, newest first, in m: the cycle that the output
    /// computed now will drive, the one running, the one measured, and the one before.
    reference: [f32; 4],
    /// Outputs of the same cycles, newest first.
    output: [f32; 3],
    /// Envelope of the measured cycle's end for unit gain.
    model: f32,
    saturated: bool,
}

impl AmplitudeLoop {
    /// The loop for these settings, at rest.
    pub fn build(settings: &Settings) -> Result<Self, OutOfRange> {
        settings.check()?;
        let cycles = settings.quality * (1.0 / core::f32::consts::PI) * settings.frequency
            / settings.resonance;
        let nominal = settings.gain * 1e-3;
        Ok(Self {
            tuning: Tuning {
                keep: libm::expf(-1.0 / cycles),
                integral: 1.0 / cycles,
                proportional: cycles / CLOSED_LOOP,
                low: settings.output_minimum,
                high: settings.output_maximum,
                nominal,
            },
            gain: nominal,
            integral_term: 0.0,
            reference: [0.0; 4],
            output: [0.0; 3],
            model: 0.0,
            saturated: false,
        })
    }

    /// Forgets all but the estimate of the gain: the drive is at rest.
    pub fn reset(&mut self) {
        self.integral_term = 0.0;
        self.reference = [0.0; 4];
        self.output = [0.0; 3];
        self.model = 0.0;
        self.saturated = false;
    }

    /// Takes over at an amplitude (m) that an output has brought about and holds.
    pub fn resume(&mut self, amplitude: f32, output: f32) {
        self.reset();
        self.reference = [amplitude; 4];
        self.output = [output; 3];
        self.model = output;
        if output > 0.0 && amplitude > 0.0 {
            self.gain = amplitude / output;
        }
    }

    /// Takes the amplitude measured in the cycle that just ended and the reference at the end of the
    /// cycle after next, both in m; gives the output for that cycle as a share of full output, `most` at most.
    pub fn cycle(&mut self, measured: f32, reference: f32, most: f32) -> f32 {
        let Tuning {
            keep,
            integral,
            proportional,
            low,
            high,
            nominal,
        } = self.tuning;
        let high = high.min(most);
        // Nothing but a track that is to move needs the least output.
        let low = if reference > 0.0 { low.min(high) } else { 0.0 };
        let [newest, before, oldest, _] = self.reference;
        self.reference = [reference, newest, before, oldest];
        let before = self.model;
        self.model = keep * before + (1.0 - keep) * self.output[1];
        // The gain is learned where the output is large enough to tell it.
        let explained = 0.5 * (before + self.model);
        if explained > TELLING {
            let seen = measured / explained;
            let old = self.gain;
            let seen = saturate(seen, nominal / GAIN_RANGE, nominal * GAIN_RANGE);
            self.gain += LEARNING * (seen - old);
            // What the feedforward now does, the integral term need not do any more.
            self.integral_term += self.reference[2] * (1.0 / old - 1.0 / self.gain);
        }
        let wanted = 0.5 * (self.reference[2] + self.reference[3]);
        let error = wanted - measured;
        let inverse = 1.0 / self.gain;
        let feedforward = (self.reference[0] - keep * self.reference[1]) * inverse / (1.0 - keep);
        let proportional_term = proportional * error * inverse;
        let raw = feedforward + proportional_term + self.integral_term;
        let output = saturate(raw, low, high);
        self.saturated = raw > high;
        // Anti-windup: the integral term stops where it would push further into the limit.
        if (raw <= high || error < 0.0) && (raw >= low || error > 0.0) {
            self.integral_term += integral * proportional_term;
        }
        let [newest, before, _] = self.output;
        self.output = [output, newest, before];
        output
    }

    /// Whether the last output stood at its upper limit.
    #[must_use]
    pub fn saturated(&self) -> bool {
        self.saturated
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The drive's envelope, exactly, with gain as a factor on the nominal one; mean of each cycle.
    struct SimulatedDrive {
        envelope: f32,
        latched: f32,
        gain: f32,
    }

    impl SimulatedDrive {
        fn cycle(&mut self, output: f32) -> f32 {
            let keep = libm::expf(-core::f32::consts::PI / 25.0);
            let before = self.envelope;
            self.envelope = keep * before + (1.0 - keep) * self.latched * self.gain * 1e-3;
            self.latched = output;
            0.5 * (before + self.envelope)
        }
    }

    fn settle(gain: f32) -> (f32, f32, usize) {
        let mut control = AmplitudeLoop::build(&Settings::default()).unwrap();
        let mut drive = SimulatedDrive {
            envelope: 0.0,
            latched: 0.0,
            gain,
        };
        let goal = 0.23e-3;
        let (mut output, mut peak, mut last_outside) = (0.0, 0.0_f32, 0);
        let mut b = 0.0;
        for n in 0..200 {
            let reference = goal * ((n + 2) as f32 / 20.0).min(1.0);
            b = drive.cycle(output);
            output = control.cycle(b, reference, 1.0);
            peak = peak.max(b);
            if (b / goal - 1.0).abs() > 0.01 {
                last_outside = n;
            }
        }
        (b / goal, peak / goal, last_outside)
    }

    #[test]
    fn settles_to_a_percent_within_a_second_whatever_the_gain() {
        for gain in [0.7, 1.0, 1.3] {
            let (end, peak, last_outside) = settle(gain);
            // 50 cycles are one second; 5 % in k is 5 % in b.
            assert!((end - 1.0).abs() < 1e-3, "gain {gain}: {end}");
            assert!(peak < 1.05, "gain {gain}: peak {peak}");
            assert!(last_outside < 50, "gain {gain}: {last_outside}");
        }
    }

    #[test]
    fn a_reference_out_of_reach_does_not_wind_up() {
        let mut control = AmplitudeLoop::build(&Settings::default()).unwrap();
        let mut drive = SimulatedDrive {
            envelope: 0.0,
            latched: 0.0,
            gain: 1.0,
        };
        let mut output = 0.0;
        for _ in 0..500 {
            let b = drive.cycle(output);
            output = control.cycle(b, 2e-3, 1.0);
        }
        assert!(control.saturated());
        let mut cycles = 0;
        loop {
            let b = drive.cycle(output);
            if b < 0.55e-3 || cycles > 100 {
                break;
            }
            output = control.cycle(b, 0.5e-3, 1.0);
            cycles += 1;
        }
        // From 0.95 mm the free decay alone takes 5 cycles to 0.55 mm.
        assert!(cycles < 20, "{cycles}");
    }
}
