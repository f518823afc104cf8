//! Model of the CRC unit (RM0090, chapter 4): CRC-32 of words, highest bit first, four cycles each.

/// Generator polynomial of CRC-32.
const POLYNOMIAL: u32 = 0x04c1_1db7;

/// The registers.
#[derive(Clone, Debug)]
pub struct Check {
    sum: u32,
    spare: u32,
}

impl Default for Check {
    fn default() -> Self {
        Self { sum: !0, spare: 0 }
    }
}

impl Check {
    /// Reads a register.
    #[must_use]
    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0x00 => self.sum,
            0x04 => self.spare,
            _ => 0,
        }
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32) {
        match offset {
            0x00 => {
                self.sum ^= value;
                for _ in 0..32 {
                    let carry = self.sum >> 31;
                    self.sum = self.sum << 1 ^ carry.wrapping_neg() & POLYNOMIAL;
                }
            }
            0x04 => self.spare = value & 0xff,
            0x08 if value & 1 == 1 => self.sum = !0,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kband::wire::crc32;

    #[test]
    fn words_with_their_bits_reversed_give_the_crc_32_of_their_bytes() {
        let bytes: Vec<u8> = (0..64).map(|n| n * 37).collect();
        let mut unit = Check::default();
        for word in bytes.as_chunks().0 {
            unit.write(0, u32::from_le_bytes(*word).reverse_bits());
        }
        assert_eq!(!unit.read(0).reverse_bits(), crc32(&bytes));
        unit.write(8, 1);
        assert_eq!(unit.read(0), !0);
    }
}
