//! Chips of the boards: memory ranges, and registers for erasing and writing the flash.

use std::ops::Range;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chip {
    /// Name; in lower case that of the board's cargo feature, by which an image names its chip.
    pub name: &'static str,
    /// Command that builds its image.
    pub build: &'static str,
    pub flash: Range<u32>,
    /// Sectors of the flash in order, as (number of sectors, size in KiB).
    pub sectors: &'static [(usize, u32)],
    /// Sectors of settings and faults; an image must not contain them.
    pub settings: Range<u32>,
    /// Slot of the program, after the loader.
    pub slot: Range<u32>,
    pub memory: Range<u32>,
    pub vectors: usize,
    /// Family of the chip in its identity register.
    pub family: u32,
    /// Address of the half word with the size of the flash in KiB.
    pub flash_size: u32,
    /// Address and bit that must be set for the division into `sectors`, if there is an option.
    pub divided: Option<(u32, u32)>,
    /// Address and bit that stop the bridge's timer with the core and switch its outputs off.
    pub stops: (u32, u32),
    /// Address and bits that stop both watchdogs with the core, so that none resets it.
    pub rests: (u32, u32),
    /// Address and bit that enable the outputs of the bridge's timer.
    pub drives: (u32, u32),
    pub controller: Controller,
    pub options: Option<OptionBytes>,
}

/// Option bytes for a feeder: highest level of the brown-out reset, watchdog from reset on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OptionBytes {
    pub keys: u32,
    pub register: u32,
    /// Bits to clear for both.
    pub clears: u32,
    /// Bits of the read protection, and their value without protection.
    pub protection: (u32, u32),
    /// Description of both for the user.
    pub what: &'static str,
}

impl OptionBytes {
    /// Keys that unlock the option bytes, in order (RM0090, 3.7.2).
    pub const KEYS: [u32; 2] = [0x0819_2a3b, 0x4c5d_6e7f];
    pub const LOCK: u32 = 1;
    /// Bit that starts their programming.
    pub const START: u32 = 1 << 1;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Controller {
    pub keys: u32,
    /// Status register, with the bit [`Controller::BUSY`].
    pub status: u32,
    /// Control register, with the bit [`Controller::LOCK`].
    pub control: u32,
    /// Control bits for programming words of 32 bits.
    pub program: u32,
    /// Error bits of the status; writing 1 clears them.
    pub errors: u32,
}

impl Controller {
    /// Keys that unlock the controller, in order (RM0090, 3.6.1; RM0440, 3.3.6).
    pub const KEYS: [u32; 2] = [0x4567_0123, 0xcdef_89ab];
    /// Status bit: an operation is in progress.
    pub const BUSY: u32 = 1 << 16;
    pub const LOCK: u32 = 1 << 31;
}

/// Chip of the default board (RM0090, sections 2.3, 3.4, 3.9 and 12.2; DBGMCU_IDCODE in 38.6.1,
/// DBGMCU_APB1_FZ and APB2_FZ in 38.16.4 and 38.16.5, flash size in 39.2, TIM1_BDTR in 17.4.18).
pub const STM32F405RG: Chip = Chip {
    name: "STM32F405RG",
    build: "cargo feeder",
    flash: 0x0800_0000..0x0810_0000,
    sectors: &[(4, 16), (1, 64), (7, 128)],
    settings: 0x0800_4000..0x0802_0000,
    slot: 0x0802_0000..0x0808_0000,
    memory: 0x2000_0000..0x2002_0000,
    vectors: 98,
    family: 0x413,
    flash_size: 0x1fff_7a22,
    divided: None,
    stops: (0xe004_200c, 1),
    rests: (0xe004_2008, 3 << 11),
    drives: (0x4001_0044, 1 << 15),
    controller: Controller {
        keys: 0x4002_3c04,
        status: 0x4002_3c0c,
        control: 0x4002_3c10,
        // Parallelism of 32 bits.
        program: 1 | 2 << 8,
        errors: 0xf2,
    },
    // RM0090, 3.9.10: BOR_LEV 0 is level 3, WDG_SW 0 the hardware watchdog, RDP 0xaa no protection.
    options: Some(OptionBytes {
        keys: 0x4002_3c08,
        register: 0x4002_3c14,
        clears: 3 << 2 | 1 << 5,
        protection: (0xff00, 0xaa00),
        what: "brown-out reset at level 3 (2.83 V), the watchdog from reset on",
    }),
};

/// Chip of the Nucleo-G474RE, with flash in two banks (RM0440, sections 2.2, 3.3 and 3.7; DBGMCU in
/// 47, flash size in 48.2, TIM1_BDTR in 28.6.20).
pub const STM32G474RE: Chip = Chip {
    name: "STM32G474RE",
    build: "cargo feeder --no-default-features --features stm32g474re",
    flash: 0x0800_0000..0x0808_0000,
    sectors: &[(256, 2)],
    settings: 0x0807_e000..0x0808_0000,
    slot: 0x0800_6000..0x0807_e000,
    memory: 0x2000_0000..0x2002_0000,
    vectors: 118,
    family: 0x469,
    flash_size: 0x1fff_75e0,
    divided: Some((0x4002_2020, 1 << 22)),
    stops: (0xe004_2010, 1 << 11),
    rests: (0xe004_2008, 3 << 11),
    drives: (0x4001_2c44, 1 << 15),
    controller: Controller {
        keys: 0x4002_2008,
        status: 0x4002_2010,
        control: 0x4002_2014,
        program: 1,
        errors: 0xc3fa,
    },
    // Its option bytes take effect after a separate launch (RM0440, 3.4.2), which no test covers.
    options: None,
};

pub const CHIPS: [&Chip; 2] = [&STM32F405RG, &STM32G474RE];

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sector {
    pub number: usize,
    pub range: Range<u32>,
}

impl Chip {
    /// The chip with this name in an image.
    pub fn named(name: &str) -> Option<&'static Self> {
        let mut chips = CHIPS.into_iter();
        chips.find(|chip| chip.name.eq_ignore_ascii_case(name))
    }

    pub fn sectors(&self) -> impl Iterator<Item = Sector> + '_ {
        let mut end = self.flash.start;
        let sizes = self.sectors.iter();
        let sizes = sizes.flat_map(|(count, size)| std::iter::repeat_n(size, *count));
        sizes.enumerate().map(move |(number, size)| {
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
    use std::collections::BTreeSet;
    use std::path::Path;

    use super::*;

    #[test]
    fn the_sectors_fill_the_flash_and_the_settings_are_whole_ones() {
        for chip in CHIPS {
            let sectors: Vec<Sector> = chip.sectors().collect();
            assert_eq!(sectors.last().unwrap().range.end, chip.flash.end);
            let settings = sectors.iter();
            let settings = settings.filter(|sector| chip.settings.contains(&sector.range.start));
            let settings: Vec<&Sector> = settings.collect();
            assert_eq!(settings.len(), 4, "{}", chip.name);
            assert_eq!(settings[0].range.start, chip.settings.start);
            assert_eq!(settings[3].range.end, chip.settings.end);
        }
    }

    /// Ends of a memory in a board's linker script; with a slot, those of the slot.
    fn described(description: &str, memory: &str) -> Range<u32> {
        let mut lines = description.lines();
        let line = lines.find(|line| line.trim().starts_with(memory)).unwrap();
        let value = |key: &str| {
            let rest = line.split_once(key).unwrap().1;
            let rest = rest.trim_start_matches([' ', '=']);
            let rest = rest.trim_start_matches("DEFINED(kband_slot) ? ");
            rest.split([',', ' ']).next().unwrap().to_owned()
        };
        let start = u32::from_str_radix(value("ORIGIN").trim_start_matches("0x"), 16).unwrap();
        let kib: u32 = value("LENGTH").trim_end_matches('K').parse().unwrap();
        start..start + 1024 * kib
    }

    #[test]
    fn every_board_has_a_chip_with_the_memory_of_its_linker_file() {
        let firmware = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware");
        let mut boards = BTreeSet::new();
        for file in std::fs::read_dir(firmware).unwrap().flatten() {
            let name = file.file_name().into_string().unwrap();
            let Some(board) = name.strip_suffix(".x") else {
                continue;
            };
            let chip = Chip::named(board).unwrap_or_else(|| panic!("no chip for {name}"));
            let description = std::fs::read_to_string(file.path()).unwrap();
            assert_eq!(described(&description, "FLASH"), chip.slot, "{name}");
            assert_eq!(described(&description, "RAM"), chip.memory, "{name}");
            boards.insert(chip.name);
        }
        assert_eq!(boards.len(), CHIPS.len());
    }
}
