//! Amplitude of a first-order drive through a kick.
//!
//! The model is the exact discretization of a first-order lag with zero-order hold (K. J. Åström
//! and B. Wittenmark, Computer-Controlled Systems, 1997), one sample a drive cycle, with linear
//! interpolation between samples.

use super::Kick;
use crate::feeder::{OutOfRange, accept_in};

/// Inputs of the drive model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveLagSettings {
    /// Time constant of the amplitude in drive cycles, 0..=1000; `Q / pi` for an uncontrolled
    /// resonance.
    pub time_constant: f64,
    /// Amplitude before the kick over the target amplitude, 0..=1. Below the target the part rests.
    pub start: f64,
    /// Highest commanded amplitude over the target amplitude, 1..=10.
    pub limit: f64,
}

impl DriveLagSettings {
    /// The reference drive: 5 cycles, from standstill, at most 2.5 times the target.
    pub const DEFAULT: Self = Self {
        time_constant: 5.0,
        start: 0.0,
        limit: 2.5,
    };
}

/// A first-order drive: after a step of the command the error falls as
/// `exp(-cycles / time constant)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveLag {
    decay: f32,
    start: f32,
    pub(super) limit: f32,
}

impl DriveLag {
    /// Builds the drive; an error names the parameter out of range.
    pub fn build(settings: DriveLagSettings) -> Result<Self, OutOfRange> {
        let cycles = settings.time_constant;
        let accepted = "0..1000 drive cycles";
        accept_in("time_constant", cycles, 0.0..=1000.0, accepted)?;
        accept_in("start", settings.start, 0.0..=1.0, "0..1")?;
        accept_in("limit", settings.limit, 1.0..=10.0, "1..10")?;
        Ok(Self {
            decay: match cycles {
                0.0 => 0.0,
                _ => libm::exp(-1.0 / cycles) as f32,
            },
            start: settings.start as f32,
            limit: settings.limit as f32,
        })
    }
}

/// Distance of amplitude over target from a constant command below which it is set to the command.
const SETTLED_TOLERANCE: f32 = 2e-3;

/// Amplitude of the track over the target amplitude through one kick.
///
/// The command changes once a cycle, at phase 0. Between cycle starts the amplitude is interpolated
/// linearly; the error is below `step / (8 tau^2)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KickEnvelope {
    drive: DriveLag,
    kick: Kick,
    cycle: u32,
    now: f32,
    next: f32,
}

impl KickEnvelope {
    /// Envelope of `kick` on `drive` at the start of cycle 0. The command is limited to the drive's
    /// limit.
    pub fn new(drive: DriveLag, kick: Kick) -> Self {
        let mut envelope = Self {
            drive,
            kick,
            cycle: 0,
            now: drive.start,
            next: drive.start,
        };
        envelope.next = envelope.next_amplitude(drive.start, 0);
        envelope
    }

    fn next_amplitude(&self, amplitude: f32, cycle: u32) -> f32 {
        let command = self.kick.command(cycle).min(self.drive.limit);
        let error = (amplitude - command) * self.drive.decay;
        if error > -SETTLED_TOLERANCE && error < SETTLED_TOLERANCE {
            command
        } else {
            command + error
        }
    }

    /// Amplitude over target at `time` in drive cycles since the start of the kick. Times must not
    /// fall below the current cycle.
    pub fn amplitude(&mut self, time: f32) -> f32 {
        let cycle = time as u32;
        while self.cycle < cycle && !self.is_settled() {
            self.cycle += 1;
            self.now = self.next;
            self.next = self.next_amplitude(self.now, self.cycle);
        }
        if self.is_settled() {
            return 1.0;
        }
        let part = (time - self.cycle as f32).clamp(0.0, 1.0);
        self.now + (self.next - self.now) * part
    }

    /// Whether the command remains at the target from now on.
    pub(crate) fn is_over(&self) -> bool {
        self.cycle >= self.kick.length()
    }

    /// Whether the kick is over and the amplitude has reached the target.
    pub(crate) fn is_settled(&self) -> bool {
        self.is_over() && self.now == 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drive([time_constant, start, limit]: [f64; 3]) -> Result<DriveLag, OutOfRange> {
        DriveLag::build(DriveLagSettings {
            time_constant,
            start,
            limit,
        })
    }

    /// Envelope of a rectangular kick of twice the target.
    fn envelope(hold: u16, settings: [f64; 3]) -> KickEnvelope {
        let mut kick = Kick::NONE.settings();
        (kick.factor, kick.hold) = (2.0, hold);
        KickEnvelope::new(drive(settings).unwrap(), Kick::build(kick).unwrap())
    }

    #[test]
    fn envelope_is_exponential() {
        let mut envelope = envelope(20, [5.0, 1.0, 3.0]);
        for step in 0..2000 {
            let time = step as f32 * 0.05;
            let rise = |time: f32| 2.0 - libm::exp(f64::from(-time) / 5.0);
            let exact = if time < 20.0 {
                rise(time)
            } else {
                1.0 + (rise(20.0) - 1.0) * libm::exp(-(f64::from(time) - 20.0) / 5.0)
            };
            let amplitude = f64::from(envelope.amplitude(time));
            // Error bound: the chord of the exponential over one cycle, step / (8 tau^2) = 1/200,
            // plus SETTLED_TOLERANCE.
            let error = amplitude - exact;
            assert!(error.abs() < 0.0051, "{time} {amplitude} {exact}");
        }
        assert!(envelope.is_settled() && envelope.amplitude(200.0) == 1.0);
    }

    #[test]
    fn drive_without_lag_follows_at_the_next_cycle() {
        let mut envelope = envelope(3, [0.0, 0.0, 1.5]);
        let amplitudes = [0.0, 1.0, 3.0, 4.0].map(|time| envelope.amplitude(time));
        assert_eq!(amplitudes, [0.0, 1.5, 1.5, 1.0]);
        assert!(envelope.is_settled());
    }

    #[test]
    fn refusals_name_the_parameter() {
        for (time_constant, start, limit, parameter) in [
            (-1.0, 0.0, 2.5, "time_constant"),
            (5.0, 1.1, 2.5, "start"),
            (5.0, 0.0, f64::NAN, "limit"),
            (5.0, 0.0, 10.1, "limit"),
        ] {
            let refused = drive([time_constant, start, limit]).unwrap_err();
            assert_eq!(refused.parameter, parameter);
        }
    }
}
