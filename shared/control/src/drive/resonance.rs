//! The drive's resonance: a stepped-sine sweep that finds it, and a phase loop that tracks it.
//!
//! At the peak a resonance lags its force by a quarter turn. An integral controller moves the
//! frequency until that phase is measured (phase-locked loop).

use core::f32::consts::{FRAC_PI_2, PI};

use crate::angle::SAMPLE_RATE;
use crate::saturate::saturate;
use crate::settings::Settings;

/// Largest number of points of a sweep; the settings refuse a band that needs more.
const MAX_SWEEP_POINTS: u16 = 400;
/// Settling time at each point in time constants of the envelope: 2 % of the last point's amplitude
/// remains.
const SETTLING_TIME_CONSTANTS: f32 = 4.0;
/// Additional settling cycles, for the dead time from a command to its measured amplitude.
const SETTLING_CYCLES: f32 = 4.0;
/// Time constant of the phase loop over that of the envelope, so that each phase is measured on a
/// settled envelope.
const PHASE_LOOP_RATIO: f32 = 4.0;

/// The drive's frequency, and its tracking of the resonance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resonance {
    low: f32,
    high: f32,
    quality: f32,
    frequency: f32,
    sweep: Option<Sweep>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Sweep {
    /// Points after the first.
    intervals: u16,
    point: u16,
    cycles: u16,
    /// Largest amplitude so far in m, and its frequency in Hz.
    best: (f32, f32),
    /// Whether the drive is back at the peak and settles there.
    back: bool,
}

impl Resonance {
    /// The drive at its configured frequency; it stays there where `tracking` is 0.
    pub fn new(settings: &Settings) -> Self {
        Self {
            low: (settings.frequency - settings.tracking).max(5.0),
            high: settings.frequency + settings.tracking,
            quality: settings.quality,
            frequency: settings.frequency,
            sweep: None,
        }
    }

    /// Drive frequency in Hz.
    pub fn frequency(&self) -> f32 {
        self.frequency
    }

    /// Whether the frequency may track the resonance.
    pub fn is_tracking(&self) -> bool {
        self.high > self.low
    }

    /// Whether a sweep runs.
    pub fn is_sweeping(&self) -> bool {
        self.sweep.is_some()
    }

    /// Begins a sweep from the low end, in steps of half a resonance's width there.
    pub fn begin(&mut self) {
        let step = 0.5 * self.low / self.quality;
        let intervals = libm::ceilf((self.high - self.low) / step) as u16;
        self.frequency = self.low;
        self.sweep = Some(Sweep {
            intervals: intervals.clamp(2, MAX_SWEEP_POINTS),
            point: 0,
            cycles: 0,
            best: (0.0, self.low),
            back: false,
        });
    }

    /// Stops the sweep at its present frequency.
    pub fn stop(&mut self) {
        self.sweep = None;
    }

    /// Processes the amplitude of a sweep's cycle, in m. Whether the sweep ended, with the track
    /// settled at its peak.
    pub fn advance_sweep(&mut self, amplitude: f32) -> bool {
        let Some(sweep) = &mut self.sweep else {
            return false;
        };
        sweep.cycles += 1;
        if f32::from(sweep.cycles)
            < SETTLING_TIME_CONSTANTS * self.quality * (1.0 / PI) + SETTLING_CYCLES
        {
            return false;
        }
        if sweep.back {
            self.sweep = None;
            return true;
        }
        if amplitude > sweep.best.0 {
            sweep.best = (amplitude, self.frequency);
        }
        sweep.cycles = 0;
        sweep.point += 1;
        if sweep.point > sweep.intervals {
            self.frequency = sweep.best.1;
            sweep.back = true;
            return false;
        }
        let part = f32::from(sweep.point) / f32::from(sweep.intervals);
        self.frequency = self.low + (self.high - self.low) * part;
        false
    }

    /// Moves the frequency towards the resonance by the phase lead of the track (rad). At the peak
    /// it lags a quarter turn, and half a sample more for the held output.
    pub fn track(&mut self, lead: f32) {
        let hold = PI * self.frequency / SAMPLE_RATE as f32;
        let error = lead + FRAC_PI_2 + hold;
        // Near the peak the lead falls by 2 Q per relative change of frequency.
        let towards = self.frequency * error / (2.0 * self.quality);
        let share = PI / (PHASE_LOOP_RATIO * self.quality);
        self.frequency = saturate(self.frequency + share * towards, self.low, self.high);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sweep_ends_within_half_a_step_of_the_peak() {
        let mut resonance = Resonance::new(&Settings {
            tracking: 3.0,
            ..Settings::default()
        });
        resonance.begin();
        let mut cycles = 0;
        loop {
            let f = resonance.frequency();
            assert!((47.0..=53.0).contains(&f));
            let x = f / 51.2;
            let response = 1.0 / ((1.0 - x * x) * (1.0 - x * x) + x * x / 625.0);
            cycles += 1;
            if resonance.advance_sweep(response) {
                break;
            }
            assert!(cycles < 5000);
        }
        // Half the width of the resonance is one hertz; steps are no longer than that.
        assert!((resonance.frequency() - 51.2).abs() <= 0.5);
        for _ in 0..10_000 {
            resonance.track(3.0);
        }
        assert_eq!(resonance.frequency(), 53.0);
    }

    #[test]
    fn without_tracking_nothing_moves() {
        let mut resonance = Resonance::new(&Settings::default());
        assert!(!resonance.is_tracking());
        resonance.track(0.0);
        assert_eq!(resonance.frequency(), 50.0);
    }
}
