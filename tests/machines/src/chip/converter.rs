//! Model of a converter: one triggered group of injected conversions of 12 bits (RM0090, chapter
//! 13; RM0440, chapter 21). No image starts regular conversions.

use super::kind::Kind;
use super::{set_word, word};

/// Bit of CR2, and of CR on the STM32G474.
const ON: u32 = 1;
// Tables of two rows: of the STM32F405, and of the STM32G474.
/// Flags of the injected group's end in SR (ISR).
const ENDED: [u32; 2] = [1 << 2, 3 << 5];
/// Offsets of the common clock register and of the first result.
const COMMON: [u32; 2] = [0x304, 0x308];
const RESULTS: [u32; 2] = [0x3c, 0x80];
/// Sampling times by code, half cycles (13.13.5; RM0440, 21.7.6).
const SAMPLING: [[u32; 8]; 2] = [
    [6, 30, 56, 112, 168, 224, 288, 960],
    [5, 13, 25, 49, 95, 185, 495, 1281],
];
/// Offsets of the sampling times of channels 0 to 9, and of the others.
const SAMPLING_TIMES: [[u32; 2]; 2] = [[0x10, 0x0c], [0x14, 0x18]];
/// Duration of a conversion, half cycles.
const CONVERSION: [u32; 2] = [24, 25];
/// Delay from a trigger to the sampling, half cycles (DS8626, table 67; DS12288, ADC
/// characteristics).
const TRIGGER_DELAY: [u32; 2] = [6, 7];

/// Bits of the STM32G474 (RM0440, 21.7): ready in ISR; start and stop in CR.
const READY_G474: u32 = 1;
const START_G474: u32 = 1 << 3;
const STOP_G474: u32 = 1 << 5;
/// Offset of JSQR.
const GROUP_G474: usize = 0x4c;
/// Dividers of the converter's clock by code (RM0440, 21.8.2).
const DIVIDERS_G474: [u32; 12] = [1, 2, 4, 6, 8, 10, 12, 16, 32, 64, 128, 256];

/// Registers of ADC1 and the common registers of the converters.
#[derive(Clone, Debug)]
pub struct Converter {
    kind: Kind,
    registers: [u32; 64],
    prescaler: u32,
    /// End tick of the running group.
    pub due: u64,
}

impl Converter {
    pub fn new(kind: Kind) -> Self {
        Self {
            kind,
            registers: [0; 64],
            prescaler: 0,
            due: u64::MAX,
        }
    }

    /// Reads a register; from `offset` 0x300 on a common one.
    pub fn read(&self, offset: u32) -> u32 {
        if offset == COMMON[self.kind as usize] {
            return self.prescaler;
        }
        word(&self.registers, offset)
    }

    /// Writes a register. On the STM32G474 regulator and calibration take no time here.
    pub fn write(&mut self, offset: u32, value: u32) {
        match (self.kind, offset) {
            (kind, offset) if offset == COMMON[kind as usize] => self.prescaler = value,
            (Kind::Stm32f405, 0x00) => self.registers[0] &= value,
            (Kind::Stm32g474, 0x00) => self.registers[0] &= !value,
            (Kind::Stm32g474, 0x08) => {
                // A start stays set until it is stopped; a calibration ends at once.
                let started = (value | self.registers[2]) & START_G474;
                let stopped = (value & STOP_G474) >> 2;
                self.registers[2] = (value | started) & !(stopped | STOP_G474 | 1 << 31);
                if value & ON != 0 {
                    self.registers[0] |= READY_G474;
                }
            }
            _ => set_word(&mut self.registers, offset, value),
        }
    }

    /// Duration of a channel's sampling, half converter cycles.
    fn sampling(&self, channel: u32) -> u32 {
        let kind = self.kind as usize;
        let codes = SAMPLING_TIMES[kind][usize::from(channel >= 10)];
        let code = word(&self.registers, codes) >> (3 * (channel % 10)) & 7;
        SAMPLING[kind][code as usize]
    }

    /// Divider from the bus clock to the converter's.
    fn divider(&self) -> u32 {
        match self.kind {
            Kind::Stm32f405 => 2 * ((self.prescaler >> 16 & 3) + 1),
            Kind::Stm32g474 => {
                let code = (self.prescaler >> 18 & 0xf) as usize;
                DIVIDERS_G474.get(code).copied().unwrap_or(256)
            }
        }
    }

    /// Ticks from a trigger to the end of the group's first sample; an APB2 cycle takes `cycle`.
    pub fn samples(&self, cycle: u64) -> u64 {
        let delay = TRIGGER_DELAY[self.kind as usize];
        let sampling = self.sampling(self.group()[0]);
        u64::from((delay + sampling) * self.divider()) * cycle / 2
    }

    /// Channels of the injected group in order (13.13.12; RM0440, 21.7.16).
    fn group(&self) -> Vec<u32> {
        if self.kind == Kind::Stm32g474 {
            let word = self.registers[GROUP_G474 / 4];
            let channels = (0..=word & 3).map(|rank| word >> (9 + 6 * rank) & 0x1f);
            return channels.collect();
        }
        let word = self.registers[0x38 / 4];
        let last = word >> 20 & 3;
        let channels = (0..=last).map(|rank| word >> (5 * (3 - last + rank)) & 0x1f);
        channels.collect()
    }

    /// Handles the trigger of TIM1 at tick `now`: starts the group if it is enabled and none is
    /// running.
    pub fn trigger(&mut self, now: u64, cycle: u64) {
        let control = self.registers[2];
        let group = self.registers[GROUP_G474 / 4];
        let is_triggered = match self.kind {
            Kind::Stm32f405 => control >> 16 & 0xf == 1 && control >> 20 & 1 == 1,
            // A rising edge of its trigger 0.
            Kind::Stm32g474 => {
                control & START_G474 != 0 && group >> 7 & 1 == 1 && group >> 2 & 0x1f == 0
            }
        };
        if control & ON != 0 && is_triggered && self.due == u64::MAX {
            let conversion = CONVERSION[self.kind as usize];
            let times = self.group().into_iter().map(|channel| {
                u64::from((self.sampling(channel) + conversion) * self.divider()) * cycle / 2
            });
            self.due = now + times.sum::<u64>();
        }
    }

    /// Ends the group with the readings `level` of each channel, 0 to 4095.
    pub fn end(&mut self, level: impl Fn(u32) -> u16) {
        self.due = u64::MAX;
        let kind = self.kind as usize;
        for (place, channel) in (RESULTS[kind]..).step_by(4).zip(self.group()) {
            set_word(&mut self.registers, place, level(channel).into());
        }
        self.registers[0] |= ENDED[kind];
    }

    /// Whether it requests its interrupt.
    pub fn interrupts(&self) -> bool {
        let ended = self.registers[0] & ENDED[self.kind as usize];
        // Enables in CR1 and IER: for each flag its own.
        let enabled = match self.kind {
            Kind::Stm32f405 => self.registers[1] >> 5,
            Kind::Stm32g474 => self.registers[1],
        };
        ended & enabled != 0
    }
}
