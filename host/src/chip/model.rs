//! The chip of the board: where its memories lie and how its flash is erased.

use std::ops::Range;

/// A chip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chip {
    /// Its name.
    pub name: &'static str,
    /// Flash.
    pub flash: Range<u32>,
    /// Sizes of the sectors of the flash in KiB, in order.
    pub sectors: &'static [u32],
    /// Sectors of settings and faults: an image must not touch them.
    pub settings: Range<u32>,
    /// RAM.
    pub memory: Range<u32>,
    /// Entries of its vector table.
    pub vectors: usize,
    /// Its family in the register that identifies the chip.
    pub family: u32,
    /// Address and bit that stop the bridge's timer with the core, its outputs switched off.
    pub stops: (u32, u32),
    /// Address and bits that stop both watchdogs with the core: none must bite while the flash is written.
    pub rests: (u32, u32),
    /// Address and bit that let the bridge's timer drive its outputs.
    pub drives: (u32, u32),
}

/// The board's chip (RM0090, sections 2.3, 3.4 and 12.2; DBGMCU_IDCODE in 38.6.1, DBGMCU_APB1_FZ and
/// APB2_FZ in 38.16.4 and 38.16.5,
/// TIM1_BDTR in 17.4.18).
pub const STM32F405RG: Chip = Chip {
    name: "STM32F405RG",
    flash: 0x0800_0000..0x0810_0000,
    sectors: &[16, 16, 16, 16, 64, 128, 128, 128, 128, 128, 128, 128],
    settings: 0x0808_0000..0x0810_0000,
    memory: 0x2000_0000..0x2002_0000,
    vectors: 98,
    family: 0x413,
    stops: (0xe004_200c, 1),
    rests: (0xe004_2008, 3 << 11),
    drives: (0x4001_0044, 1 << 15),
};

/// One sector of a flash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sector {
    /// Its number.
    pub number: usize,
    /// Where it lies.
    pub range: Range<u32>,
}

impl Chip {
    /// Its sectors.
    pub fn sectors(&self) -> impl Iterator<Item = Sector> + '_ {
        let mut end = self.flash.start;
        self.sectors.iter().enumerate().map(move |(number, size)| {
            let start = end;
            end += size * 1024;
            Sector {
                number,
                range: start..end,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sectors_fill_the_flash_and_the_settings_are_whole_ones() {
        let sectors: Vec<Sector> = STM32F405RG.sectors().collect();
        assert_eq!(sectors[11].range.end, STM32F405RG.flash.end);
        assert_eq!(
            STM32F405RG.settings,
            sectors[8].range.start..sectors[11].range.end
        );
    }
}
