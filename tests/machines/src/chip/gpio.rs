//! Model of a port of sixteen pins (RM0090, chapter 8; RM0440, chapter 9).

use super::{set_word, word};

/// External level at a pin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wire {
    /// Open: the chip's pull-up or pull-down decides.
    #[default]
    Open,
    Low,
    High,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    Input,
    /// Output of its bit.
    Output,
    /// Alternate function with this number.
    Function(u8),
    Analogue,
}

#[derive(Clone, Debug, Default)]
pub struct Port {
    pub wires: [Wire; 16],
    registers: [u32; 10],
}

impl Port {
    /// Resets the registers. All pins are inputs then, which float as analogue pins do.
    pub fn reset(&mut self) {
        self.registers = [0; 10];
    }

    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0x10 => (0..16).map(|pin| u32::from(self.level(pin)) << pin).sum(),
            0x18 => 0,
            offset => word(&self.registers, offset),
        }
    }

    pub fn write(&mut self, offset: u32, value: u32) {
        match offset {
            0x10 => {}
            // Setting has priority over clearing (8.4.7).
            0x18 => self.registers[5] = self.registers[5] & !(value >> 16) | value & 0xffff,
            offset => set_word(&mut self.registers, offset, value),
        }
    }

    pub fn mode(&self, pin: usize) -> Mode {
        match self.registers[0] >> (2 * pin) & 3 {
            0 => Mode::Input,
            1 => Mode::Output,
            2 => Mode::Function((self.registers[8 + pin / 8] >> (4 * (pin % 8)) & 0xf) as u8),
            _ => Mode::Analogue,
        }
    }

    /// Level of a pin in the input register; a floating pin reads low.
    pub fn level(&self, pin: usize) -> bool {
        match (self.mode(pin), self.wires[pin]) {
            (Mode::Analogue, _) => false,
            (Mode::Output, _) => self.registers[5] >> pin & 1 == 1,
            (_, Wire::Low) => false,
            (_, Wire::High) => true,
            (_, Wire::Open) => self.registers[3] >> (2 * pin) & 3 == 1,
        }
    }

    /// Level of an output; `None` if the pin is not an output.
    pub fn output(&self, pin: usize) -> Option<bool> {
        (self.mode(pin) == Mode::Output).then(|| self.level(pin))
    }
}
