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
    limit: f32,
}

impl DriveLag {
    /// Builds the drive; an error names the parameter out of range.
    pub fn build(settings: DriveLagSettings) -> Result<Self, OutOfRange> {
        let DriveLagSettings {
            time_constant,
            start,
            limit,
        } = settings;
        accept_in(
            "time_constant",
            time_constant,
            0.0..=1000.0,
            "0..1000 drive cycles",
        )?;
        accept_in("start", start, 0.0..=1.0, "0..1")?;
        accept_in("limit", limit, 1.0..=10.0, "1..10")?;
        Ok(Self {
            decay: if time_constant > 0.0 {
                libm::exp(-1.0 / time_constant) as f32
            } else {
                0.0
            },
            start: start as f32,
            limit: limit as f32,
        })
    }

    /// Highest amplitude over the target amplitude.
    pub(crate) fn limit(&self) -> f32 {
        self.limit
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
    use super::super::KickSettings;
    use super::*;

    fn rectangle(factor: f32, hold: u16) -> Kick {
        let settings = KickSettings {
            factor,
            hold,
            descent: 0,
            release: 1.0,
        };
        Kick::build(settings).unwrap()
    }

    #[test]
    fn envelope_is_exponential() {
        let drive = DriveLag::build(DriveLagSettings {
            time_constant: 5.0,
            start: 1.0,
            limit: 3.0,
        })
        .unwrap();
        let kick = rectangle(2.0, 20);
        let mut envelope = KickEnvelope::new(drive, kick);
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
            assert!(
                (amplitude - exact).abs() < 0.0051,
                "{time} {amplitude} {exact}"
            );
        }
        assert!(envelope.is_settled() && envelope.amplitude(200.0) == 1.0);
    }

    #[test]
    fn drive_without_lag_follows_at_the_next_cycle() {
        let drive = DriveLag::build(DriveLagSettings {
            time_constant: 0.0,
            start: 0.0,
            limit: 1.5,
        })
        .unwrap();
        let mut envelope = KickEnvelope::new(drive, rectangle(2.0, 3));
        assert_eq!(envelope.amplitude(0.0), 0.0);
        assert_eq!(envelope.amplitude(1.0), 1.5);
        assert_eq!(envelope.amplitude(3.0), 1.5);
        assert_eq!(envelope.amplitude(4.0), 1.0);
        assert!(envelope.is_settled());
    }

    #[test]
    fn refusals_name_the_parameter() {
        let refused = |change: fn(&mut DriveLagSettings)| {
            let mut settings = DriveLagSettings::DEFAULT;
            change(&mut settings);
            DriveLag::build(settings).unwrap_err().parameter
        };
        assert_eq!(refused(|s| s.time_constant = -1.0), "time_constant");
        assert_eq!(refused(|s| s.start = 1.1), "start");
        assert_eq!(refused(|s| s.limit = f64::NAN), "limit");
        assert_eq!(refused(|s| s.limit = 10.1), "limit");
    }
}
