//! Synchronous average of the residual over many cycles, sample by sample.
//!
//! It starts at a given phase of the drive. Repeating signals remain, and the noise averages out.

use kband::arithmetic::Phase;

/// Largest number of bins of an average.
pub const MAX_BINS: usize = 256;
/// Number of bins that each cycle outputs after the end of an average.
pub const BINS_PER_CYCLE: usize = 8;
/// Length of an average, in 2^-32 turns: half a turn.
const AVERAGED_LENGTH: u32 = 1 << 31;

/// Assignment of the samples of half a turn to bins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BinLayout {
    /// Number of samples from one bin to the next.
    pub stride: u32,
    pub bins: usize,
}

impl BinLayout {
    /// No bins.
    pub const NONE: Self = Self { stride: 1, bins: 0 };

    /// Layout at an advance of the phase per sample. Above [`MAX_BINS`] samples, bins skip some.
    pub fn from_step(step: u32) -> Self {
        let step = step.max(1);
        let samples = AVERAGED_LENGTH / step;
        let stride = samples / MAX_BINS as u32 + 1;
        Self {
            stride,
            bins: (samples / stride) as usize,
        }
    }
}

/// Successive bins of a finished average.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AverageBins {
    /// Number of the first bin, from 1; 0 without any.
    pub first: u16,
    /// Mean residual in each bin, in m/s^2.
    pub residual: [f32; BINS_PER_CYCLE],
}

/// Sums of the residual over half a turn from a phase on. Its bins are output, some each cycle.
#[derive(Clone, Copy, Debug)]
pub struct SynchronousAverage {
    from: Phase,
    step: u32,
    layout: BinLayout,
    open: bool,
    summing: bool,
    bin: u32,
    /// Number of samples until that bin.
    wait: u32,
    sums: [f32; MAX_BINS],
    /// Number of half turns summed.
    count: u16,
    /// Index of the next bin to output; the end of the layout after the last.
    next: u16,
}

impl SynchronousAverage {
    /// An empty average. As a constant it would take 1 KiB of flash.
    pub fn empty() -> Self {
        Self {
            from: Phase::ZERO,
            step: 0,
            layout: BinLayout::NONE,
            open: false,
            summing: false,
            bin: 0,
            wait: 0,
            sums: [0.0; MAX_BINS],
            count: 0,
            next: 0,
        }
    }

    /// Whether no average runs, waits for its transfer, or is requested.
    pub fn is_idle(&self) -> bool {
        !self.open && !self.summing && self.count == 0
    }

    /// Adds a residual (m/s^2) at a phase of the output.
    #[inline]
    pub fn add(&mut self, phase: Phase, residual: f32) {
        if !self.open && !self.summing {
            return;
        }
        let offset = (phase - self.from).bits();
        if self.open && offset < self.step {
            self.summing = true;
            self.bin = 0;
            self.wait = 0;
            self.count = self.count.wrapping_add(1);
        }
        if offset >= AVERAGED_LENGTH {
            self.summing = false;
        } else if self.summing {
            if self.wait > 0 {
                self.wait -= 1;
            } else if let Some(sum) = self.sums.get_mut(self.bin as usize) {
                *sum += residual;
                self.bin += 1;
                self.wait = self.layout.stride - 1;
            }
        }
    }

    /// Ends a cycle: starts (`from` a phase, of advance `step`), ends or outputs an average.
    #[inline(always)]
    pub fn finish(&mut self, from: Option<Phase>, step: u32, output: &mut AverageBins) {
        output.first = 0;
        // Most cycles need no average at all.
        if from.is_some() || self.open || self.count != 0 {
            self.continue_average(from, step, output);
        }
    }

    #[inline(never)]
    fn continue_average(&mut self, from: Option<Phase>, step: u32, output: &mut AverageBins) {
        if self.open || self.summing {
            self.open = self.open && from.is_some();
            return;
        }
        let (first, bins) = (usize::from(self.next), self.layout.bins);
        if self.count == 0 || first >= bins {
            self.count = 0;
            if let Some(from) = from {
                self.from = from;
                self.step = step;
                self.layout = BinLayout::from_step(step);
                self.open = true;
                self.next = 0;
            }
            return;
        }
        output.first = self.next + 1;
        let share = 1.0 / f32::from(self.count);
        for (n, residual) in output.residual.iter_mut().enumerate() {
            let sum = self.sums.get_mut(first + n);
            *residual = sum.map_or(0.0, |sum| core::mem::take(sum) * share);
        }
        self.next += BINS_PER_CYCLE as u16;
    }
}
