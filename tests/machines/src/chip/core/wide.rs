//! Instructions of two halfwords (ARM DDI 0403E, A5.3).

use super::{Board, COUNTER, Core, Cycles, Fault, LINK, NONE, REFILL, bit, bits, signed};

/// Fields of registers in an instruction of two halfwords: n, a (or the low half), d, m.
fn registers(first: u16, second: u16) -> [usize; 4] {
    let [a, d, m] = [12, 8, 0].map(|low| bits(second, low, 4));
    [bits(first, 0, 4), a, d, m]
}

impl Core {
    #[inline(always)]
    pub(super) fn wide(&mut self, first: u16, second: u16, bus: &mut Board) -> Cycles {
        let kind = bits(first, 4, 7);
        match (bits(first, 11, 2), bit(second, 15)) {
            (0b01 | 0b11, _) if kind & 0b100_0000 != 0 => self.coprocessor(first, second, bus),
            (0b01, _) if kind & 0b010_0000 != 0 => self.data_shifted(first, second),
            (0b01, _) if kind & 0b000_0100 != 0 => self.pair(first, second, bus),
            (0b01, _) => {
                let down = match kind >> 3 & 3 {
                    0b01 => false,
                    0b10 => true,
                    _ => return Err(Fault::Undefined),
                };
                let (base, back) = (bits(first, 0, 4), bit(first, 5));
                if bit(first, 4) {
                    self.load_many(bus, base, second, down, back)
                } else {
                    self.store_many(bus, base, second, down, back)
                }
            }
            (0b10, false) if kind & 0b010_0000 == 0 => self.data_number(first, second),
            (0b10, false) => self.plain_number(first, second),
            (0b10, true) => self.branches(first, second),
            (0b11, _) if kind & 0b110_0001 == 1 || kind & 0b111_0001 == 0 => {
                self.single(first, second, bus)
            }
            (0b11, _) if kind & 0b111_0000 == 0b010_0000 => self.data_register(first, second),
            (0b11, _) if kind & 0b111_1000 == 0b011_0000 => self.product(first, second),
            (0b11, _) if kind & 0b111_1000 == 0b011_1000 => self.long(first, second),
            _ => Err(Fault::Undefined),
        }
    }

    /// Operations with an immediate number or with a shifted register (A5.3.1, A5.3.11).
    #[inline(always)]
    fn operate(&mut self, first: u16, target: usize, operand: (u32, bool)) -> Cycles {
        let (operation, set, n) = (bits(first, 5, 4), bit(first, 4), bits(first, 0, 4));
        let moves = matches!(operation, 2 | 3) && n == COUNTER;
        let one = if moves { 0 } else { self.r[n] };
        let tests = set && target == COUNTER;
        let d = if tests { NONE } else { target };
        self.data(operation, set, d, one, operand)
    }

    #[inline(always)]
    fn data_shifted(&mut self, first: u16, second: u16) -> Cycles {
        let by = bits(second, 12, 3) << 2 | bits(second, 6, 2);
        let [n, _, d, m] = registers(first, second);
        if bits(first, 5, 4) != 0b0110 {
            let operand = self.operand(m, bits(second, 4, 2), by);
            return self.operate(first, d, operand);
        }
        if bit(second, 5) {
            return Err(Fault::Undefined);
        }
        // The lower half of one register, and the upper half of another.
        Ok(self.set(d, self.r[n] & 0xffff | self.r[m] << by & 0xffff_0000))
    }

    #[inline(always)]
    fn data_number(&mut self, first: u16, second: u16) -> Cycles {
        let code = twelve(first, second);
        let byte = code & 0xff;
        let number = match code >> 8 {
            0 => byte,
            1 => byte << 16 | byte,
            2 => byte << 24 | byte << 8,
            3 => byte << 24 | byte << 16 | byte << 8 | byte,
            _ => (0x80 | code & 0x7f).rotate_right(code >> 7),
        };
        // A rotated number sets the carry to its top bit.
        let turn = code >> 10 != 0;
        let carry = if turn { number >> 31 == 1 } else { self.carry };
        self.operate(first, bits(second, 8, 4), (number, carry))
    }

    /// Plain immediate numbers (A5.3.3).
    #[inline(always)]
    fn plain_number(&mut self, first: u16, second: u16) -> Cycles {
        let (n, d) = (bits(first, 0, 4), bits(second, 8, 4));
        let number = twelve(first, second);
        let low = bits(second, 12, 3) << 2 | bits(second, 6, 2);
        let last = bits(second, 0, 5);
        let value = match bits(first, 4, 5) {
            0b00000 => self.base(n).wrapping_add(number),
            0b01010 => self.base(n).wrapping_sub(number),
            0b00100 => (n as u32) << 12 | number,
            0b01100 => (n as u32) << 28 | number << 16 | self.r[d] & 0xffff,
            // Saturation, of one number.
            0b10010 | 0b11010 if low == 0 => return Err(Fault::Undefined),
            kind @ (0b10000 | 0b10010 | 0b11000 | 0b11010) => {
                let value = if kind & 0b10 == 0 {
                    self.r[n] << low
                } else {
                    (self.r[n] as i32 >> low) as u32
                };
                let (low, high) = if kind < 0b11000 {
                    (-(1_i64 << last), (1_i64 << last) - 1)
                } else {
                    (0, (1_i64 << last) - 1)
                };
                i64::from(value as i32).clamp(low, high) as u32
            }
            kind @ (0b10100 | 0b11100) => {
                let unused = 31_usize.checked_sub(low + last).ok_or(Fault::Undefined)?;
                let top = self.r[n] << unused;
                if kind == 0b10100 {
                    (top as i32 >> (31 - last)) as u32
                } else {
                    top >> (31 - last)
                }
            }
            0b10110 if last >= low => {
                let mask = ones(last - low + 1) << low;
                let from = if n == COUNTER { 0 } else { self.r[n] };
                self.r[d] & !mask | from << low & mask
            }
            _ => return Err(Fault::Undefined),
        };
        Ok(self.set(d, value))
    }

    /// Branches and control (A5.3.4).
    #[inline(always)]
    fn branches(&mut self, first: u16, second: u16) -> Cycles {
        let field = |code, low, count| bits(code, low, count) as u32;
        let sign = field(first, 10, 1);
        let (j1, j2) = (field(second, 13, 1), field(second, 11, 1));
        let low = field(second, 0, 11) << 1;
        if bit(second, 12) {
            let upper = sign << 24 | (1 ^ j1 ^ sign) << 23 | (1 ^ j2 ^ sign) << 22;
            if bit(second, 14) {
                self.r[LINK] = self.r[COUNTER] | 1;
            }
            return Ok(self.branch(true, signed(upper | field(first, 0, 10) << 12 | low, 25)));
        }
        let condition = bits(first, 6, 4);
        if bit(second, 14) {
            return Err(Fault::Undefined);
        } else if condition < 14 {
            let upper = sign << 20 | j2 << 19 | j1 << 18 | field(first, 0, 6) << 12;
            return Ok(self.branch(self.holds(condition), signed(upper | low, 21)));
        }
        match bits(first, 4, 7) {
            0b011_1000 | 0b011_1001 => self.set_special(second as u8, self.r[bits(first, 0, 4)]),
            0b011_1010 if bits(second, 8, 3) == 0 => Ok(self.hint(bits(second, 0, 8))),
            0b011_1011 => match bits(second, 4, 4) {
                2 => {
                    self.exclusive = false;
                    Ok(1)
                }
                4..=6 => Ok(1 + REFILL),
                _ => Err(Fault::Undefined),
            },
            0b011_1110 | 0b011_1111 => {
                let value = self.special(second as u8)?;
                self.set(bits(second, 8, 4), value);
                Ok(2)
            }
            _ => Err(Fault::Undefined),
        }
    }

    /// Registers only (A5.3.12 to A5.3.15).
    fn data_register(&mut self, first: u16, second: u16) -> Cycles {
        let [n, fixed, d, m] = registers(first, second);
        let (one, two) = (self.r[n], self.r[m]);
        let (kind, how) = (bits(first, 4, 4), bits(second, 4, 4));
        if fixed != 15 {
            return Err(Fault::Undefined);
        }
        let value = match (kind, how) {
            (0..=7, 0) => return Ok(self.shift_by(kind >> 1, bit(first, 4), d, n, m)),
            (0 | 1 | 3..=5, 8..) => {
                let value = two.rotate_right(8 * (how as u32 & 3));
                let base = if n == COUNTER { 0 } else { one };
                match kind {
                    0 => base.wrapping_add_signed(i32::from(value as i16)),
                    1 => base.wrapping_add(value & 0xffff),
                    3 => {
                        let (low, high) = (value & 0xff, value >> 16 & 0xff);
                        base.wrapping_add(low) & 0xffff | (base >> 16).wrapping_add(high) << 16
                    }
                    4 => base.wrapping_add_signed(i32::from(value as i8)),
                    _ => base.wrapping_add(value & 0xff),
                }
            }
            (8 | 9 | 12 | 13, 5) => saturate_lanes(kind & 1 == 0, kind & 4 != 0, one, two),
            (9, 8) => two.swap_bytes(),
            (9, 9) => two.swap_bytes().rotate_right(16),
            (9, 10) => two.reverse_bits(),
            (9, 11) => i32::from((two as u16).swap_bytes() as i16) as u32,
            (11, 8) => two.leading_zeros(),
            _ => return Err(Fault::Undefined),
        };
        Ok(self.set(d, value))
    }

    /// Products of words and of halves (A5.3.16).
    fn product(&mut self, first: u16, second: u16) -> Cycles {
        let [n, a, d, m] = registers(first, second);
        let (one, two) = (self.r[n], self.r[m]);
        let added = if a == COUNTER { 0 } else { self.r[a] };
        let (upper, other) = (bit(second, 5), bit(second, 4));
        let value = match bits(first, 4, 3) {
            0 if other => self.r[a].wrapping_sub(one.wrapping_mul(two)),
            0 => one.wrapping_mul(two).wrapping_add(added),
            1 => {
                let half = |value: u32, top: bool| {
                    i32::from((if top { value >> 16 } else { value }) as i16)
                };
                added.wrapping_add_signed(half(one, upper) * half(two, other))
            }
            5 => {
                let product = i64::from(one as i32) * i64::from(two as i32);
                let rounding = i64::from(other) << 31;
                let base = i64::from(added as i32) << 32;
                (base.wrapping_add(product).wrapping_add(rounding) >> 32) as u32
            }
            _ => return Err(Fault::Undefined),
        };
        Ok(self.set(d, value))
    }

    /// Products of 64 bits, and quotients (A5.3.17).
    fn long(&mut self, first: u16, second: u16) -> Cycles {
        let [n, low, high, m] = registers(first, second);
        let (one, two) = (self.r[n], self.r[m]);
        let target = u64::from(self.r[high]) << 32 | u64::from(self.r[low]);
        let unsigned = u64::from(one) * u64::from(two);
        let signed = (i64::from(one as i32) * i64::from(two as i32)) as u64;
        let value = match (bits(first, 4, 3), bits(second, 4, 4)) {
            (kind @ (1 | 3), 15) => {
                let value = match (kind, two) {
                    (_, 0) => 0,
                    (1, _) => (one as i32).wrapping_div(two as i32) as u32,
                    _ => one / two,
                };
                self.set(high, value);
                // 2 to 12 cycles, fewer for a shorter quotient.
                return Ok(2 + (32 - value.leading_zeros()) * 10 / 32);
            }
            (0, 0) => signed,
            (2, 0) => unsigned,
            (4, 0) => target.wrapping_add(signed),
            (6, 0) => target.wrapping_add(unsigned),
            (6, 6) => unsigned + u64::from(self.r[low]) + u64::from(self.r[high]),
            _ => return Err(Fault::Undefined),
        };
        self.set(low, value as u32);
        self.set(high, (value >> 32) as u32);
        Ok(1)
    }
}

/// Saturating sums or differences of unsigned bytes or halves.
fn saturate_lanes(bytes: bool, subtracted: bool, one: u32, two: u32) -> u32 {
    let width = if bytes { 8 } else { 16 };
    let largest = ones(width);
    (0..32).step_by(width).fold(0, |value, low| {
        let (one, two) = (one >> low & largest, two >> low & largest);
        let (sum, difference) = ((one + two).min(largest), one.saturating_sub(two));
        let lane = if subtracted { difference } else { sum };
        value | lane << low
    })
}

/// Twelve bits of a number: i, imm3, imm8.
fn twelve(first: u16, second: u16) -> u32 {
    let upper = bits(first, 10, 1) << 11 | bits(second, 12, 3) << 8;
    upper as u32 | u32::from(second & 0xff)
}

/// A mask of `count` ones, 1 to 32.
fn ones(count: usize) -> u32 {
    u32::MAX >> (32 - count)
}
