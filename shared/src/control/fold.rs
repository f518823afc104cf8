//! Folding: the height of the residual against the phase, summed over many cycles, so that what
//! repeats every cycle stands out of the noise.

use crate::arithmetic::Phase;

/// Bins of a fold: half a turn, in steps of 1/256 turn.
pub const BINS: usize = 128;
/// Bins that a cycle hands over once a fold has ended.
pub const HANDED: usize = 2;
/// Bits of a phase within a bin.
const WITHIN: u32 = 24;

/// Some bins of a fold that has ended.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Folded {
    /// Number of the first of them, from 1; 0 where there are none.
    pub bin: u8,
    /// Mean height of the residual in each, in m/s^2; 0 where no sample fell into it.
    pub heights: [f32; HANDED],
}

/// Sums of the residual's height over half a turn from a phase on.
///
/// Begun and ended at the end of a cycle; when it has ended, its bins are handed over two a cycle and
/// emptied, and only then another one begins.
#[derive(Clone, Copy, Debug)]
pub struct Fold {
    from: Option<Phase>,
    sums: [f32; BINS],
    counts: [u16; BINS],
    /// The next bin to hand over; [`BINS`] where there is none.
    next: u8,
}

impl Fold {
    /// An empty fold.
    pub const EMPTY: Self = Self {
        from: None,
        sums: [0.0; BINS],
        counts: [0; BINS],
        next: BINS as u8,
    };

    /// Adds the residual's height at a phase of the output.
    #[inline]
    pub fn add(&mut self, phase: Phase, height: f32) {
        let Some(from) = self.from else {
            return;
        };
        let bin = ((phase - from).bits() >> WITHIN) as usize;
        if let (Some(sum), Some(count)) = (self.sums.get_mut(bin), self.counts.get_mut(bin)) {
            *sum += height;
            *count = count.wrapping_add(1);
        }
    }

    /// The end of a cycle: `from` is what is wanted of the next one; what is handed over now.
    #[inline]
    pub fn finish(&mut self, from: Option<Phase>) -> Folded {
        if from.is_none() && self.from.is_some() {
            self.next = 0;
            self.from = None;
        }
        let bin = self.next;
        if usize::from(bin) >= BINS {
            self.from = from;
            return Folded::default();
        }
        let mut folded = Folded {
            bin: bin + 1,
            ..Folded::default()
        };
        for (n, height) in folded.heights.iter_mut().enumerate() {
            let at = usize::from(bin) + n;
            if let (Some(sum), Some(count)) = (self.sums.get_mut(at), self.counts.get_mut(at)) {
                if *count > 0 {
                    *height = *sum / f32::from(*count);
                }
                *sum = 0.0;
                *count = 0;
            }
        }
        self.next = bin + HANDED as u8;
        folded
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_by_phase_are_handed_over_once_and_emptied() {
        let mut fold = Fold::EMPTY;
        let from = Phase::from_bits(0xf000_0000);
        for round in 0..2 {
            assert_eq!(fold.finish(Some(from)), Folded::default());
            // A ramp over the turn, 1000 samples a cycle, three cycles.
            for n in 0..3000_u32 {
                let phase = n.wrapping_mul(u32::MAX / 1000);
                let height = (phase.wrapping_sub(from.bits()) >> 8) as f32;
                fold.add(Phase::from_bits(phase), height + round as f32);
            }
            let mut heard = 0;
            let mut folded = fold.finish(None);
            while folded.bin > 0 {
                for (n, height) in folded.heights.iter().enumerate() {
                    // The middle of a bin of 2^16 in these units, give or take its samples.
                    let middle = (f32::from(folded.bin - 1) + n as f32 + 0.5) * 65_536.0;
                    assert!((height - middle).abs() < 33_000.0, "{folded:?}");
                    heard += 1;
                }
                // What is wanted anew waits until all is handed over.
                folded = fold.finish(Some(from));
            }
            assert_eq!(heard, BINS);
            fold.finish(None);
            for _ in 0..BINS / HANDED {
                assert_eq!(fold.finish(None).heights, [0.0; HANDED]);
            }
        }
    }
}
