//! Model of the supply, its monitor and the brown-out reset (RM0090, chapter 5; RM0440, chapter 6).

use super::kind::Kind;

/// Bits of CR (5.4.1) and CSR (5.4.2).
const MONITOR: u32 = 1 << 4;
const BELOW: u32 = 1 << 2;
const SCALED: u32 = 1 << 14;

/// Bits of the STM32G474 (RM0440, 6.4): PVDE of CR2, PVDO of SR2, R1MODE of CR5.
const MONITOR_G474: u32 = 1;
const BELOW_G474: u32 = 1 << 11;
const NORMAL_RANGE_1: u32 = 1 << 8;

/// Hysteresis of the monitor and the brown-out reset, V.
const HYSTERESIS: f64 = 0.1;

/// State of the chip at a supply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Supply {
    Enough,
    /// Below the brown-out level: in reset.
    BrownOut,
    /// Below the power-on threshold: off.
    Gone,
}

#[derive(Clone, Debug)]
pub struct Power {
    pub volts: f64,
    kind: Kind,
    /// CR of the STM32F405; CR2 of the STM32G474.
    control: u32,
    /// Output of the monitor: the supply is below its level.
    pub below: bool,
    /// CR1 and CR5 of the STM32G474.
    access: u32,
    range: u32,
}

impl Power {
    pub fn new(kind: Kind) -> Self {
        let (control, range) = match kind {
            Kind::Stm32f405 => (SCALED, 0),
            Kind::Stm32g474 => (0, NORMAL_RANGE_1),
        };
        Self {
            volts: 3.3,
            kind,
            control,
            below: false,
            access: 0,
            range,
        }
    }

    pub fn reset(&mut self) {
        *self = Self {
            volts: self.volts,
            ..Self::new(self.kind)
        };
    }

    pub fn read(&self, offset: u32) -> u32 {
        let below = u32::from(self.below);
        match (self.kind, offset) {
            (Kind::Stm32f405, 0x00) | (Kind::Stm32g474, 0x04) => self.control,
            (Kind::Stm32f405, 0x04) => SCALED | (below * BELOW),
            (Kind::Stm32g474, 0x00) => self.access,
            (Kind::Stm32g474, 0x14) => below * BELOW_G474,
            (Kind::Stm32g474, 0x80) => self.range,
            _ => 0,
        }
    }

    pub fn write(&mut self, offset: u32, value: u32) {
        match (self.kind, offset) {
            (Kind::Stm32f405, 0x00) => self.control = value & 0xc3f3,
            (Kind::Stm32g474, 0x00) => self.access = value,
            (Kind::Stm32g474, 0x04) => self.control = value & 0xff,
            (Kind::Stm32g474, 0x80) => self.range = value & NORMAL_RANGE_1,
            _ => {}
        }
        self.update();
    }

    /// Highest frequency of the core, Hz. The STM32G474 needs range 1 boost for it.
    pub fn fastest(&self) -> u32 {
        self.kind.facts().fastest[usize::from(self.range & NORMAL_RANGE_1 != 0)]
    }

    pub fn update(&mut self) {
        let (on, level) = match self.kind {
            Kind::Stm32f405 => (self.control & MONITOR, self.control >> 5 & 7),
            Kind::Stm32g474 => (self.control & MONITOR_G474, self.control >> 1 & 7),
        };
        let level = self.kind.facts().levels.get(level as usize).unwrap_or(&0.0);
        let level = level + if self.below { HYSTERESIS } else { 0.0 };
        self.below = on != 0 && self.volts < level;
    }

    /// Whether the supply is too low to program or erase the flash by words (DS8626, flash memory
    /// programming), or the monitor's output is high.
    pub fn too_low_for_flash(&self) -> bool {
        self.volts < self.kind.facts().lowest || self.below
    }

    /// State of the chip at this brown-out level of the option bytes (3.9.1), in reset or not.
    pub fn supply(&self, level: u32, in_reset: bool) -> Supply {
        let more = if in_reset { HYSTERESIS } else { 0.0 };
        let facts = self.kind.facts();
        let brown_out = facts.brown_out.get(level as usize).unwrap_or(&0.0);
        if self.volts < facts.off + more / 2.0 {
            Supply::Gone
        } else if self.volts < brown_out + more {
            Supply::BrownOut
        } else {
            Supply::Enough
        }
    }
}
