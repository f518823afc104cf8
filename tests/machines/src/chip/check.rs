//! Model of the CRC unit (RM0090, chapter 4): CRC-32 of words, highest bit first, four cycles a
//! word.

const POLYNOMIAL: u32 = 0x04c1_1db7;

#[derive(Clone, Debug)]
pub struct Check {
    sum: u32,
}

impl Default for Check {
    fn default() -> Self {
        Self { sum: !0 }
    }
}

impl Check {
    pub fn read(&self, offset: u32) -> u32 {
        if offset == 0 { self.sum } else { 0 }
    }

    pub fn write(&mut self, offset: u32, value: u32) {
        match offset {
            0x00 => {
                self.sum ^= value;
                for _ in 0..32 {
                    let carry = self.sum >> 31;
                    self.sum = self.sum << 1 ^ carry.wrapping_neg() & POLYNOMIAL;
                }
            }
            0x08 if value & 1 == 1 => self.sum = !0,
            _ => {}
        }
    }
}
