//! Single precision of the FPv4-SP: rounding to nearest, with subnormal numbers (ARM DDI 0403E,
//! A2.5, A6.4 to A6.7). A NaN without a NaN operand has no sign.

use super::memory::{put, word};
use super::{Board, COUNTER, Core, Cycles, Fault, bit, bits};

const NAN: u32 = 0x7fc0_0000;
/// Bit that makes a NaN a quiet one.
const QUIET: u32 = 0x0040_0000;

fn is_nan(bits: u32) -> bool {
    bits & 0x7fff_ffff > 0x7f80_0000
}

/// Number of a register: a field of four bits, and below it one bit; for a pair the bit is above.
fn register(field: usize, other: bool, double: bool) -> usize {
    if double {
        (usize::from(other) << 4 | field) << 1
    } else {
        field << 1 | usize::from(other)
    }
}

/// Result of an operation.
#[inline(always)]
fn number(result: f32, operands: &[u32]) -> u32 {
    if result.is_nan() {
        return nan(operands);
    }
    result.to_bits()
}

/// Result that is no number: the first NaN operand; signalling ones have priority.
#[cold]
fn nan(operands: &[u32]) -> u32 {
    let signalling = |bits: &&u32| is_nan(**bits) && **bits & QUIET == 0;
    let first = operands.iter().find(signalling);
    let any = || operands.iter().find(|bits| is_nan(**bits));
    first.or_else(any).map_or(NAN, |bits| bits | QUIET)
}

impl Core {
    #[inline(always)]
    pub(super) fn coprocessor(&mut self, first: u16, second: u16, bus: &mut Board) -> Cycles {
        let double = match bits(second, 8, 4) {
            0b1010 => false,
            0b1011 => true,
            _ => return Err(Fault::Undefined),
        };
        self.touch_float()?;
        match (bits(first, 8, 4), bit(second, 4)) {
            (0b1110, false) if !double && !bit(first, 12) => self.arithmetic(first, second),
            (0b1110, true) => self.transfer(first, second, double),
            (0b1100, true) if bits(first, 5, 3) == 0b010 => {
                let m = register(bits(second, 0, 4), bit(second, 5), double);
                let pair = [bits(second, 12, 4), bits(first, 0, 4)];
                if m > 30 {
                    return Err(Fault::Undefined);
                }
                for (number, s) in pair.into_iter().zip(m..) {
                    self.exchange_single(bit(first, 4), number, s);
                }
                Ok(2)
            }
            (0b1100 | 0b1101, _) => self.memory(first, second, double, bus),
            _ => Err(Fault::Undefined),
        }
    }

    /// Loads and stores of one, two or several numbers.
    #[inline(always)]
    fn memory(&mut self, first: u16, second: u16, double: bool, bus: &mut Board) -> Cycles {
        let (before, up) = (bit(first, 8), bit(first, 7));
        let (back, load) = (bit(first, 5), bit(first, 4));
        let (base, number) = (bits(first, 0, 4), bits(second, 0, 8));
        let d = register(bits(second, 12, 4), bit(first, 6), double);
        let (count, from, after) = if before && !back {
            let by = 4 * number as i32;
            let by = if up { by } else { -by };
            let from = self.base(base).wrapping_add_signed(by);
            (1 + usize::from(double), from, None)
        } else if before == up || number == 0 {
            return Err(Fault::Undefined);
        } else {
            let (from, after) = self.range(base, number as u32, before);
            (number, from, back.then_some(after))
        };
        let Some(numbers) = self.s.get_mut(d..d + count) else {
            return Err(Fault::Undefined);
        };
        for (number, at) in numbers.iter_mut().zip((from..).step_by(4)) {
            if load {
                *number = word(bus, at)?;
            } else {
                put(bus, at, *number)?;
            }
        }
        self.back(base, after);
        Ok(1 + count as u32)
    }

    /// Moves a number to a register of the core, or from it.
    fn exchange_single(&mut self, to_core: bool, t: usize, s: usize) {
        if to_core {
            self.set(t, self.s[s]);
        } else {
            self.s[s] = self.r[t];
        }
    }

    fn transfer(&mut self, first: u16, second: u16, double: bool) -> Cycles {
        let (to_core, kind) = (bit(first, 4), bits(first, 5, 3));
        let (t, n) = (bits(second, 12, 4), bits(first, 0, 4));
        let s = match (double, kind) {
            (false, 0) => register(n, bit(second, 7), false),
            (true, 0 | 1) => register(n, bit(second, 7), true) + kind,
            (false, 7) if n == 1 && to_core && t == COUNTER => {
                self.set_flags(self.status);
                return Ok(1);
            }
            _ => return Err(Fault::Undefined),
        };
        if s > 31 {
            return Err(Fault::Undefined);
        }
        self.exchange_single(to_core, t, s);
        Ok(1)
    }

    /// Arithmetic (A6.5). A product is rounded before the addition.
    #[inline(always)]
    fn arithmetic(&mut self, first: u16, second: u16) -> Cycles {
        let d = register(bits(second, 12, 4), bit(first, 6), false);
        let n = register(bits(first, 0, 4), bit(second, 7), false);
        let m = register(bits(second, 0, 4), bit(second, 5), false);
        let numbers = [self.s[d], self.s[n], self.s[m]];
        let [_, one, two] = numbers.map(f32::from_bits);
        let plain = |result: f32| number(result, &numbers[1..]);
        let turned = |number: u32, turns: bool| number ^ u32::from(turns) << 31;
        let target = numbers[0];
        let (value, cycles) = match (bit(first, 7), bits(first, 4, 2), bit(second, 6)) {
            (false, 3, false) => (plain(one + two), 1),
            (false, 3, true) => (plain(one - two), 1),
            (false, kind, turns) => {
                let product = turned(plain(one * two), turns);
                if kind == 2 {
                    (product, 1)
                } else {
                    let target = turned(target, kind == 1);
                    let sum = f32::from_bits(target) + f32::from_bits(product);
                    (number(sum, &[target, product]), 3)
                }
            }
            (true, 0, false) => (plain(one / two), 14),
            (true, 3, false) => {
                let byte = (bits(first, 0, 4) << 4 | bits(second, 0, 4)) as u32;
                let exponent = [0x4000_0000, 0x3e00_0000][(byte >> 6 & 1) as usize];
                ((byte & 0x80) << 24 | exponent | (byte & 0x3f) << 19, 1)
            }
            (true, 3, true) => match (bits(first, 0, 4), bit(second, 7)) {
                (0, false) => (numbers[2], 1),
                (0, true) => (numbers[2] & 0x7fff_ffff, 1),
                (1, false) => (turned(numbers[2], true), 1),
                (1, true) => (number(two.sqrt(), &numbers[2..]), 14),
                (4, _) => return Ok(self.compare(target, numbers[2])),
                (5, _) => return Ok(self.compare(target, 0)),
                (8, true) => ((numbers[2] as i32 as f32).to_bits(), 1),
                (8, false) => ((numbers[2] as f32).to_bits(), 1),
                (12, true) => (two as u32, 1),
                (13, true) => (two as i32 as u32, 1),
                _ => return Err(Fault::Undefined),
            },
            _ => return Err(Fault::Undefined),
        };
        self.s[d] = value;
        Ok(cycles)
    }

    /// Compares; the flags go to FPSCR.
    fn compare(&mut self, one: u32, two: u32) -> u32 {
        let flags = match f32::from_bits(one).partial_cmp(&f32::from_bits(two)) {
            Some(std::cmp::Ordering::Less) => 0b1000,
            Some(std::cmp::Ordering::Equal) => 0b0110,
            Some(std::cmp::Ordering::Greater) => 0b0010,
            None => 0b0011,
        };
        self.status = self.status & 0x0fff_ffff | flags << 28;
        1
    }
}
