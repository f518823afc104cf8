//! Instructions of one halfword (ARM DDI 0403E, A5.2).

use super::memory::{WORD, Width};
use super::{Board, COUNTER, Core, Cycles, Fault, LINK, NONE, REFILL, STACK, bit, bits, signed};

impl Core {
    #[inline(always)]
    pub(super) fn narrow(&mut self, code: u16, bus: &mut Board) -> Cycles {
        // In an IT block only comparisons set the flags.
        let set = !self.inside;
        let (d, n, m) = (bits(code, 0, 3), bits(code, 3, 3), bits(code, 6, 3));
        let (upper, small) = (bits(code, 8, 3), bits(code, 6, 5));
        let byte = u32::from(code & 0xff);
        let number = (byte, self.carry);
        // The program counter that an instruction reads is behind the next instruction.
        let counter = self.r[COUNTER].wrapping_add(2) & !3;
        match code >> 11 {
            kind @ 0b00000..=0b00010 => {
                let operand = self.operand(n, kind.into(), small);
                self.data(2, set, d, 0, operand)
            }
            0b00011 => {
                let two = if bit(code, 10) { m as u32 } else { self.r[m] };
                let operation = if bit(code, 9) { 13 } else { 8 };
                self.data(operation, set, d, self.r[n], (two, false))
            }
            0b00100 => self.data(2, set, upper, 0, number),
            0b00101 => self.data(13, true, NONE, self.r[upper], number),
            0b00110 => self.data(8, set, upper, self.r[upper], number),
            0b00111 => self.data(13, set, upper, self.r[upper], number),
            0b01000 if !bit(code, 10) => self.combined(bits(code, 6, 4), set, d, n),
            0b01000 => self.any_registers(code),
            0b01001 => self.load(bus, WORD, upper, counter.wrapping_add(4 * byte), None),
            0b01010 | 0b01011 => {
                let at = self.r[n].wrapping_add(self.r[m]);
                match bits(code, 9, 3) {
                    kind @ 0..=2 => self.store(bus, Width(4 >> kind, false), d, at),
                    3 => self.load(bus, Width(1, true), d, at, None),
                    kind @ 4..=6 => self.load(bus, Width(4 >> (kind - 4), false), d, at, None),
                    _ => self.load(bus, Width(2, true), d, at, None),
                }
            }
            kind @ 0b01100..=0b10001 => {
                let size = [4, 1, 2][usize::from(kind / 2 - 6)];
                let at = self.r[n].wrapping_add(small as u32 * size);
                if bit(code, 11) {
                    self.load(bus, Width(size, false), d, at, None)
                } else {
                    self.store(bus, Width(size, false), d, at)
                }
            }
            0b10010 => self.store(bus, WORD, upper, self.r[STACK].wrapping_add(4 * byte)),
            0b10011 => self.load(bus, WORD, upper, self.r[STACK].wrapping_add(4 * byte), None),
            kind @ (0b10100 | 0b10101) => {
                let from = if kind == 0b10100 {
                    counter
                } else {
                    self.r[STACK]
                };
                Ok(self.set(upper, from.wrapping_add(4 * byte)))
            }
            0b10110 | 0b10111 => self.others(code, bus),
            0b11000 => self.store_many(bus, upper, byte as u16, false, true),
            0b11001 => self.load_many(bus, upper, byte as u16, false, true),
            0b11010 | 0b11011 => match bits(code, 8, 4) {
                14 | 15 => Err(Fault::Undefined),
                condition => Ok(self.branch(self.holds(condition), signed(byte, 8) * 2 + 2)),
            },
            0b11100 => Ok(self.branch(true, signed((code & 0x7ff).into(), 11) * 2 + 2)),
            _ => Err(Fault::Undefined),
        }
    }

    /// Two of the lower registers (A5.2.2).
    #[inline(always)]
    fn combined(&mut self, kind: usize, set: bool, d: usize, m: usize) -> Cycles {
        let (one, two) = (self.r[d], (self.r[m], self.carry));
        match kind {
            0x0 => self.data(0, set, d, one, two),
            0x1 => self.data(4, set, d, one, two),
            0x2..=0x4 => Ok(self.shift_by(kind - 2, set, d, d, m)),
            0x5 => self.data(10, set, d, one, two),
            0x6 => self.data(11, set, d, one, two),
            0x7 => Ok(self.shift_by(3, set, d, d, m)),
            0x8 => self.data(0, true, NONE, one, two),
            0x9 => self.data(14, set, d, two.0, (0, false)),
            0xa => self.data(13, true, NONE, one, two),
            0xb => self.data(8, true, NONE, one, two),
            0xc => self.data(2, set, d, one, two),
            0xd => {
                let value = one.wrapping_mul(two.0);
                if set {
                    self.sign(value);
                }
                Ok(self.set(d, value))
            }
            0xe => self.data(1, set, d, one, two),
            _ => self.data(3, set, d, 0, two),
        }
    }

    /// Any two registers, and branches to one (A5.2.3).
    #[inline(always)]
    fn any_registers(&mut self, code: u16) -> Cycles {
        let (d, m) = (bits(code, 0, 3) | bits(code, 7, 1) << 3, bits(code, 3, 4));
        let ahead = |number| if number == COUNTER { 2 } else { 0 };
        let [one, two] = [d, m].map(|number| self.r[number].wrapping_add(ahead(number)));
        match bits(code, 8, 2) {
            0 => return self.data(8, false, d, one, (two, false)),
            1 => return self.data(13, true, NONE, one, (two, false)),
            2 => return Ok(self.set(d, two)),
            _ if !bit(code, 7) => self.exchange(two)?,
            _ if two & 1 == 0 => return Err(Fault::State),
            _ => {
                self.r[LINK] = self.r[COUNTER] | 1;
                self.r[COUNTER] = two & !1;
            }
        }
        Ok(1 + REFILL)
    }

    /// Stack, extension, hints and other operations (A5.2.5).
    #[inline(always)]
    fn others(&mut self, code: u16, bus: &mut Board) -> Cycles {
        let (d, m) = (bits(code, 0, 3), bits(code, 3, 3));
        let (list, value) = (code & 0xff, self.r[m]);
        let value = match bits(code, 8, 4) {
            0x0 => {
                let by = (u32::from(code & 0x7f) * 4, false);
                let operation = if bit(code, 7) { 13 } else { 8 };
                return self.data(operation, false, STACK, self.r[STACK], by);
            }
            0x1 | 0x3 | 0x9 | 0xb => {
                let by = bits(code, 9, 1) << 6 | bits(code, 3, 5) << 1;
                let taken = (self.r[d] != 0) == bit(code, 11);
                return Ok(self.branch(taken, by as i32 + 2));
            }
            0x2 => match bits(code, 6, 2) {
                0 => i32::from(value as i16) as u32,
                1 => i32::from(value as i8) as u32,
                2 => value & 0xffff,
                _ => value & 0xff,
            },
            0x4 => return self.store_many(bus, STACK, list, true, true),
            0x5 => return self.store_many(bus, STACK, list | 1 << LINK, true, true),
            0x6 if bits(code, 5, 3) == 0b011 && bit(code, 1) => {
                self.mask = bit(code, 4);
                self.attention = true;
                return Ok(1);
            }
            0xa => match bits(code, 6, 2) {
                0 => value.swap_bytes(),
                1 => value.swap_bytes().rotate_right(16),
                3 => i32::from((value as u16).swap_bytes() as i16) as u32,
                _ => return Err(Fault::Undefined),
            },
            0xc => return self.load_many(bus, STACK, list, false, true),
            0xd => return self.load_many(bus, STACK, list | 1 << COUNTER, false, true),
            0xe => return Err(Fault::Breakpoint),
            0xf if code & 0xf != 0 => {
                self.block = list as u8;
                return Ok(1);
            }
            0xf => return Ok(self.hint(bits(code, 4, 4))),
            _ => return Err(Fault::Undefined),
        };
        Ok(self.set(d, value))
    }
}
