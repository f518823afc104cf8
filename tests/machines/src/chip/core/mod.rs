//! Emulator of a Cortex-M4 with its floating-point unit (ARM DDI 0403E, ARMv7E-M and FPv4-SP).
//!
//! It executes one instruction at a time and counts the cycles of the core's manual (ARM DDI 0439B,
//! 3.3, 7.2). The bus adds the memory's wait states. QEMU is the reference for registers, flags and
//! memory: see `tests/tests/core.rs`.
//!
//! Instructions that no image contains are undefined here: most of those on several lanes, fused
//! products, fixed point, supervisor calls. The flags GE, which only these use, are not kept.

mod class;
mod code;
mod decode;
mod exceptions;
mod execute;
mod flat;
mod float;
mod op;

pub use class::Class;
pub use code::Code;
pub use flat::Flat;

/// Memory and peripherals of the core; `None` where an address has neither.
pub trait Bus {
    /// Reads 1, 2 or 4 bytes.
    fn load(&mut self, address: u32, size: u32) -> Option<u32>;
    /// Writes 1, 2 or 4 bytes.
    fn store(&mut self, address: u32, size: u32, value: u32) -> Option<()>;
    /// Fetches two bytes of an instruction.
    fn fetch(&mut self, address: u32) -> Option<u16> {
        self.load(address, 2).map(|half| half as u16)
    }
    /// Called where an instruction lies in another line of 16 bytes than the previous one.
    fn line(&mut self, address: u32) {
        let _ = address;
    }
}

/// Reason for which an instruction was not executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Undefined instruction.
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
    /// A breakpoint instruction.
    Breakpoint,
    /// Invalid exception return.
    Return,
}

/// Event that a core waits for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WaitState {
    /// None.
    #[default]
    Not,
    /// An event.
    Event,
    /// An interrupt.
    Interrupt,
}

/// Register number of the stack pointer.
pub const STACK: usize = 13;
/// Register number of the link register, the return address of a call.
pub const LINK: usize = 14;
/// Register number of the program counter, the address of the next instruction.
pub const COUNTER: usize = 15;

/// Registers and state of the core.
#[derive(Clone, Debug, PartialEq)]
pub struct Core {
    /// r0 to r15; between two instructions r15 is the address of the next.
    pub r: [u32; 16],
    /// s0 to s31 as bits.
    pub s: [u32; 32],
    negative: bool,
    zero: bool,
    carry: bool,
    overflow: bool,
    saturated: bool,
    block: u8,
    /// Whether the current instruction is in an IT block.
    inside: bool,
    status: u32,
    /// PRIMASK.
    pub mask: bool,
    /// FAULTMASK: all but the NMI is masked.
    pub fault_mask: bool,
    /// BASEPRI: this priority and lower ones are masked; 0: none.
    pub base_priority: u8,
    control: u32,
    other_stack: u32,
    /// Number of the active exception; 0: none.
    pub exception: u16,
    /// Whether the floating-point unit is on (CPACR).
    pub float: bool,
    /// The event register.
    pub event: bool,
    /// Event that it waits for.
    pub waits: WaitState,
    /// Whether the chip must check the core: it waits, a mask was cleared, or an exception ends.
    pub attention: bool,
    /// The pending exception return.
    pub returning: Option<u32>,
    /// Number of executed instructions.
    pub instructions: u64,
    exclusive: bool,
    next: u32,
    /// Whether the last instruction was an access: the next one then overlaps with it.
    accessed: bool,
    line: u32,
}

impl Default for Core {
    fn default() -> Self {
        Self {
            r: [0; 16],
            s: [0; 32],
            negative: false,
            zero: false,
            carry: false,
            overflow: false,
            saturated: false,
            block: 0,
            inside: false,
            status: 0,
            mask: false,
            fault_mask: false,
            base_priority: 0,
            control: 0,
            other_stack: 0,
            exception: 0,
            float: false,
            event: false,
            waits: WaitState::Not,
            attention: false,
            returning: None,
            instructions: 0,
            exclusive: false,
            next: 0,
            accessed: false,
            line: u32::MAX,
        }
    }
}

impl Core {
    /// Resets the core: stack pointer and first instruction from the vectors.
    pub fn reset(&mut self, stack: u32, entry: u32) {
        *self = Self {
            instructions: self.instructions,
            ..Self::default()
        };
        self.r[STACK] = stack & !3;
        self.r[LINK] = u32::MAX;
        self.r[COUNTER] = entry & !1;
    }

    /// Continues at another address.
    pub fn set_next_instruction(&mut self, address: u32) {
        self.r[COUNTER] = address & !1;
        self.block = 0;
        self.waits = WaitState::Not;
    }

    /// Executes one instruction and returns its cycles. A fault leaves the registers unchanged,
    /// except those already loaded. `code` caches the decoded instructions.
    #[inline(always)]
    pub fn step(&mut self, code: &mut Code, bus: &mut impl Bus) -> Result<u32, Fault> {
        let address = self.r[COUNTER];
        if address >> 4 != self.line {
            self.line = address >> 4;
            bus.line(address);
        }
        let known = match code.find(address) {
            Some(known) if known.is_unchanged(bus, address) => known,
            _ => code.decode_at(bus, address)?,
        };
        let block = self.block;
        self.inside = block != 0;
        self.instructions += 1;
        if self.inside {
            self.block = if block & 7 == 0 {
                0
            } else {
                block & 0xe0 | block << 1 & 0x1f
            };
            if !self.holds(block >> 4) {
                self.r[COUNTER] = address.wrapping_add(known.size());
                return Ok(1);
            }
        }
        self.next = address.wrapping_add(known.size());
        self.r[COUNTER] = address.wrapping_add(4);
        match self.execute(&known.op, bus) {
            Ok(cycles) => {
                self.r[COUNTER] = self.next;
                Ok(cycles)
            }
            Err(fault) => {
                self.r[COUNTER] = address;
                self.block = block;
                Err(fault)
            }
        }
    }

    /// Whether a condition holds (A7.3).
    #[inline(always)]
    fn holds(&self, condition: u8) -> bool {
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

    /// The program status register, its exception number included (B1.4.2).
    pub fn program_status(&self) -> u32 {
        let bit = |value: bool, at: u32| u32::from(value) << at;
        bit(self.negative, 31)
            | bit(self.zero, 30)
            | bit(self.carry, 29)
            | bit(self.overflow, 28)
            | bit(self.saturated, 27)
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
        self.saturated = word >> 27 & 1 == 1;
    }
}

#[cfg(test)]
mod tests;
