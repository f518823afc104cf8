//! Folds the residual: coherent (synchronous) average over many cycles, sample by sample.
//!
//! It starts at a given phase of the drive. Repeating signals remain, and the noise averages out.

use kband::arithmetic::Phase;

/// Largest number of places of a fold.
pub const PLACES: usize = 256;
/// Number of places that each cycle hands over after the end of a fold.
pub const HANDED: usize = 8;
/// Length of a fold, in 2^-32 turns: half a turn.
const FOLD_LENGTH: u32 = 1 << 31;

/// Assignment of the samples of half a turn to places.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Number of samples from one place to the next.
    pub stride: u32,
    /// Number of places in half a turn.
    pub places: usize,
}

impl Layout {
    /// No places.
    pub const NONE: Self = Self {
        stride: 1,
        places: 0,
    };

    /// Layout at an advance of the phase per sample: every sample has its place, or every second or
    /// third where half a turn has more than [`PLACES`] samples.
    pub fn of(step: u32) -> Self {
        let step = step.max(1);
        let samples = FOLD_LENGTH / step;
        let stride = samples / PLACES as u32 + 1;
        Self {
            stride,
            places: (samples / stride) as usize,
        }
    }
}

/// Successive places of a finished fold.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Folded {
    /// Number of the first place, from 1; 0 without any.
    pub first: u16,
    /// Mean residual in each place, in m/s^2.
    pub residual: [f32; HANDED],
}

/// Sums of the residual over half a turn from a phase on. A fold begins and ends at the end of a
/// cycle, after its half turn. Its places are then handed over, some each cycle.
#[derive(Clone, Copy, Debug)]
pub struct Fold {
    from: Phase,
    step: u32,
    layout: Layout,
    open: bool,
    under_way: bool,
    place: u32,
    /// Number of samples until that place.
    wait: u32,
    sums: [f32; PLACES],
    /// Number of half turns summed.
    count: u16,
    /// Index of the next place to hand over; the end of the layout when all are handed over.
    next: u16,
}

impl Fold {
    /// An empty fold.
    pub const EMPTY: Self = Self {
        from: Phase::ZERO,
        step: 0,
        layout: Layout::NONE,
        open: false,
        under_way: false,
        place: 0,
        wait: 0,
        sums: [0.0; PLACES],
        count: 0,
        next: 0,
    };

    /// Whether no fold runs, waits for its transfer, or is requested.
    pub fn is_idle(&self) -> bool {
        !self.open && !self.under_way && self.count == 0
    }

    /// Adds a residual (m/s^2) at a phase of the output.
    #[inline]
    pub fn add(&mut self, phase: Phase, residual: f32) {
        if !self.open && !self.under_way {
            return;
        }
        let since = (phase - self.from).bits();
        if self.open && since < self.step {
            self.under_way = true;
            self.place = 0;
            self.wait = 0;
            self.count = self.count.wrapping_add(1);
        }
        if since >= FOLD_LENGTH {
            self.under_way = false;
        } else if self.under_way {
            if self.wait > 0 {
                self.wait -= 1;
            } else if let Some(sum) = self.sums.get_mut(self.place as usize) {
                *sum += residual;
                self.place += 1;
                self.wait = self.layout.stride - 1;
            }
        }
    }

    /// Ends a cycle: starts (`from` a phase, with the phase's advance `step`), ends or hands over a
    /// fold. `handed` keeps its residual without a transfer.
    #[inline(always)]
    pub fn finish(&mut self, from: Option<Phase>, step: u32, handed: &mut Folded) {
        handed.first = 0;
        // Most cycles need no fold at all.
        if from.is_some() || self.open || self.count != 0 {
            self.continue_fold(from, step, handed);
        }
    }

    #[inline(never)]
    fn continue_fold(&mut self, from: Option<Phase>, step: u32, handed: &mut Folded) {
        if self.open || self.under_way {
            self.open = self.open && from.is_some();
            return;
        }
        let (first, places) = (usize::from(self.next), self.layout.places);
        if self.count == 0 || first >= places {
            self.count = 0;
            if let Some(from) = from {
                self.from = from;
                self.step = step;
                self.layout = Layout::of(step);
                self.open = true;
                self.next = 0;
            }
            return;
        }
        handed.first = self.next + 1;
        let share = 1.0 / f32::from(self.count);
        for (n, residual) in handed.residual.iter_mut().enumerate() {
            *residual = match self.sums.get_mut(first + n) {
                Some(sum) => core::mem::take(sum) * share,
                None => 0.0,
            };
        }
        self.next += HANDED as u16;
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    /// Runs drive cycles, folds `count` of them, and returns the transferred places.
    fn handed(fold: &mut Fold, step: u32, from: Phase, count: u32, round: f32) -> Vec<f32> {
        let (mut phase, mut cycles, mut handed) = (Phase::ZERO, 0, Vec::new());
        let mut folded = Folded::default();
        fold.finish(Some(from), step, &mut folded);
        assert_eq!(folded.first, 0);
        while cycles < count + 40 {
            let before = phase;
            phase += Phase::from_bits(step);
            // A ramp over the turn, with an offset by round.
            fold.add(phase, (phase - from).bits() as f32 + round);
            if phase.bits() < before.bits() {
                cycles += 1;
                let wanted = Some(from).filter(|_| cycles < count);
                fold.finish(wanted, step, &mut folded);
                if folded.first > 0 {
                    assert_eq!(usize::from(folded.first), handed.len() + 1);
                    handed.extend(folded.residual);
                }
            }
        }
        handed
    }

    #[test]
    fn means_by_sample_are_handed_over_once_and_emptied() {
        // 400 and 50 samples a cycle, and 1400 with every third used; also a start just before the
        // wrap.
        for (step, stride) in [
            (u32::MAX / 400, 1),
            (u32::MAX / 50, 1),
            (u32::MAX / 1400, 3),
        ] {
            for from in [0x2000_0000, 0xf000_0000] {
                let mut fold = Fold::EMPTY;
                let layout = Layout::of(step);
                assert_eq!(layout.stride, stride);
                for round in [0.0, 1e6] {
                    let handed = handed(&mut fold, step, Phase::from_bits(from), 5, round);
                    assert!((layout.places..layout.places + HANDED).contains(&handed.len()));
                    for (place, mean) in handed[..layout.places].iter().enumerate() {
                        // The first sample of a half turn lies within a step of its start; rounding
                        // of f32.
                        let late = mean - round - (place as u32 * stride * step) as f32;
                        assert!((-1e4..step as f32 + 1e4).contains(&late), "{place}: {late}");
                    }
                }
            }
        }
    }
}
