//! The 16-bit instructions that flash loaders are made of (ARM DDI 0403, chapter A7).

use super::Bus;

/// Registers of a core and its condition flags.
#[derive(Clone, Debug, Default)]
pub struct Thumb {
    /// r0 to r15; r15 is the address of the next instruction.
    pub registers: [u32; 16],
    negative: bool,
    zero: bool,
    carry: bool,
    overflow: bool,
}

/// Why a core does not go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// A breakpoint instruction.
    Breakpoint,
    /// An access that no memory answers, or an instruction that is none of these.
    Fault,
}

const STACK: usize = 13;
const LINK: usize = 14;
const COUNTER: usize = 15;

impl Thumb {
    /// Executes one instruction; the address stays where it stopped.
    pub fn step(&mut self, bus: &mut impl Bus) -> Result<(), Stop> {
        let before = self.clone();
        let done = self.execute(bus);
        if done.is_err() {
            *self = before;
        }
        done
    }

    fn execute(&mut self, bus: &mut impl Bus) -> Result<(), Stop> {
        let address = self.registers[COUNTER];
        let code = fetch(bus, address)?;
        self.registers[COUNTER] = address.wrapping_add(2);
        // What an instruction reads as its own address.
        let here = address.wrapping_add(4);
        let bits = |low: u32, count: u32| usize::from((code >> low) & ((1 << count) - 1));
        let (target, source) = (bits(0, 3), bits(3, 3));
        let small = bits(6, 5) as u32;
        let byte = u32::from(code & 0xff);
        match code >> 11 {
            0b00000..=0b00010 => {
                let value = self.shift(code >> 11, self.registers[source], small);
                self.set(target, value);
            }
            0b00011 => {
                let second = bits(6, 3);
                let operand = if bits(10, 1) == 1 {
                    second as u32
                } else {
                    self.registers[second]
                };
                let value = self.add_or_subtract(self.registers[source], operand, bits(9, 1) == 1);
                self.registers[target] = value;
            }
            0b00100..=0b00111 => {
                let target = bits(8, 3);
                let first = self.registers[target];
                match code >> 11 {
                    0b00100 => self.set(target, byte),
                    0b00101 => _ = self.add_or_subtract(first, byte, true),
                    operation => {
                        let value = self.add_or_subtract(first, byte, operation == 0b00111);
                        self.registers[target] = value;
                    }
                }
            }
            0b01000 if bits(10, 1) == 0 => self.combine(bits(6, 4), target, source)?,
            0b01000 => {
                let (target, source) = (target | bits(7, 1) << 3, bits(3, 4));
                let read = |number: usize| match number {
                    COUNTER => here,
                    number => self.registers[number],
                };
                let (first, second) = (read(target), read(source));
                match bits(8, 2) {
                    0b00 => self.registers[target] = first.wrapping_add(second),
                    0b01 => _ = self.add_or_subtract(first, second, true),
                    0b10 => self.registers[target] = second,
                    _ => {
                        if bits(7, 1) == 1 {
                            self.registers[LINK] = address.wrapping_add(2) | 1;
                        }
                        self.registers[COUNTER] = second & !1;
                    }
                }
                self.registers[COUNTER] &= !1;
            }
            0b01001 => {
                let place = (here & !3).wrapping_add(byte * 4);
                self.registers[bits(8, 3)] = load(bus, place, 4)?;
            }
            0b01100..=0b10001 => {
                let size = match code >> 12 {
                    0b0110 => 4,
                    0b0111 => 1,
                    _ => 2,
                };
                let place = self.registers[source].wrapping_add(small * size);
                if bits(11, 1) == 1 {
                    self.registers[target] = load(bus, place, size)?;
                } else {
                    store(bus, place, size, self.registers[target])?;
                }
            }
            0b10010 | 0b10011 => {
                let place = self.registers[STACK].wrapping_add(byte * 4);
                if bits(11, 1) == 1 {
                    self.registers[bits(8, 3)] = load(bus, place, 4)?;
                } else {
                    store(bus, place, 4, self.registers[bits(8, 3)])?;
                }
            }
            0b10100 | 0b10101 => {
                let base = [here & !3, self.registers[STACK]][bits(11, 1)];
                self.registers[bits(8, 3)] = base.wrapping_add(byte * 4);
            }
            0b10110 | 0b10111 => self.others(code, bus)?,
            0b11010 | 0b11011 => {
                let held = self.holds(bits(8, 4)).ok_or(Stop::Fault)?;
                if held {
                    let offset = i32::from(code as u8 as i8) * 2;
                    self.registers[COUNTER] = here.wrapping_add_signed(offset);
                }
            }
            0b11100 => {
                let offset = (i32::from(code) << 21) >> 20;
                self.registers[COUNTER] = here.wrapping_add_signed(offset);
            }
            0b11110 => {
                let second = fetch(bus, address.wrapping_add(2))?;
                if second >> 14 != 0b11 || second >> 12 & 1 == 0 {
                    return Err(Stop::Fault);
                }
                let bit = |value: u16, at: u32| u32::from(value >> at & 1);
                let sign = bit(code, 10);
                let upper = (1 ^ bit(second, 13) ^ sign) << 23 | (1 ^ bit(second, 11) ^ sign) << 22;
                let lower = u32::from(code & 0x3ff) << 12 | u32::from(second & 0x7ff) << 1;
                let offset = ((sign << 24 | upper | lower) << 7) as i32 >> 7;
                self.registers[LINK] = here | 1;
                self.registers[COUNTER] = here.wrapping_add_signed(offset);
            }
            _ => return Err(Stop::Fault),
        }
        Ok(())
    }

    /// Stack, breakpoint and hint.
    fn others(&mut self, code: u16, bus: &mut impl Bus) -> Result<(), Stop> {
        let listed = (0..8).filter(|number| code >> number & 1 == 1);
        let further = code >> 8 & 1 == 1;
        let stack = self.registers[STACK];
        match code >> 8 {
            0xb0 => {
                let offset = u32::from(code & 0x7f) * 4;
                self.registers[STACK] = if code & 0x80 == 0 {
                    stack.wrapping_add(offset)
                } else {
                    stack.wrapping_sub(offset)
                };
            }
            0xb4 | 0xb5 => {
                let saved: Vec<usize> = listed.chain(further.then_some(LINK)).collect();
                let mut place = stack.wrapping_sub(saved.len() as u32 * 4);
                self.registers[STACK] = place;
                for number in saved {
                    store(bus, place, 4, self.registers[number])?;
                    place = place.wrapping_add(4);
                }
            }
            0xbc | 0xbd => {
                let mut place = stack;
                for number in listed.chain(further.then_some(COUNTER)) {
                    self.registers[number] = load(bus, place, 4)?;
                    place = place.wrapping_add(4);
                }
                self.registers[STACK] = place;
                self.registers[COUNTER] &= !1;
            }
            0xbe => return Err(Stop::Breakpoint),
            0xbf if code & 0xff == 0 => {}
            _ => return Err(Stop::Fault),
        }
        Ok(())
    }

    fn combine(&mut self, operation: usize, target: usize, source: usize) -> Result<(), Stop> {
        let (first, second) = (self.registers[target], self.registers[source]);
        match operation {
            0x0 => self.set(target, first & second),
            0x1 => self.set(target, first ^ second),
            0x8 => self.flag(first & second),
            0x9 => {
                let value = self.add_or_subtract(0, second, true);
                self.registers[target] = value;
            }
            0xa => _ = self.add_or_subtract(first, second, true),
            0xb => _ = self.add_or_subtract(first, second, false),
            0xc => self.set(target, first | second),
            0xd => self.set(target, first.wrapping_mul(second)),
            0xe => self.set(target, first & !second),
            0xf => self.set(target, !second),
            _ => return Err(Stop::Fault),
        }
        Ok(())
    }

    /// Left, right, right with the sign; by 0 is by 32 to the right, and no shift to the left.
    fn shift(&mut self, operation: u16, value: u32, by: u32) -> u32 {
        let wide = i64::from(value);
        let (result, carry) = match (operation, by) {
            (0, 0) => return value,
            (0, by) => (value << by, value >> (32 - by) & 1),
            (1, by) => {
                let by = if by == 0 { 32 } else { by };
                ((wide >> by) as u32, (wide >> (by - 1)) as u32 & 1)
            }
            (_, by) => {
                let (by, wide) = (if by == 0 { 32 } else { by }, i64::from(value as i32));
                ((wide >> by) as u32, (wide >> (by - 1)) as u32 & 1)
            }
        };
        self.carry = carry == 1;
        result
    }

    fn add_or_subtract(&mut self, first: u32, second: u32, subtract: bool) -> u32 {
        let second = if subtract { !second } else { second };
        let sum = u64::from(first) + u64::from(second) + u64::from(subtract);
        let value = sum as u32;
        self.carry = sum >> 32 == 1;
        self.overflow = (first ^ value) & (second ^ value) & 0x8000_0000 != 0;
        self.flag(value);
        value
    }

    fn set(&mut self, target: usize, value: u32) {
        self.registers[target] = value;
        self.flag(value);
    }

    fn flag(&mut self, value: u32) {
        self.negative = value as i32 <= -1;
        self.zero = value == 0;
    }

    fn holds(&self, condition: usize) -> Option<bool> {
        let held = match condition >> 1 {
            0 => self.zero,
            1 => self.carry,
            2 => self.negative,
            3 => self.overflow,
            4 => self.carry && !self.zero,
            5 => self.negative == self.overflow,
            6 => !self.zero && self.negative == self.overflow,
            _ => return None,
        };
        Some(held != (condition & 1 == 1))
    }
}

fn fetch(bus: &mut impl Bus, address: u32) -> Result<u16, Stop> {
    load(bus, address, 2).map(|code| code as u16)
}

fn load(bus: &mut impl Bus, address: u32, size: u32) -> Result<u32, Stop> {
    bus.load(address, size).ok_or(Stop::Fault)
}

fn store(bus: &mut impl Bus, address: u32, size: u32, value: u32) -> Result<(), Stop> {
    bus.store(address, size, value).ok_or(Stop::Fault)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Words(Vec<u8>);

    impl Bus for Words {
        fn load(&mut self, address: u32, size: u32) -> Option<u32> {
            let bytes = self.0.get(address as usize..(address + size) as usize)?;
            Some(
                bytes
                    .iter()
                    .rev()
                    .fold(0, |word, byte| word << 8 | u32::from(*byte)),
            )
        }

        fn store(&mut self, address: u32, size: u32, value: u32) -> Option<()> {
            let place = self
                .0
                .get_mut(address as usize..(address + size) as usize)?;
            place.copy_from_slice(&value.to_le_bytes()[..size as usize]);
            Some(())
        }
    }

    /// Runs code at 0, its stack at 256, up to its breakpoint.
    fn run(code: &[u16], registers: &[u32]) -> Thumb {
        let mut bus = Words(vec![0; 256]);
        for (place, half) in bus.0.chunks_exact_mut(2).zip(code) {
            place.copy_from_slice(&half.to_le_bytes());
        }
        let mut core = Thumb::default();
        core.registers[..registers.len()].copy_from_slice(registers);
        core.registers[STACK] = 256;
        for _ in 0..1000 {
            if let Err(stop) = core.step(&mut bus) {
                assert_eq!(stop, Stop::Breakpoint, "at {:#x}", core.registers[COUNTER]);
                return core;
            }
        }
        panic!("no end");
    }

    #[test]
    fn a_loop_with_a_call_gives_the_sum_of_squares() {
        // r1 = sum of r0^2 .. 1^2
        let code = [
            0x2100, // movs r1, #0
            0xf000, 0xf803, // bl square
            0x3801, // subs r0, #1
            0xd1fb, // bne -> bl
            0xbe00, // bkpt
            0xb510, // square: push {r4, lr}
            0x0004, // movs r4, r0
            0x4344, // muls r4, r0
            0x1909, // adds r1, r1, r4
            0xbd10, // pop {r4, pc}
        ];
        let core = run(&code, &[7, 0, 0, 0, 0x55]);
        assert_eq!(core.registers[1], 140);
        assert_eq!((core.registers[4], core.registers[STACK]), (0x55, 256));
    }

    #[test]
    fn flags_follow_the_manual_at_the_edges() {
        // (r0, r1) compared: eq, hs, mi, vs, hi, ge, gt
        let edges = [0, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff];
        for first in edges {
            for second in edges {
                let core = run(&[0x4288, 0xbe00], &[first, second]);
                let (left, right) = (first as i32, second as i32);
                let (difference, overflow) = left.overflowing_sub(right);
                let expected = [
                    first == second,
                    first >= second,
                    difference < 0,
                    overflow,
                    first > second,
                    left >= right,
                    left > right,
                ];
                for (condition, expected) in expected.into_iter().enumerate() {
                    let held = [core.holds(2 * condition), core.holds(2 * condition + 1)];
                    assert_eq!(held, [Some(expected), Some(!expected)]);
                }
            }
        }
    }

    #[test]
    fn shifts_have_their_carries() {
        // lsrs r0, r0, #32; asrs; lsls #1
        for (code, value, result, carry) in [
            (0x0800, 0x8000_0000_u32, 0, true),
            (0x1000, 0x8000_0000, 0xffff_ffff, true),
            (0x0040, 0x8000_0001, 2, true),
            (0x0880, 0b110, 1, true),
            (0x0880, 0b101, 1, false),
        ] {
            let core = run(&[code, 0xbe00], &[value]);
            assert_eq!(
                (core.registers[0], core.carry),
                (result, carry),
                "{code:#x}"
            );
        }
    }

    #[test]
    fn what_is_no_memory_and_no_such_instruction_is_a_fault() {
        for code in [[0x6808_u16, 0], [0xe800, 0xbe00], [0xde00, 0xbe00]] {
            let mut bus = Words(vec![0; 64]);
            bus.0[..2].copy_from_slice(&code[0].to_le_bytes());
            let mut core = Thumb::default();
            core.registers[1] = 0xffff_0000;
            assert_eq!(core.step(&mut bus), Err(Stop::Fault), "{:#x}", code[0]);
            assert_eq!(core.registers[COUNTER], 0);
        }
    }
}
