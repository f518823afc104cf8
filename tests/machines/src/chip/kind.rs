//! Chips of the firmware, and their differences.
//!
//! Both have the same core, timers, ports, CRC unit and watchdogs. The registers of each peripheral
//! are in its file; the other differences are here.

use std::ops::Range;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// STM32F405RG (RM0090, DS8626).
    #[default]
    Stm32f405,
    /// STM32G474RE with its flash in two banks (RM0440, DS12288).
    Stm32g474,
}

#[derive(Debug)]
pub struct Facts {
    /// Feature of the firmware's package that replaces the default ones.
    pub feature: Option<&'static str>,
    /// Identity (DBGMCU_IDCODE), and flash size in KiB.
    pub identity: (u32, u32),
    /// Highest frequency of the core in Hz, and the one without range 1 boost.
    pub fastest: [u32; 2],
    /// Lowest supply for the highest frequency and for the flash, V.
    pub lowest: f64,
    /// Power-down threshold, V: below it the chip is off with any option bytes.
    pub off: f64,
    /// Monitor thresholds of a falling supply by level, V.
    pub levels: &'static [f64],
    /// Brown-out thresholds in the coding of the option bytes, V; 0 is off.
    pub brown_out: &'static [f64],
    /// Alternate function of the pins of TIM1.
    pub timer_function: u8,
    /// Converter channels: accelerometer (PA1), current sensor (PC0).
    pub channels: [u32; 2],
    /// Bits of the prescaler in the window watchdog's configuration.
    pub window_prescaler: u32,
    /// Spread of the independent watchdog's oscillator, Hz.
    pub watchdog_clock: [f64; 2],
    /// Offsets of the sectors of settings and faults in the flash.
    pub stored: Range<usize>,
    /// Offset of the settings in the flash.
    pub settings: usize,
    /// Size of a sector of the settings, bytes; there are two.
    pub settings_sector: usize,
    /// Offset of the program in the flash.
    pub program: usize,
    /// Size of a word that is programmed at once, bytes.
    pub flash_word: usize,
}

const STM32F405: Facts = Facts {
    feature: None,
    identity: (0x1007_6413, 1024),
    // DS8626, table 14.
    fastest: [168_000_000; 2],
    // With 5 wait states, and with programming of the flash by words (DS8626, table 15).
    lowest: 2.7,
    off: 1.68,
    // DS8626, table 19. Option bytes (3.9.1): 0b00 is level 3, 0b11 is off.
    levels: &[1.98, 2.13, 2.25, 2.39, 2.54, 2.65, 2.78, 2.88],
    brown_out: &[2.83, 2.44, 2.19, 0.0],
    timer_function: 1,
    channels: [1, 10],
    window_prescaler: 3 << 7,
    // DS8626, table 40.
    watchdog_clock: [17e3, 47e3],
    stored: 0x4000..0x2_0000,
    settings: 0x4000,
    settings_sector: 16 * 1024,
    program: 0x2_0000,
    flash_word: 4,
};

const STM32G474: Facts = Facts {
    feature: Some("stm32g474re"),
    identity: (0x2003_6469, 512),
    // RM0440, 6.1.5.
    fastest: [170_000_000, 150_000_000],
    lowest: 1.71,
    off: 1.62,
    // DS12288, embedded reset and power control block; level 7 is an external input. Option bytes
    // (3.7.8): 0 is off.
    levels: &[2.05, 2.2, 2.36, 2.52, 2.64, 2.81, 2.9],
    brown_out: &[0.0, 2.0, 2.2, 2.49, 2.76],
    timer_function: 6,
    channels: [2, 6],
    window_prescaler: 7 << 11,
    // DS12288, LSI oscillator characteristics.
    watchdog_clock: [29.5e3, 34e3],
    stored: 0x7_e000..0x8_0000,
    settings: 0x7_f000,
    settings_sector: 2 * 1024,
    program: 0x6000,
    flash_word: 8,
};

/// A block of registers, with a number if there are several.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Block {
    /// WWDG.
    Window,
    /// IWDG.
    Watchdog,
    /// USART2.
    Link,
    /// UART4.
    Fieldbus,
    /// PWR.
    Power,
    /// DAC1.
    Voltage,
    /// TIM1.
    Bridge,
    /// ADC1 and the common registers of the converters.
    Converter,
    /// SYSCFG.
    Configuration,
    /// EXTI.
    Lines,
    /// Ports A to I, from 0 on.
    Port(usize),
    /// CRC.
    Check,
    /// RCC.
    Clocks,
    Flash,
}

/// Size of a block, bytes.
const SIZE: u32 = 0x400;

/// Blocks, number of consecutive ones, first addresses on the STM32F405 and the STM32G474.
const BLOCKS: [(Block, u32, [u32; 2]); 14] = [
    (Block::Window, 1, [0x4000_2c00, 0x4000_2c00]),
    (Block::Watchdog, 1, [0x4000_3000, 0x4000_3000]),
    (Block::Link, 1, [0x4000_4400, 0x4000_4400]),
    (Block::Fieldbus, 1, [0x4000_4c00, 0x4000_4c00]),
    (Block::Power, 1, [0x4000_7000, 0x4000_7000]),
    (Block::Voltage, 1, [0x4000_7400, 0x5000_0800]),
    (Block::Bridge, 1, [0x4001_0000, 0x4001_2c00]),
    (Block::Converter, 1, [0x4001_2000, 0x5000_0000]),
    (Block::Configuration, 1, [0x4001_3800, 0x4001_0000]),
    (Block::Lines, 1, [0x4001_3c00, 0x4001_0400]),
    (Block::Port(0), 9, [0x4002_0000, 0x4800_0000]),
    (Block::Check, 1, [0x4002_3000, 0x4002_3000]),
    (Block::Clocks, 1, [0x4002_3800, 0x4002_1000]),
    (Block::Flash, 1, [0x4002_3c00, 0x4002_2000]),
];

impl Kind {
    pub fn facts(self) -> &'static Facts {
        match self {
            Self::Stm32f405 => &STM32F405,
            Self::Stm32g474 => &STM32G474,
        }
    }

    /// Block and offset of a register by its address; `None` without a model.
    pub fn place(self, address: u32) -> Option<(Block, u32)> {
        BLOCKS.iter().find_map(|&(block, count, first)| {
            let offset = address.wrapping_sub(first[self as usize]);
            let number = (offset / SIZE) as usize;
            let block = match block {
                Block::Port(_) => Block::Port(number),
                block => block,
            };
            (offset < count * SIZE).then_some((block, offset % SIZE))
        })
    }

    /// Address of a register of this chip, from its address on the STM32F405.
    ///
    /// # Panics
    /// The block does not exist.
    pub fn address(self, same: u32) -> u32 {
        let mut blocks = BLOCKS.iter();
        let block = blocks.find(|(_, count, [first, _])| same.wrapping_sub(*first) < count * SIZE);
        let (.., first) = block.expect("a block of both chips");
        same - first[0] + first[self as usize]
    }
}
