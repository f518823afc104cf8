//! Emulator of a Cortex-M4 with its floating-point unit (ARM DDI 0403E, ARMv7E-M and FPv4-SP).
//!
//! It executes one instruction at a time and counts the cycles of the core's manual (ARM DDI 0439B,
//! 3.3, 7.2). The bus adds the memory's wait states. It gives orbits the bits of the desk and of QEMU:
//! see `tests/tests/kernels.rs`.
//!
//! Instructions that no image contains are undefined here: most of those on several lanes, fused
//! products, fixed point, supervisor calls. Of the special registers it has those that
//! the images use: flags without Q and GE, exception number, main stack, PRIMASK and CONTROL.

mod exceptions;
mod float;
mod memory;
mod narrow;
mod table;
mod wide;

use super::Board;

/// Reason for which an instruction was not executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    Undefined,
    /// Branch to an address without Thumb code.
    State,
    /// Access to this address, which has no memory.
    Access(u32),
    /// Fetch from an address without memory.
    Fetch,
    /// Unaligned access that must be aligned.
    Unaligned,
    /// The floating-point unit is off.
    NoCoprocessor,
    Breakpoint,
    /// Invalid exception return.
    Return,
}

/// Cycles of an instruction, or the reason why it was not executed.
type Cycles = Result<u32, Fault>;

/// Cycles to refill the pipeline after a branch: 1 to 3 by alignment (ARM DDI 0439B, 3.3.1).
const REFILL: u32 = 2;
/// First halfword from which an instruction has two (A5.1).
const WIDE: u16 = 0xe800;
/// Register number for "no target".
const NONE: usize = 16;
/// Address / 16 of no line.
pub const NO_LINE: u32 = u32::MAX;
/// Register number of the stack pointer.
pub const STACK: usize = 13;
/// Register number of the link register, the return address of a call.
pub const LINK: usize = 14;
/// Register number of the program counter, the address of the next instruction.
pub const COUNTER: usize = 15;

#[derive(Clone, Debug, Default)]
pub struct Core {
    /// r0 to r15; between two instructions r15 is the address of the next.
    pub r: [u32; 16],
    /// s0 to s31 as bits.
    pub s: [u32; 32],
    negative: bool,
    zero: bool,
    carry: bool,
    overflow: bool,
    block: u8,
    /// Whether the current instruction is in an IT block.
    inside: bool,
    status: u32,
    /// PRIMASK.
    pub mask: bool,
    control: u32,
    /// Number of the active exception; 0: none.
    pub exception: u16,
    /// Whether the floating-point unit is on (CPACR).
    pub float: bool,
    pub event: bool,
    /// Whether the core waits for an event.
    pub waits: bool,
    /// Whether the chip must check the core: it waits, a mask was cleared, or an exception ends.
    pub attention: bool,
    pub returning: Option<u32>,
    pub instructions: u64,
    exclusive: bool,
    /// Whether this instruction and the previous one were memory accesses, which overlap.
    accessed: bool,
    overlaps: bool,
    line: u32,
}

impl Core {
    /// Resets the core: stack pointer and first instruction from the vectors.
    pub fn reset(&mut self, stack: u32, entry: u32) {
        *self = Self {
            instructions: self.instructions,
            line: NO_LINE,
            ..Self::default()
        };
        self.r[STACK] = stack & !3;
        self.r[LINK] = u32::MAX;
        self.r[COUNTER] = entry & !1;
    }

    pub fn set_next_instruction(&mut self, address: u32) {
        self.r[COUNTER] = address & !1;
        self.block = 0;
        self.waits = false;
    }

    /// Executes one instruction and returns its cycles. A fault leaves the registers unchanged,
    /// except those already loaded. Meanwhile r15 is the address of the next instruction.
    #[inline(always)]
    pub fn step(&mut self, bus: &mut Board) -> Cycles {
        let address = self.r[COUNTER];
        if address >> 4 != bus.fetched {
            self.enter_line(address, bus);
        }
        let code = match bus.fetch_both(address) {
            Some(code) if address >> 4 == bus.fetched => code,
            _ => fetch(bus, address)?,
        };
        self.instructions += 1;
        if self.block != 0 {
            return self.step_in_block(address, code, bus);
        }
        self.execute(address, code, bus)
    }

    /// Fetches the line of an address.
    #[inline(always)]
    fn enter_line(&mut self, address: u32, bus: &mut Board) {
        let line = address >> 4;
        if line != self.line {
            self.line = line;
            bus.line(address);
        }
        bus.fetched = if bus.is_idle() { line } else { NO_LINE };
    }

    /// Executes an instruction with the function of its upper bits.
    #[inline(always)]
    fn execute(&mut self, address: u32, code: u32, bus: &mut Board) -> Cycles {
        self.overlaps = std::mem::take(&mut self.accessed);
        let executed = table::RUN[(code >> 4 & 0xfff) as usize](self, code, bus);
        if executed.is_err() {
            self.r[COUNTER] = address;
        }
        executed
    }

    /// Executes an instruction in an IT block, if its condition holds.
    #[inline(never)]
    fn step_in_block(&mut self, address: u32, code: u32, bus: &mut Board) -> Cycles {
        let block = self.block;
        let rest = block & 0xe0 | block << 1 & 0x1f;
        self.block = if block & 7 == 0 { 0 } else { rest };
        if !self.holds(usize::from(block >> 4)) {
            let size = if code as u16 >= WIDE { 4 } else { 2 };
            self.r[COUNTER] = address.wrapping_add(size);
            return Ok(1);
        }
        self.inside = true;
        let executed = self.execute(address, code, bus);
        self.inside = false;
        if executed.is_err() {
            self.block = block;
        }
        executed
    }

    /// Sets a register; setting the program counter branches.
    #[inline]
    fn set(&mut self, number: usize, value: u32) -> u32 {
        if number == COUNTER {
            self.r[COUNTER] = value & !1;
            return 1 + REFILL;
        }
        self.r[number] = value;
        1
    }

    #[inline]
    fn branch(&mut self, taken: bool, by: i32) -> u32 {
        if taken {
            self.r[COUNTER] = self.r[COUNTER].wrapping_add_signed(by);
            return 1 + REFILL;
        }
        1
    }

    /// A branch that may leave an exception.
    fn exchange(&mut self, value: u32) -> Result<(), Fault> {
        if value >> 28 == 0xf && self.exception != 0 {
            self.returning = Some(value);
            self.attention = true;
        } else if value & 1 == 0 {
            return Err(Fault::State);
        }
        self.r[COUNTER] = value & !1;
        Ok(())
    }

    fn sign(&mut self, value: u32) {
        self.negative = value >> 31 == 1;
        self.zero = value == 0;
    }

    #[inline]
    fn sum(&mut self, set: bool, one: u32, two: u32, carry: bool) -> u32 {
        let wide = u64::from(one) + u64::from(two) + u64::from(carry);
        let value = wide as u32;
        if set {
            self.carry = wide >> 32 == 1;
            self.overflow = (one ^ value) & (two ^ value) & 0x8000_0000 != 0;
            self.sign(value);
        }
        value
    }

    /// Arithmetic and logic by the operation's code (A5.3.1), with the second operand and the carry
    /// of its shift. Without a destination register it only sets flags.
    #[inline(always)]
    fn data(
        &mut self,
        operation: usize,
        set: bool,
        d: usize,
        one: u32,
        (two, carry): (u32, bool),
    ) -> Cycles {
        let value = match operation {
            0 => one & two,
            1 => one & !two,
            2 => one | two,
            3 => one | !two,
            4 => one ^ two,
            8 => self.sum(set, one, two, false),
            10 => self.sum(set, one, two, self.carry),
            11 => self.sum(set, one, !two, self.carry),
            13 => self.sum(set, one, !two, true),
            14 => self.sum(set, !one, two, true),
            _ => return Err(Fault::Undefined),
        };
        if set && operation < 8 {
            self.carry = carry;
            self.sign(value);
        }
        Ok(if d == NONE { 1 } else { self.set(d, value) })
    }

    /// A shifted value and the carry. Kinds: left (0), right (1), arithmetic right (2), rotate
    /// right (3), which rotates by one bit through the carry if `by` is 0.
    fn shifted(&self, value: u32, kind: usize, by: u32) -> (u32, bool) {
        let out = |shifted: u32| shifted & 1 == 1;
        match (kind, by) {
            (3, 0) => (value >> 1 | u32::from(self.carry) << 31, out(value)),
            (_, 0) => (value, self.carry),
            (0, 1..=31) => (value << by, out(value >> (32 - by))),
            (0, 32) => (0, out(value)),
            (1, 1..=31) => (value >> by, out(value >> (by - 1))),
            (1, 32) => (0, value >> 31 == 1),
            (0 | 1, _) => (0, false),
            (2, by) => {
                let value = i64::from(value as i32) >> (by.min(32) - 1);
                ((value >> 1) as u32, out(value as u32))
            }
            _ => {
                let value = value.rotate_right(by & 31);
                (value, value >> 31 == 1)
            }
        }
    }

    /// A register shifted by an immediate number (A7.4.2).
    #[inline(always)]
    fn operand(&self, register: usize, kind: usize, by: usize) -> (u32, bool) {
        let by = match (kind, by) {
            (1 | 2, 0) => 32,
            (_, by) => by as u32,
        };
        self.shifted(self.r[register], kind, by)
    }

    fn shift_by(&mut self, kind: usize, set: bool, d: usize, n: usize, m: usize) -> u32 {
        let by = self.r[m] & 0xff;
        let (value, carry) = match by {
            0 => (self.r[n], self.carry),
            by => self.shifted(self.r[n], kind, by),
        };
        if set {
            self.carry = carry;
            self.sign(value);
        }
        self.set(d, value)
    }

    /// Hints (A5.2.5, A5.3.4).
    fn hint(&mut self, number: usize) -> u32 {
        match number {
            2 if !std::mem::take(&mut self.event) => {
                self.waits = true;
                self.attention = true;
            }
            4 => self.event = true,
            _ => {}
        }
        1
    }

    /// Whether a condition holds (A7.3).
    #[inline(always)]
    fn holds(&self, condition: usize) -> bool {
        let held = match condition >> 1 {
            0 => self.zero,
            1 => self.carry,
            2 => self.negative,
            3 => self.overflow,
            4 => self.carry && !self.zero,
            5 => self.negative == self.overflow,
            6 => !self.zero && self.negative == self.overflow,
            _ => return true,
        };
        held != (condition & 1 == 1)
    }

    /// The program status register with its exception number (B1.4.2).
    pub fn program_status(&self) -> u32 {
        let bit = |value: bool, at: u32| u32::from(value) << at;
        bit(self.negative, 31)
            | bit(self.zero, 30)
            | bit(self.carry, 29)
            | bit(self.overflow, 28)
            | u32::from(self.block & 3) << 25
            | 1 << 24
            | u32::from(self.block >> 2) << 10
            | u32::from(self.exception)
    }

    fn set_flags(&mut self, word: u32) {
        self.negative = word >> 31 & 1 == 1;
        self.zero = word >> 30 & 1 == 1;
        self.carry = word >> 29 & 1 == 1;
        self.overflow = word >> 28 & 1 == 1;
    }
}

/// Bits of a halfword: `count` from `low` on.
#[inline]
fn bits(code: u16, low: u32, count: u32) -> usize {
    usize::from(code >> low & ((1 << count) - 1))
}

#[inline]
fn bit(code: u16, at: u32) -> bool {
    code >> at & 1 == 1
}

/// Sign-extends a number of `count` bits.
fn signed(value: u32, count: u32) -> i32 {
    (value << (32 - count)) as i32 >> (32 - count)
}

/// Two halfwords of code from anywhere, the second one if the instruction has it.
#[cold]
fn fetch(bus: &mut Board, address: u32) -> Result<u32, Fault> {
    let first = bus.fetch(address).ok_or(Fault::Fetch)?;
    let second = if first < WIDE {
        0
    } else {
        bus.fetch(address.wrapping_add(2)).ok_or(Fault::Fetch)?
    };
    Ok(u32::from(second) << 16 | u32::from(first))
}
