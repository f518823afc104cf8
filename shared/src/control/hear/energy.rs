//! The residual's energy over the turn of the drive: what many parts strike with at once, whoever of them it was.

use crate::arithmetic::Phase;

/// Sectors of a turn: 0.2 rad each.
pub const SECTORS: usize = 32;
/// Sectors that a cycle hands over.
pub const SECTORS_HANDED: usize = 8;
/// Bits of a phase below its sector.
const BELOW: u32 = u32::BITS - SECTORS.trailing_zeros();

/// Some sectors of the residual's energy, summed since they were handed over before, [`SECTORS`]/[`SECTORS_HANDED`] cycles ago.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sectors {
    /// The first of them.
    pub first: u8,
    /// Sum of the squares of the samples of the residual in each, in (m/s^2)^2.
    pub energy: [f32; SECTORS_HANDED],
}

/// The energy of the residual by the phase of the output.
#[derive(Clone, Copy, Debug)]
pub struct Energy {
    /// Sector by sector, as they are handed over.
    sums: [[f32; SECTORS_HANDED]; SECTORS / SECTORS_HANDED],
    /// What is handed over next.
    next: u8,
}

impl Energy {
    /// Nothing summed.
    pub const EMPTY: Self = Self {
        sums: [[0.0; SECTORS_HANDED]; SECTORS / SECTORS_HANDED],
        next: 0,
    };

    /// The sector of a phase.
    #[inline(always)]
    pub fn sector(phase: Phase) -> usize {
        (phase.bits() >> BELOW) as usize
    }

    /// Adds a residual at a phase of the output.
    #[inline(always)]
    pub fn add(&mut self, phase: Phase, residual: f32) {
        self.sums.as_flattened_mut()[Self::sector(phase)] += residual * residual;
    }

    /// The end of a cycle: what is handed over goes into `handed`.
    #[inline]
    pub fn finish(&mut self, handed: &mut Sectors) {
        let next = usize::from(self.next) % self.sums.len();
        handed.first = (next * SECTORS_HANDED) as u8;
        handed.energy = self.sums[next];
        self.sums[next] = [0.0; SECTORS_HANDED];
        self.next = (next + 1) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sector_is_handed_over_once_in_four_cycles_and_emptied() {
        let mut energy = Energy::EMPTY;
        let (mut handed, mut phase) = ([0.0; SECTORS], Phase::ZERO);
        for _ in 0..40 {
            for _ in 0..400 {
                energy.add(phase, 2.0);
                phase += Phase::from_bits(u32::MAX / 400 + 1);
            }
            let mut sectors = Sectors::default();
            energy.finish(&mut sectors);
            let Sectors { first, energy } = sectors;
            for (n, energy) in energy.iter().enumerate() {
                handed[usize::from(first) + n] += energy;
            }
        }
        // 12 or 13 samples of 4 in each sector of the first 37 to 40 cycles.
        for sum in handed {
            assert!((37.0 * 48.0..=40.0 * 52.0).contains(&sum), "{sum}");
        }
    }
}
