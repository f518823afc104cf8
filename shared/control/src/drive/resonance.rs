//! The drive's resonance: a stepped-sine sweep that finds it, and a phase loop that tracks it.
//!
//! At the peak a resonance lags its force by a quarter turn: an integral controller moves the
//! frequency until that phase is measured (phase-locked loop).

use super::DEAD_TIME_CYCLES;
use crate::saturate::saturate;
use crate::{SAMPLE_RATE, Settings};
use core::f32::consts::{FRAC_PI_2, PI};

/// Largest number of points of a sweep; the settings refuse a band that needs more.
const MAX_SWEEP_POINTS: u16 = 400;
/// Settling time at each point in time constants of the envelope: 2 % of the last one remains.
const SETTLING_TIME_CONSTANTS: f32 = 4.0;
/// Additional settling cycles, for the dead time from a command to its measured amplitude.
const SETTLING_CYCLES: f32 = 4.0;
/// Share of the requested output below which a sweep is not reduced any more, so that it ends.
const MIN_SWEEP_SHARE: f32 = 0.02;
/// Time constant of the phase loop over that of the envelope, which has settled then.
const PHASE_LOOP_RATIO: f32 = 4.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resonance {
    low: f32,
    high: f32,
    quality: f32,
    pub frequency: f32,
    pub sweep: Option<Sweep>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sweep {
    /// Points after the first.
    intervals: u16,
    point: u16,
    cycles: u16,
    /// Share of the requested output.
    share: f32,
    /// Largest amplitude so far in m, over the share, and its frequency in Hz.
    best: (f32, f32),
    /// Whether the drive is back at the peak and settles there.
    returning: bool,
}

impl Resonance {
    /// The drive at its configured frequency; it stays there if `tracking` is 0.
    pub fn new(settings: &Settings) -> Self {
        Self {
            low: (settings.frequency - settings.tracking).max(5.0),
            high: settings.frequency + settings.tracking,
            quality: settings.quality,
            frequency: settings.frequency,
            sweep: None,
        }
    }

    pub fn is_tracking(&self) -> bool {
        self.high > self.low
    }

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
            share: 1.0,
            best: (0.0, self.low),
            returning: false,
        });
    }

    /// Share of the requested output during a sweep.
    pub fn sweep_share(&self) -> f32 {
        self.sweep.map_or(1.0, |sweep| sweep.share)
    }

    /// Halves the output for the rest of the sweep, at most once per dead time, as with a gain
    /// configured too low. The point settles again.
    pub fn halve_sweep(&mut self) {
        if let Some(sweep) = &mut self.sweep
            && f32::from(sweep.cycles) > DEAD_TIME_CYCLES
            && sweep.share > MIN_SWEEP_SHARE
        {
            sweep.share *= 0.5;
            sweep.cycles = 0;
        }
    }

    /// Processes the amplitude (m) of a sweep's cycle. Whether it ended, settled at its peak.
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
        if sweep.returning {
            self.sweep = None;
            return true;
        }
        let response = amplitude / sweep.share;
        if response > sweep.best.0 {
            sweep.best = (response, self.frequency);
        }
        sweep.cycles = 0;
        sweep.point += 1;
        if sweep.point > sweep.intervals {
            self.frequency = sweep.best.1;
            sweep.returning = true;
            return false;
        }
        let part = f32::from(sweep.point) / f32::from(sweep.intervals);
        self.frequency = self.low + (self.high - self.low) * part;
        false
    }

    /// Moves the frequency towards the resonance by the phase lead of the track (rad).
    pub fn track(&mut self, lead: f32) {
        let hold = PI * self.frequency / SAMPLE_RATE as f32;
        let error = lead + FRAC_PI_2 + hold;
        // Near the peak the lead falls by 2 Q per relative change of frequency.
        let correction = self.frequency * error / (2.0 * self.quality);
        let share = PI / (PHASE_LOOP_RATIO * self.quality);
        self.frequency = saturate(self.frequency + share * correction, self.low, self.high);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::seeded;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(seeded())]
        /// Each point settles for four time constants and four cycles; the peak does so once more.
        #[test]
        fn sweep_ends_in_time_within_half_a_step_of_the_peak(
            frequency in 40.0..200.0_f32,
            quality in 5.0..60.0_f32,
            widths in 0.5..3.0_f32,
            peak in -0.9..0.9_f32,
        ) {
            let tracking = widths * frequency / quality;
            let settings = Settings { frequency, quality, tracking, ..Settings::default() };
            let mut resonance = Resonance::new(&settings);
            let (low, high) = (frequency - tracking, frequency + tracking);
            let (peak, step) = (frequency + peak * tracking, 0.5 * low / quality);
            let (points, settled) = ((high - low) / step + 2.0, 4.0 * quality / PI + 4.0);
            resonance.begin();
            let (mut cycles, mut ended) = (0.0, false);
            while !ended {
                let f = resonance.frequency;
                prop_assert!((low..=high).contains(&f));
                ended = resonance.advance_sweep(1.0 / (1.0 + (f - peak) * (f - peak)));
                cycles += 1.0;
                prop_assert!(cycles < 1.01 * (points + 1.0) * (settled + 1.0));
            }
            prop_assert!(cycles > 0.99 * points * settled);
            prop_assert!((resonance.frequency - peak).abs() <= 0.51 * step);
            (0..2000).for_each(|_| resonance.track(3.0));
            prop_assert_eq!(resonance.frequency, high);
        }
    }
}
