//! Sums the residual's energy by sector of the drive's turn (a histogram with energy as weight).

use kband::arithmetic::Phase;

/// Number of sectors of a turn: 0.2 rad each.
pub const SECTORS: usize = 32;
/// Number of sectors that each drive cycle outputs.
pub const SECTORS_PER_CYCLE: usize = 8;
/// Number of low bits of a phase within its sector.
const SECTOR_SHIFT: u32 = u32::BITS - SECTORS.trailing_zeros();

/// Energy of successive sectors, summed over the last [`SECTORS`]/[`SECTORS_PER_CYCLE`] cycles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sectors {
    /// Index of the first sector, 0..32.
    pub first: u8,
    /// Sum of the squared residual in each sector, in (m/s^2)^2.
    pub energy: [f32; SECTORS_PER_CYCLE],
}

/// Running sums of the residual's energy by phase of the output.
#[derive(Clone, Copy, Debug, Default)]
pub struct EnergyHistogram {
    /// Sums by sector, in groups as they are output.
    sums: [[f32; SECTORS_PER_CYCLE]; SECTORS / SECTORS_PER_CYCLE],
    next: u8,
}

impl EnergyHistogram {
    /// Sector of a phase, 0..32.
    #[inline(always)]
    pub fn sector(phase: Phase) -> usize {
        (phase.bits() >> SECTOR_SHIFT) as usize
    }

    /// Adds the square of a residual (m/s^2) at a phase of the output.
    #[inline(always)]
    pub fn add(&mut self, phase: Phase, residual: f32) {
        self.sums.as_flattened_mut()[Self::sector(phase)] += residual * residual;
    }

    /// Ends a cycle: moves the next group of sectors into `output`.
    #[inline]
    pub fn end_cycle(&mut self, output: &mut Sectors) {
        let next = usize::from(self.next) % self.sums.len();
        output.first = (next * SECTORS_PER_CYCLE) as u8;
        output.energy = self.sums[next];
        self.sums[next] = [0.0; SECTORS_PER_CYCLE];
        self.next = (next + 1) as u8;
    }
}
