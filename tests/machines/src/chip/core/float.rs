//! Single precision of the FPv4-SP: rounding to nearest, subnormal numbers kept (ARM DDI 0403E,
//! A2.5). A NaN that no operand supplies has no sign.

use super::Core;
use super::op::{Single, Unary};

/// NaN that an operation on numbers returns.
const NAN: u32 = 0x7fc0_0000;
/// Bit that makes a NaN a quiet one.
const QUIET: u32 = 0x0040_0000;
/// FPSCR bit: operations on NaN return the default NaN.
const DEFAULT_NAN: u32 = 1 << 25;

fn is_nan(bits: u32) -> bool {
    bits & 0x7fff_ffff > 0x7f80_0000
}

impl Core {
    /// Result of an operation. A NaN is the first NaN operand, signalling ones first.
    fn number(&self, result: f32, operands: &[u32]) -> u32 {
        if !result.is_nan() {
            return result.to_bits();
        }
        if self.status & DEFAULT_NAN != 0 {
            return NAN;
        }
        let signalling = |bits: &&u32| is_nan(**bits) && **bits & QUIET == 0;
        let first = operands.iter().find(signalling);
        let any = || operands.iter().find(|bits| is_nan(**bits));
        first.or_else(any).map_or(NAN, |bits| bits | QUIET)
    }

    /// Two operands and the target.
    pub(super) fn single(&mut self, operation: Single, d: u8, n: u8, m: u8) -> u32 {
        let [d, n, m] = [d, n, m].map(usize::from);
        let bits = [self.s[d], self.s[n], self.s[m]];
        let [_, one, two] = bits.map(f32::from_bits);
        let plain = |result: f32| self.number(result, &bits[1..]);
        let turned = |bits: u32| bits ^ 0x8000_0000;
        let sum = |product: u32, target: u32| {
            let result = f32::from_bits(target) + f32::from_bits(product);
            self.number(result, &[target, product])
        };
        let product = plain(one * two);
        let (value, cycles) = match operation {
            Single::Add => (plain(one + two), 1),
            Single::Subtract => (plain(one - two), 1),
            Single::Multiply => (product, 1),
            Single::NegativeMultiply => (turned(product), 1),
            Single::Divide => (plain(one / two), 14),
            Single::MultiplyAdd => (sum(product, bits[0]), 3),
            Single::MultiplySubtract => (sum(turned(product), bits[0]), 3),
            Single::NegativeMultiplySubtract => (sum(product, turned(bits[0])), 3),
            Single::NegativeMultiplyAdd => (sum(turned(product), turned(bits[0])), 3),
        };
        self.s[d] = value;
        cycles
    }

    pub(super) fn unary(&mut self, operation: Unary, d: u8, m: u8) -> u32 {
        let bits = self.s[usize::from(m)];
        let value = f32::from_bits(bits);
        let (result, cycles) = match operation {
            Unary::Move => (bits, 1),
            Unary::Absolute => (bits & 0x7fff_ffff, 1),
            Unary::Negate => (bits ^ 0x8000_0000, 1),
            Unary::Root => (self.number(value.sqrt(), &[bits]), 14),
            Unary::FromSigned => ((bits as i32 as f32).to_bits(), 1),
            Unary::FromUnsigned => ((bits as f32).to_bits(), 1),
            Unary::ToSigned => (value as i32 as u32, 1),
            Unary::ToUnsigned => (value as u32, 1),
        };
        self.s[usize::from(d)] = result;
        cycles
    }

    /// Compares; the flags go to FPSCR.
    pub(super) fn compare(&mut self, d: u8, m: u8) {
        let one = f32::from_bits(self.s[usize::from(d)]);
        let two = self
            .s
            .get(usize::from(m))
            .map_or(0.0, |bits| f32::from_bits(*bits));
        let flags = match one.partial_cmp(&two) {
            Some(std::cmp::Ordering::Less) => 0b1000,
            Some(std::cmp::Ordering::Equal) => 0b0110,
            Some(std::cmp::Ordering::Greater) => 0b0010,
            None => 0b0011,
        };
        self.status = self.status & 0x0fff_ffff | flags << 28;
    }
}
