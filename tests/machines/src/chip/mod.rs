//! Emulator of an STM32F405RG or STM32G474RE with its bridge, for a debug probe and for the machine
//! around it.
//!
//! The core executes the flash's content, or a probe's code in RAM. The peripherals, one per file,
//! follow the reference manuals (RM0090, RM0440). Electrical properties, and behaviour undefined by
//! the manual, need tests on silicon.

mod board;
mod bridge;
mod check;
pub mod clocks;
mod converter;
pub mod core;
pub mod flash;
pub mod gpio;
pub mod kind;
mod power;
mod serial;
mod system;
mod voltage;
mod watchdog;
pub mod world;

use self::core::{COUNTER, Core, Fault, NO_LINE, STACK};
pub use board::{Board, MEMORY};
use clocks::{Cause, TICKS};
use kind::Kind;
use system::HARD_FAULT;

/// Registers of the core for a debugger (ARM DDI 0403E, C1.6).
const RESET: u32 = 0xe000_ed0c;
const WHY_HALTED: u32 = 0xe000_ed30;
const HALTING: u32 = 0xe000_edf0;
const SELECT: u32 = 0xe000_edf4;
const TRANSFER: u32 = 0xe000_edf8;
const BREAKPOINTS: u32 = 0xe000_2000;
/// Bits of the halting register.
const DEBUG: u32 = 1;
const HALT: u32 = 1 << 1;
const STEP: u32 = 1 << 2;
const READY: u32 = 1 << 16;
const HALTED: u32 = 1 << 17;
const LOCKED_UP: u32 = 1 << 19;
const WAS_RESET: u32 = 1 << 25;
/// Largest number of instructions of a loader before it counts as stuck.
const MAX_LOADER_INSTRUCTIONS: u64 = 60_000_000;
/// Duration of a probe's access, ticks: 20 us.
const ACCESS_TICKS: u64 = TICKS / 50_000;

/// Cycles of the core between two samples.
pub const DEADLINE: u64 = 8400;
/// Exception number of the converter.
pub const SAMPLE: u16 = 16 + 18;
/// Exception number of the link's port, USART2.
pub const LINK: u16 = 16 + 38;
/// Exception number of SysTick, the millisecond clock.
pub const MILLISECOND: u16 = 15;
const EXCEPTIONS: usize = 16 + 82;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Runs {
    Halted,
    /// Executes the memory's content.
    Core,
    /// Runs an unspecified older firmware that keeps driving the bridge.
    Unknown,
    /// Stopped for good: no code at the address, or a fault within a fault.
    Stopped,
}

/// Run time of an exception's handler in core cycles, including handlers that preempt it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Handler {
    pub count: u64,
    pub longest: u64,
    entered: u64,
}

#[derive(Clone, Debug)]
pub struct Chip {
    /// Whether the bridge was driven while a debugger changed the flash or ran a loader.
    pub driven_while_halted: bool,
    pub was_halted: bool,
    pub board: Board,
    pub core: Core,
    runs: Runs,
    /// Whether it still runs the unspecified older firmware.
    older: bool,
    /// Address of the first instruction after the last reset.
    entry: u32,
    halting: u32,
    why: u32,
    transfer: u32,
    was_reset: bool,
    /// Whether the supply fell below the RAM's retention voltage.
    power_lost: bool,
    handlers: [Handler; EXCEPTIONS],
    /// How the program hangs; interrupts with a higher priority still run.
    pub hangs: Option<Hang>,
}

/// Ways in which a program hangs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hang {
    /// The thread stops advancing; interrupts run.
    Thread,
    /// The sample interrupt's handler stops advancing once entered.
    Samples,
    Everything,
}

impl Default for Chip {
    fn default() -> Self {
        Self::new(Kind::default())
    }
}

impl Chip {
    /// Builds a chip that runs an unspecified older firmware.
    pub fn new(kind: Kind) -> Self {
        let mut board = Board::new(kind);
        board.bridge.switch_on();
        Self {
            driven_while_halted: false,
            was_halted: false,
            board,
            core: Core::default(),
            runs: Runs::Unknown,
            older: true,
            entry: 0,
            halting: 0,
            why: 0,
            transfer: 0,
            was_reset: false,
            power_lost: false,
            handlers: [Handler::default(); EXCEPTIONS],
            hangs: None,
        }
    }

    /// Run times of an exception's handler since they were last cleared.
    ///
    /// # Panics
    /// The chip has no such exception.
    pub fn handler(&self, exception: u16) -> Handler {
        self.handlers[usize::from(exception)]
    }

    /// Clears the handlers' run times; a running handler keeps its start.
    pub fn forget_handlers(&mut self) {
        for handler in &mut self.handlers {
            *handler = Handler {
                entered: handler.entered,
                ..Handler::default()
            };
        }
    }

    pub fn flash(&self) -> &[u8] {
        &self.board.flash.bytes
    }

    pub fn flash_mut(&mut self) -> &mut [u8] {
        &mut self.board.flash.bytes
    }

    /// Number of words programmed and sectors erased.
    pub fn operations(&self) -> u64 {
        self.board.flash.operations
    }

    /// Whether the bridge is driven; only its main output enable opens it.
    pub fn is_driven(&self) -> bool {
        self.board.supplied && self.board.bridge.enabled()
    }

    /// Entry address of the running firmware; `None` if none runs.
    pub fn running(&self) -> Option<u32> {
        let runs = matches!(self.runs, Runs::Core | Runs::Unknown);
        (self.is_supplied() && runs).then_some(self.entry)
    }

    /// Switches the supply on. The RAM contains noise, and any firmware in the flash starts.
    pub fn power_on(&mut self) {
        self.board.supplied = true;
        self.board.scramble(self.board.now | 1);
        self.halting = 0;
        self.reset(Cause::Power);
    }

    /// Restores the supply from below the brown-out level or the RAM's retention voltage.
    pub fn supply_returns(&mut self) {
        if std::mem::take(&mut self.power_lost) {
            self.power_on();
        } else {
            self.board.supplied = true;
            self.reset(Cause::BrownOut);
        }
    }

    pub fn power_off(&mut self) {
        self.board.supplied = false;
        self.board.flash.supply_goes(self.board.now);
        self.board.bridge.reset();
        self.board.voltage = Default::default();
        self.board.refresh();
    }

    /// Reads bytes as a probe does; `None` if an address has no memory.
    pub fn read(&mut self, address: u32, bytes: &mut [u8]) -> Option<()> {
        self.run_between_accesses()?;
        // The core's memory protection does not stop a probe.
        let protection = std::mem::take(&mut self.board.system.protection);
        let read = self.load(address, bytes);
        self.board.system.protection = protection;
        read
    }

    fn load(&mut self, address: u32, bytes: &mut [u8]) -> Option<()> {
        let size = width(address, bytes.len());
        for (index, part) in bytes.chunks_exact_mut(size).enumerate() {
            let place = address.checked_add((index * size) as u32)?;
            let own = self.own(place);
            let value = own.or_else(|| self.board.load(place, size as u32))?;
            part.copy_from_slice(&value.to_le_bytes()[..size]);
        }
        self.board.stall = 0;
        Some(())
    }

    /// Writes bytes as a probe does, `size` at a time.
    pub fn write(&mut self, address: u32, size: usize, bytes: &[u8]) -> Option<()> {
        self.run_between_accesses()?;
        let before = self.board.flash.operations;
        for (index, part) in bytes.chunks_exact(size).enumerate() {
            let place = address.checked_add((index * size) as u32)?;
            let mut word = [0; 4];
            word[..size].copy_from_slice(part);
            let value = u32::from_le_bytes(word);
            if !self.set_own(place, value) {
                self.board.store(place, size as u32, value)?;
            }
        }
        self.driven_while_halted |= self.board.flash.operations != before && self.is_driven();
        self.run_between_accesses()
    }

    fn is_supplied(&self) -> bool {
        self.board.supplied && self.board.reset != Some(Cause::Power)
    }

    fn run_between_accesses(&mut self) -> Option<()> {
        if !self.is_supplied() {
            return None;
        }
        match self.runs {
            Runs::Unknown if !self.was_reset => self.board.bridge.switch_on(),
            Runs::Unknown => {}
            Runs::Halted | Runs::Stopped | Runs::Core => self.run(self.board.now + ACCESS_TICKS),
        }
        Some(())
    }

    pub fn run_for(&mut self, time: std::time::Duration) {
        if self.runs == Runs::Core && self.is_supplied() {
            let passed = (time.as_secs_f64() * TICKS as f64) as u64;
            self.run(self.board.now + passed);
        }
    }

    fn own(&mut self, address: u32) -> Option<u32> {
        Some(match address {
            BREAKPOINTS => 0x260,
            WHY_HALTED => self.why,
            TRANSFER => self.transfer,
            HALTING => {
                let mut value = self.halting | READY;
                if self.halting & DEBUG != 0 {
                    value |= match self.runs {
                        Runs::Halted => HALTED,
                        Runs::Stopped => LOCKED_UP,
                        Runs::Core | Runs::Unknown => 0,
                    };
                }
                if std::mem::take(&mut self.was_reset) {
                    value |= WAS_RESET;
                }
                value
            }
            _ => return None,
        })
    }

    /// Writes a debug register of the core; returns whether the address is one.
    fn set_own(&mut self, address: u32, value: u32) -> bool {
        match address {
            HALTING if value >> 16 == 0xa05f => self.halt(value & 0xffff),
            SELECT => self.select(value),
            TRANSFER => self.transfer = value,
            RESET if value >> 16 == 0x05fa && value & 4 != 0 => self.reset(Cause::Software),
            WHY_HALTED => self.why &= !value,
            _ => return false,
        }
        true
    }

    /// Transfers a core register to or from the debug transfer register.
    fn select(&mut self, value: u32) {
        // The model has one stack pointer for both.
        let number = match value & 0x7f {
            17 | 18 => STACK,
            number => number as usize,
        };
        // The address of the next instruction has no Thumb bit.
        let mask = if number == COUNTER { !1 } else { !0 };
        match (self.core.r.get_mut(number), value >> 16 & 1) {
            (Some(register), 1) => *register = self.transfer & mask,
            (Some(register), _) => self.transfer = *register,
            (None, 0) => self.transfer = 0x0100_0000,
            (None, _) => {}
        }
    }

    fn halt(&mut self, control: u32) {
        self.halting = control;
        let requested = control & (DEBUG | HALT | STEP);
        if requested & DEBUG == 0 {
            if self.runs == Runs::Halted {
                self.resume();
            }
            return;
        }
        if requested & HALT != 0 {
            self.stop(1);
        } else if self.runs == Runs::Halted {
            self.resume();
            let unknown = self.runs == Runs::Unknown;
            if requested & STEP != 0 {
                if !unknown {
                    self.steps(1);
                }
                if matches!(self.runs, Runs::Core | Runs::Unknown) {
                    self.stop(1);
                }
            } else if !unknown && self.core.r[COUNTER] >= MEMORY {
                // A loader: the probe waits for its end.
                self.steps(MAX_LOADER_INSTRUCTIONS);
            }
        }
    }

    fn resume(&mut self) {
        let loader = self.core.r[COUNTER] >= MEMORY;
        self.driven_while_halted |= loader && self.is_driven();
        let older = self.older && !loader;
        self.runs = if older { Runs::Unknown } else { Runs::Core };
        self.board.halted = false;
        self.core.waits = false;
        self.board.refresh();
    }

    /// Executes up to `max_steps` instructions, or to a breakpoint.
    fn steps(&mut self, max_steps: u64) {
        let end = self.core.instructions + max_steps;
        while self.runs == Runs::Core && self.core.instructions < end {
            if !self.is_supplied() {
                return;
            }
            self.board.fetched = NO_LINE;
            self.step(self.is_hung());
            self.board.run_due();
            self.handle_exceptions();
        }
        if max_steps > 1 && self.runs == Runs::Core && self.core.instructions >= end {
            self.runs = Runs::Stopped;
        }
    }

    fn stop(&mut self, why: u32) {
        self.runs = Runs::Halted;
        self.was_halted = true;
        self.board.halted = true;
        self.board.refresh();
        self.why |= why;
    }

    /// Halts the core by a debugger, in any state.
    pub fn debugger_halts(&mut self) {
        self.halting |= DEBUG | HALT;
        self.stop(1);
    }

    pub fn reset(&mut self, cause: Cause) {
        self.was_reset = true;
        self.older = false;
        self.board.halted = false;
        self.board.reset(cause);
        self.hangs = None;
        let (words, _) = self.board.flash.bytes.as_chunks();
        let [stack, entry] = [words[0], words[1]].map(u32::from_le_bytes);
        self.core.reset(stack, entry);
        self.entry = entry & !1;
        let starts = flash::RANGE.contains(&entry) && entry & 1 == 1;
        self.runs = if starts { Runs::Core } else { Runs::Stopped };
        if self.halting & DEBUG != 0 && self.board.system.debug & 1 != 0 {
            self.stop(8);
        }
    }

    pub fn run(&mut self, until: u64) {
        while self.board.now < until {
            if let Some(cause) = self.board.reset {
                self.resets(cause);
            } else if !self.board.supplied || self.board.cycle == 0 || self.runs == Runs::Stopped {
                self.board.pass(until);
            } else if self.runs == Runs::Halted {
                self.board.pass_halted(until);
            } else if self.core.waits {
                self.sleeps(until);
            } else {
                self.stretch(until);
            }
        }
        self.board.run_due();
    }

    fn stretch(&mut self, until: u64) {
        let limit = until.min(self.board.next);
        // Others than the core may have worked on the flash.
        self.board.fetched = NO_LINE;
        let hung = self.is_hung();
        while self.board.now < limit {
            self.step(hung);
            if self.core.attention || self.board.attention {
                break;
            }
        }
        self.board.run_due();
        self.handle_exceptions();
    }

    #[inline(always)]
    fn step(&mut self, hung: bool) {
        if hung {
            self.core.instructions += 1;
            self.board.spend(3);
            return;
        }
        match self.core.step(&mut self.board) {
            Ok(cycles) => self.board.spend(cycles),
            Err(fault) => self.fault(fault),
        }
    }

    fn is_hung(&self) -> bool {
        match self.hangs {
            None => false,
            Some(Hang::Thread) => self.core.exception == 0,
            Some(Hang::Samples) => self.core.exception == SAMPLE,
            Some(Hang::Everything) => true,
        }
    }

    fn sleeps(&mut self, until: u64) {
        if self.core.event || self.board.system.due(self.core.mask).is_some() {
            self.core.event = false;
            self.core.waits = false;
        } else {
            let next = self.board.next.min(until);
            self.board.now = self.board.now.max(next);
            self.board.run_due();
        }
        self.handle_exceptions();
    }

    fn handle_exceptions(&mut self) {
        self.core.attention = false;
        self.board.attention = false;
        self.core.float = self.board.float;
        if self.hangs == Some(Hang::Everything) {
            return;
        }
        if let Some(link) = self.core.returning.take() {
            let from = self.core.exception;
            self.board.system.leave(from);
            match self.core.leave(&mut self.board, link) {
                Ok(cycles) => self.board.spend(cycles),
                Err(fault) => self.fault(fault),
            }
            if let Some(handler) = self.handlers.get_mut(usize::from(from)) {
                let duration = self.board.cycles - handler.entered;
                handler.count += 1;
                handler.longest = handler.longest.max(duration);
            }
        }
        if let Some(number) = self.board.system.due(self.core.mask) {
            self.enter(number);
        }
    }

    fn enter(&mut self, number: u16) {
        let vector = self.board.system.vector(number);
        let handler = self.board.load(vector, 4).unwrap_or(0);
        self.board.system.enter(number);
        if let Some(handler) = self.handlers.get_mut(usize::from(number)) {
            handler.entered = self.board.cycles;
        }
        let (cycles, taken) = self.core.enter(&mut self.board, number, handler);
        self.board.spend(cycles);
        if !taken {
            // Stacking fault.
            self.board.system.fault_status |= 1 << 12;
            if number != HARD_FAULT {
                // The fault's handler is entered instead, on the same stack.
                self.board.system.leave(number);
                self.enter(HARD_FAULT);
            }
        }
    }

    /// Raises a fault. All are hard faults here, because none has a handler enabled.
    fn fault(&mut self, fault: Fault) {
        let debugged = self.halting & DEBUG != 0;
        let system = &mut self.board.system;
        // Bits of CFSR (B3.2.15).
        system.fault_status |= match fault {
            Fault::Breakpoint if debugged => return self.stop(2),
            Fault::Breakpoint => 0,
            Fault::Fetch => 1 << 8,
            Fault::Access(_) => 1 << 9,
            Fault::Undefined => 1 << 16,
            Fault::State => 1 << 17,
            Fault::Return => 1 << 18,
            Fault::NoCoprocessor => 1 << 19,
            Fault::Unaligned => 1 << 24,
        };
        if system.running(self.core.mask) <= -1 {
            self.runs = Runs::Stopped;
            self.core.attention = true;
            self.board.locks_up();
            return;
        }
        self.enter(HARD_FAULT);
    }

    fn resets(&mut self, cause: Cause) {
        match cause {
            // The chip waits for its supply.
            Cause::Power | Cause::BrownOut => {
                self.power_off();
                self.board.reset = None;
                self.power_lost |= cause == Cause::Power;
            }
            cause => self.reset(cause),
        }
    }
}

/// The word of a block of registers at an offset; 0 beyond them.
fn word(words: &[u32], offset: u32) -> u32 {
    words.get(offset as usize / 4).copied().unwrap_or(0)
}

fn set_word(words: &mut [u32], offset: u32, value: u32) {
    if let Some(word) = words.get_mut(offset as usize / 4) {
        *word = value;
    }
}

/// Widest access that address and length allow.
fn width(address: u32, length: usize) -> usize {
    let fits = |size: &usize| (address as usize | length).is_multiple_of(*size);
    [4, 2].into_iter().find(fits).unwrap_or(1)
}
