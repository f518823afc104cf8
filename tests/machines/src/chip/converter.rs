//! Model of a converter: one triggered group of injected conversions, and regular conversions
//! started by software (RM0090, chapter 13; RM0440, chapter 21).

use super::kind::Kind;
use super::{set_word, word};

/// Bits of SR and CR2.
const REGULAR_END: u32 = 1 << 1;
const INJECTED_END: u32 = 1 << 2;
const INJECTED_START: u32 = 1 << 3;
const REGULAR_START: u32 = 1 << 4;
const ON: u32 = 1;
const RIGHT_TO_LEFT: u32 = 1 << 11;
const START_INJECTED: u32 = 1 << 22;
const START: u32 = 1 << 30;
/// Sampling times by code, half cycles (13.13.5; RM0440, 21.7.6).
const SAMPLING: [u32; 8] = [6, 30, 56, 112, 168, 224, 288, 960];
const SAMPLING_G474: [u32; 8] = [5, 13, 25, 49, 95, 185, 495, 1281];
/// Delay from a trigger to the sampling, half cycles (DS8626, table 67; DS12288, ADC
/// characteristics).
const TRIGGER_DELAY: u32 = 6;
const TRIGGER_DELAY_G474: u32 = 7;

/// Bits of the STM32G474 (RM0440, 21.7). ISR: ready, end of regular conversions, end of injected
/// ones. CR: on, starts, and stops, which clear the starts. CFGR: only the resolution is modelled.
const READY_G474: u32 = 1;
const REGULAR_END_G474: u32 = 3 << 2;
const INJECTED_END_G474: u32 = 3 << 5;
const ON_G474: u32 = 1;
const START_G474: u32 = 1 << 2;
const START_INJECTED_G474: u32 = 1 << 3;
const STOPS_G474: u32 = 3 << 4;
/// Offsets of JSQR and of the first injected result.
const GROUP_G474: usize = 0x4c;
const RESULTS_G474: usize = 0x80;
/// Dividers of the converter's clock by code (RM0440, 21.8.2).
const DIVIDERS_G474: [u32; 12] = [1, 2, 4, 6, 8, 10, 12, 16, 32, 64, 128, 256];

/// Registers of ADC1 and the common registers of the converters.
#[derive(Clone, Debug)]
pub struct Converter {
    kind: Kind,
    registers: [u32; 64],
    prescaler: u32,
    /// End ticks of the running injected group and of the regular conversion.
    injected: u64,
    regular: u64,
}

impl Converter {
    pub fn new(kind: Kind) -> Self {
        Self {
            kind,
            registers: [0; 64],
            prescaler: 0,
            injected: u64::MAX,
            regular: u64::MAX,
        }
    }

    /// Reads a register; from `offset` 0x300 on a common one.
    pub fn read(&mut self, offset: u32) -> u32 {
        match offset {
            0x308 => self.prescaler,
            0x40 if self.kind == Kind::Stm32g474 => {
                self.registers[0] &= !(1 << 2);
                self.registers[0x40 / 4]
            }
            offset if self.kind == Kind::Stm32g474 => word(&self.registers, offset),
            0x304 => self.prescaler,
            0x4c => {
                self.registers[0] &= !REGULAR_END;
                self.registers[0x4c / 4]
            }
            offset => word(&self.registers, offset),
        }
    }

    /// Writes a register at tick `now`; an APB2 cycle takes `cycle` ticks.
    pub fn write(&mut self, offset: u32, value: u32, now: u64, cycle: u64) {
        if self.kind == Kind::Stm32g474 {
            return self.write_g474(offset, value, now, cycle);
        }
        match offset {
            0x00 => self.registers[0] &= value,
            0x304 => self.prescaler = value,
            0x08 => {
                self.registers[2] = value & !(START | START_INJECTED);
                if value & ON != 0 && value & START != 0 {
                    self.registers[0] |= REGULAR_START;
                    let channel = self.registers[0x34 / 4] & 0x1f;
                    self.regular = now + self.time(channel, cycle);
                }
                if value & ON != 0 && value & START_INJECTED != 0 {
                    self.begin(now, cycle);
                }
            }
            0x3c..=0x4c => {}
            offset => set_word(&mut self.registers, offset, value),
        }
    }

    /// Writes a register of the STM32G474. Regulator and calibration take no time here.
    fn write_g474(&mut self, offset: u32, value: u32, now: u64, cycle: u64) {
        match offset {
            0x00 => self.registers[0] &= !value,
            0x308 => self.prescaler = value,
            0x08 => {
                // A start stays set until it is stopped; a calibration ends at once.
                let stopped = (value & STOPS_G474) >> 2;
                let started = value & !self.registers[2] & !stopped;
                let preserved = self.registers[2] & (START_G474 | START_INJECTED_G474);
                self.registers[2] = (value | preserved) & !(stopped | STOPS_G474 | 1 << 31);
                if value & ON_G474 != 0 {
                    self.registers[0] |= READY_G474;
                }
                if started & START_G474 != 0 {
                    let channel = self.registers[0x30 / 4] >> 6 & 0x1f;
                    self.regular = now + self.time(channel, cycle);
                }
                if started & START_INJECTED_G474 != 0
                    && self.registers[GROUP_G474 / 4] >> 7 & 3 == 0
                {
                    self.begin(now, cycle);
                }
            }
            0x40 | 0x80..=0x8c => {}
            offset => set_word(&mut self.registers, offset, value),
        }
    }

    /// Duration of one conversion, ticks.
    fn time(&self, channel: u32, cycle: u64) -> u64 {
        let (sampling, conversion) = self.half_cycles(channel);
        u64::from((sampling + conversion) * self.divider()) * cycle / 2
    }

    /// Durations of a channel's sampling and of its conversion, half converter cycles.
    fn half_cycles(&self, channel: u32) -> (u32, u32) {
        let (number, shift) = (usize::from(channel >= 10), 3 * (channel % 10));
        let code = |registers: [u32; 2]| (registers[number] >> shift & 7) as usize;
        match self.kind {
            Kind::Stm32f405 => {
                let bits = 12 - 2 * (self.registers[1] >> 24 & 3);
                let sampling = SAMPLING[code([self.registers[4], self.registers[3]])];
                (sampling, 2 * bits)
            }
            Kind::Stm32g474 => {
                let bits = 12 - 2 * (self.registers[3] >> 3 & 3);
                let sampling = SAMPLING_G474[code([self.registers[5], self.registers[6]])];
                (sampling, 2 * bits + 1)
            }
        }
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

    /// Ticks from a trigger to the end of the group's first sample.
    pub fn samples(&self, cycle: u64) -> u64 {
        let channel = self.group().first().copied().unwrap_or(0);
        let delay = match self.kind {
            Kind::Stm32f405 => TRIGGER_DELAY,
            Kind::Stm32g474 => TRIGGER_DELAY_G474,
        };
        let (sampling, _) = self.half_cycles(channel);
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

    fn begin(&mut self, now: u64, cycle: u64) {
        if self.kind == Kind::Stm32f405 {
            self.registers[0] |= INJECTED_START;
        }
        let group = self.group().into_iter();
        let times = group.map(|channel| self.time(channel, cycle));
        self.injected = now + times.sum::<u64>();
    }

    /// Handles the trigger of TIM1: starts the group if it is enabled and none is running.
    pub fn trigger(&mut self, now: u64, cycle: u64) {
        let control = self.registers[2];
        let group = self.registers[GROUP_G474 / 4];
        let is_triggered = match self.kind {
            Kind::Stm32f405 => control >> 16 & 0xf == 1 && control >> 20 & 1 == 1,
            // A rising edge of its trigger 0.
            Kind::Stm32g474 => {
                control & START_INJECTED_G474 != 0 && group >> 7 & 1 == 1 && group >> 2 & 0x1f == 0
            }
        };
        if control & ON != 0 && is_triggered && self.injected == u64::MAX {
            self.begin(now, cycle);
        }
    }

    /// Tick at which a conversion ends.
    pub fn due(&self) -> u64 {
        self.injected.min(self.regular)
    }

    /// Ends the conversions due by `now` with the readings `level` of each channel, 0 to 4095.
    pub fn end(&mut self, now: u64, mut level: impl FnMut(u32) -> u16) {
        let g474 = self.kind == Kind::Stm32g474;
        let (register, at) = if g474 { (3, 3) } else { (1, 24) };
        let cut = 2 * (self.registers[register] >> at & 3);
        let to_left = !g474 && self.registers[2] & RIGHT_TO_LEFT != 0;
        let left = if to_left { 4 } else { 0 };
        let mut convert = |channel: u32| u32::from(level(channel)) >> cut << left;
        if now >= self.regular {
            self.regular = u64::MAX;
            if g474 {
                self.registers[0x40 / 4] = convert(self.registers[0x30 / 4] >> 6 & 0x1f);
                self.registers[0] |= REGULAR_END_G474;
                self.registers[2] &= !START_G474;
            } else {
                self.registers[0x4c / 4] = convert(self.registers[0x34 / 4] & 0x1f);
                self.registers[0] |= REGULAR_END;
            }
        }
        if now < self.injected {
            return;
        }
        self.injected = u64::MAX;
        for (rank, channel) in self.group().into_iter().enumerate() {
            let value = convert(channel);
            if g474 {
                self.registers[RESULTS_G474 / 4 + rank] = value;
            } else {
                let zero = self.registers[0x14 / 4 + rank] & 0xfff;
                self.registers[0x3c / 4 + rank] = value.wrapping_sub(zero) & 0xffff;
            }
        }
        self.registers[0] |= if g474 {
            INJECTED_END_G474
        } else {
            INJECTED_END
        };
    }

    /// Whether it requests its interrupt: end of a regular conversion, or of the injected group.
    pub fn interrupts(&self) -> bool {
        if self.kind == Kind::Stm32g474 {
            return self.registers[0] & self.registers[1] & (REGULAR_END_G474 | INJECTED_END_G474)
                != 0;
        }
        let (status, control) = (self.registers[0], self.registers[1]);
        status & REGULAR_END != 0 && control >> 5 & 1 == 1
            || status & INJECTED_END != 0 && control >> 7 & 1 == 1
    }
}
