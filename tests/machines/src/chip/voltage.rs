//! Model of the digital-to-analogue converter's first channel, on PA4 (RM0090, chapter 14).

#[derive(Clone, Debug, Default)]
pub struct Voltage {
    control: u32,
    held: u32,
    out: u32,
}

impl Voltage {
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0x00 => self.control,
            0x08 | 0x20 => self.held,
            0x2c => self.out,
            _ => 0,
        }
    }

    /// Writes a register. Without a trigger the held value is applied at once.
    pub fn write(&mut self, offset: u32, value: u32) {
        match offset {
            0x00 => self.control = value,
            0x04 if self.control & 4 != 0 && value & 1 != 0 => self.out = self.held,
            0x08 | 0x20 => self.held = value & 0xfff,
            0x10 => self.held = (value & 0xff) << 4,
            _ => {}
        }
        if self.control & 4 == 0 {
            self.out = self.held;
        }
    }

    /// Output over its reference, 0..1; `None` if it is off and the pin floats.
    pub fn output(&self) -> Option<f64> {
        (self.control & 1 == 1).then(|| f64::from(self.out) / 4096.0)
    }
}
