//! Detects impacts of parts in the track's acceleration.
//!
//! Two first-order high-pass filters suppress the drive. An adaptive threshold follows the running
//! median of the residual's magnitude (constant-gain stochastic approximation, after Robbins and
//! Monro 1951). A decaying envelope of the last impact prevents repeated detections.

use core::ops::{Add, Mul, Sub};
use kband::arithmetic::Phase;

/// Largest number of impacts with a phase per drive cycle; further impacts are dropped.
pub const MAX_IMPACTS_PER_CYCLE: usize = 8;

/// One detected impact.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DetectedImpact {
    /// Phase of the drive output at the onset.
    pub phase: Phase,
    /// Magnitude of the residual at the first sample above the threshold, in m/s^2.
    pub strength: f32,
}

/// First-order high-pass filter, for real or complex samples.
#[derive(Clone, Copy, Debug, Default)]
pub struct HighPass<T>(T);

impl<T> HighPass<T> {
    /// Filters one sample with this corner ([`OnsetDetector::CORNER`]).
    #[inline(always)]
    pub fn filter<F>(&mut self, corner: F, sample: T) -> T
    where
        T: Copy + Add<Output = T> + Sub<Output = T> + Mul<F, Output = T>,
    {
        self.0 = self.0 + (sample - self.0) * corner;
        sample - self.0
    }
}

/// Detects the onset of impacts, sample by sample; one ringing is one impact.
#[derive(Clone, Copy, Debug)]
pub struct OnsetDetector {
    passes: [HighPass<f32>; 2],
    /// Running median of the residual's magnitude, in m/s^2.
    median: f32,
    /// Decaying envelope of the last ringing, in m/s^2.
    ringing: f32,
    floor: f32,
    /// Samples during which a detected ringing may still rise.
    rising: u32,
    /// Samples until the filters have settled.
    settling: u32,
}

impl OnsetDetector {
    /// Median magnitude of Gaussian noise over its RMS: third quartile of the normal distribution.
    pub const QUARTILE: f64 = 0.6745;
    /// Corner of both high-passes times 2 pi over the sample rate: 1 kHz; gain of 1/400 at 50 Hz.
    pub const CORNER: f64 = 0.27;
    /// Decay factor of the envelope per sample: time constant of 1.4 ms at 20 kHz.
    pub const ENVELOPE_DECAY: f64 = 0.965;
    /// Rise time of a ringing, in samples: 0.6 ms at 20 kHz, a quarter period at 420 Hz.
    pub const RISE_SAMPLES: u32 = 12;
    /// Detection threshold over the RMS of the noise: one false alarm in 7 hours of Gaussian noise.
    pub const THRESHOLD: f64 = 6.0;
    /// Minimum height of a new impact over the envelope of the last one; less is its own ringing.
    pub const MIN_OVER_ENVELOPE: f64 = 1.5;
    /// Envelope over the threshold above which the demodulator blanks samples.
    pub const BLANKING_THRESHOLD: f64 = 2.0;
    /// Step of the running median per sample, relative to its value.
    pub const MEDIAN_STEP: f64 = 1.0 / 1024.0;
    /// Settling time before the first detection, in samples: some 60 time constants of the filters.
    pub const SETTLING_SAMPLES: u32 = 200;
    /// Detection threshold over the running median.
    const MEDIAN_THRESHOLD: f32 = Self::THRESHOLD as f32 / Self::QUARTILE as f32;

    /// Detector with a minimum noise of `floor`, in m/s^2 (the converter's resolution).
    pub fn new(floor: f32) -> Self {
        Self {
            passes: [HighPass::default(); 2],
            median: floor,
            ringing: 0.0,
            floor,
            rising: 0,
            settling: Self::SETTLING_SAMPLES,
        }
    }

    /// RMS of the residual's noise in m/s^2.
    pub fn noise(&self) -> f32 {
        self.median * (1.0 / Self::QUARTILE as f32)
    }

    /// Whether an impact was just detected, or still rings loudly.
    #[inline]
    pub fn is_ringing(&self) -> bool {
        self.rising > 0
            || self.ringing > Self::BLANKING_THRESHOLD as f32 * Self::MEDIAN_THRESHOLD * self.median
    }

    /// Filters the acceleration of one sample; returns the residual in m/s^2.
    #[inline]
    pub fn residual(&mut self, acceleration: f32) -> f32 {
        let [first, second] = &mut self.passes;
        let once = first.filter(Self::CORNER as f32, acceleration);
        second.filter(Self::CORNER as f32, once)
    }

    /// Updates the threshold with one residual (m/s^2); returns its magnitude at an onset.
    #[inline]
    pub fn detect(&mut self, residual: f32) -> Option<f32> {
        let height = residual.abs();
        let step = self.median * Self::MEDIAN_STEP as f32;
        // Half of the samples are above the median: a branch would be mispredicted.
        let fall = if self.median > self.floor { step } else { 0.0 };
        self.median += if height > self.median { step } else { -fall };
        let above = height > Self::MEDIAN_THRESHOLD * self.median;
        let is_onset =
            above && height > Self::MIN_OVER_ENVELOPE as f32 * self.ringing && self.rising == 0;
        self.rising = if is_onset {
            Self::RISE_SAMPLES
        } else {
            self.rising.saturating_sub(1)
        };
        self.ringing *= Self::ENVELOPE_DECAY as f32;
        if above && height > self.ringing {
            self.ringing = height;
        }
        if self.settling > 0 {
            self.settling -= 1;
            return None;
        }
        is_onset.then_some(height)
    }
}
