//! Model of the digital-to-analogue converter's first channel, on PA4 (RM0090, chapter 14).

#[derive(Clone, Debug, Default)]
pub struct Voltage {
    control: u32,
    out: u32,
}

impl Voltage {
    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0x00 => self.control,
            0x08 | 0x2c => self.out,
            _ => 0,
        }
    }

    /// Writes a register. A value is applied at once; triggers are not modelled.
    pub fn write(&mut self, offset: u32, value: u32) {
        match offset {
            0x00 => self.control = value,
            0x08 => self.out = value & 0xfff,
            _ => {}
        }
    }

    /// Output over its reference, 0..1; `None` if it is off and the pin floats.
    pub fn output(&self) -> Option<f64> {
        (self.control & 1 == 1).then(|| f64::from(self.out) / 4096.0)
    }
}
