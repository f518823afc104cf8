//! A chip as a debug probe sees it: an STM32F405RG whose firmware drives the bridge.
//!
//! Flash with its controller, RAM, the registers that stop and start the core (ARM DDI 0403, C1.6), the
//! timer of the bridge. The core executes what a probe puts into RAM; of the firmware in flash it is known
//! only that it runs, and that it sets the output of the bridge again and again.

mod flash;
mod thumb;

use std::collections::BTreeMap;

use flash::Flash;
use thumb::{Stop, Thumb};

const MEMORY: u32 = 0x2000_0000;
const MEMORY_SIZE: usize = 128 * 1024;
/// Identity of the chip, the bits that stop timers with the core (RM0090, 38.16), flash size (39.2).
const IDENTITY: u32 = 0xe004_2000;
const STOPS: u32 = 0xe004_200c;
const STOP_TIMER_1: u32 = 1;
const FLASH_SIZE: u32 = 0x1fff_7a20;
/// Break and dead time of the bridge's timer, and its main output enable (RM0090, 17.4.18).
const BREAK: u32 = 0x4001_0044;
const MAIN_OUTPUT: u32 = 1 << 15;
/// The core's own registers.
const PROCESSOR: u32 = 0xe000_ed00;
const RESET: u32 = 0xe000_ed0c;
const WHY_HALTED: u32 = 0xe000_ed30;
const HALTING: u32 = 0xe000_edf0;
const SELECT: u32 = 0xe000_edf4;
const TRANSFER: u32 = 0xe000_edf8;
const CATCH: u32 = 0xe000_edfc;
const BREAKPOINTS: u32 = 0xe000_2000;
/// Bits of the halting register.
const DEBUG: u32 = 1;
const HALT: u32 = 1 << 1;
const STEP: u32 = 1 << 2;
const READY: u32 = 1 << 16;
const HALTED: u32 = 1 << 17;
const LOCKED_UP: u32 = 1 << 19;
const WAS_RESET: u32 = 1 << 25;
/// Instructions that a loader may take before it counts as one that never ends.
const LONGEST: u32 = 20_000_000;

/// Memory as a core sees it; `None` where nothing answers.
pub trait Bus {
    /// Reads 1, 2 or 4 bytes.
    fn load(&mut self, address: u32, size: u32) -> Option<u32>;
    /// Writes them.
    fn store(&mut self, address: u32, size: u32, value: u32) -> Option<()>;
}

/// Where something runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Runs {
    /// Nothing: it is halted.
    Nothing,
    /// The firmware in flash.
    Firmware,
    /// Nothing any more: no code where it should be.
    Lost,
}

/// The chip.
#[derive(Clone, Debug)]
pub struct Chip {
    /// What its identity says, and its flash in KiB.
    pub identity: (u32, u32),
    /// The supply fails once so many flash operations were done.
    pub fails_after: Option<u64>,
    /// Whether the bridge was driven while the core was halted.
    pub driven_while_halted: bool,
    /// Whether the core was ever halted.
    pub was_halted: bool,
    memory: Memory,
    core: Thumb,
    runs: Runs,
    /// Where the last reset led.
    entry: u32,
    halting: u32,
    was_reset: bool,
}

#[derive(Clone, Debug)]
struct Memory {
    flash: Flash,
    ram: Vec<u8>,
    /// Registers that hold what was written.
    words: BTreeMap<u32, u32>,
}

impl Default for Chip {
    fn default() -> Self {
        Self {
            identity: (0x1007_6413, 1024),
            fails_after: None,
            driven_while_halted: false,
            was_halted: false,
            memory: Memory {
                flash: Flash::default(),
                ram: vec![0; MEMORY_SIZE],
                words: BTreeMap::from([(BREAK, MAIN_OUTPUT)]),
            },
            core: Thumb::default(),
            runs: Runs::Firmware,
            entry: 0,
            halting: 0,
            was_reset: false,
        }
    }
}

impl Chip {
    /// Its flash.
    #[must_use]
    pub fn flash(&self) -> &[u8] {
        &self.memory.flash.bytes
    }

    /// Its flash, to be filled.
    pub fn flash_mut(&mut self) -> &mut [u8] {
        &mut self.memory.flash.bytes
    }

    /// Words programmed and sectors erased.
    #[must_use]
    pub fn operations(&self) -> u64 {
        self.memory.flash.operations
    }

    /// Has bits of a word of the flash stay 1.
    pub fn wear(&mut self, address: u32, bits: u32) {
        self.memory.flash.worn = Some((address, bits));
    }

    /// Whether the bridge is driven.
    #[must_use]
    pub fn is_driven(&self) -> bool {
        let stopped = self.runs != Runs::Firmware && self.memory.word(STOPS) & STOP_TIMER_1 != 0;
        self.memory.word(BREAK) & MAIN_OUTPUT != 0 && !stopped
    }

    /// Where the firmware began that runs; `None` where none does.
    #[must_use]
    pub fn running(&self) -> Option<u32> {
        (self.is_supplied() && self.runs == Runs::Firmware).then_some(self.entry)
    }

    /// Its supply comes back: what it holds in flash starts, if it can.
    pub fn power_on(&mut self) {
        self.fails_after = None;
        self.memory.ram.fill(0);
        self.memory.words.clear();
        self.halting = 0;
        self.reset();
    }

    /// Reads bytes, as a probe does; `None` where nothing answers.
    pub fn read(&mut self, address: u32, bytes: &mut [u8]) -> Option<()> {
        self.goes_on()?;
        let size = width(address, bytes.len());
        for (index, part) in bytes.chunks_exact_mut(size).enumerate() {
            let place = address.checked_add((index * size) as u32)?;
            let value = match self.own(place) {
                Some(value) => value,
                None => self.memory.load(place, size as u32)?,
            };
            part.copy_from_slice(&value.to_le_bytes()[..size]);
        }
        Some(())
    }

    /// Writes bytes, as a probe does, `size` at a time.
    pub fn write(&mut self, address: u32, size: usize, bytes: &[u8]) -> Option<()> {
        self.goes_on()?;
        for (index, part) in bytes.chunks_exact(size).enumerate() {
            let place = address.checked_add((index * size) as u32)?;
            let mut word = [0; 4];
            word[..size].copy_from_slice(part);
            let value = u32::from_le_bytes(word);
            if !self.set_own(place, value) {
                self.memory.store(place, size as u32, value)?;
            }
        }
        self.goes_on()
    }

    fn is_supplied(&self) -> bool {
        self.fails_after
            .is_none_or(|operations| self.memory.flash.operations < operations)
    }

    /// The firmware goes on between two accesses: it sets the output of the bridge.
    fn goes_on(&mut self) -> Option<()> {
        if !self.is_supplied() {
            return None;
        }
        if self.runs == Runs::Firmware && !self.was_reset {
            let word = self.memory.words.entry(BREAK).or_default();
            *word |= MAIN_OUTPUT;
        }
        Some(())
    }

    /// A register of the core or an identity.
    fn own(&mut self, address: u32) -> Option<u32> {
        Some(match address {
            IDENTITY => self.identity.0,
            FLASH_SIZE => self.identity.1 << 16,
            // The upper half of that word, read as such.
            0x1fff_7a22 => self.identity.1,
            PROCESSOR => 0x410f_c241,
            BREAKPOINTS => 0x260,
            HALTING => {
                let mut value = self.halting | READY;
                if self.halting & DEBUG != 0 {
                    value |= match self.runs {
                        Runs::Nothing => HALTED,
                        Runs::Lost => LOCKED_UP,
                        Runs::Firmware => 0,
                    };
                }
                if std::mem::take(&mut self.was_reset) {
                    value |= WAS_RESET;
                    // From here on the firmware that was started counts as one that is at rest.
                    self.memory.words.remove(&BREAK);
                }
                value
            }
            _ => return None,
        })
    }

    /// Writes a register of the core; whether it is one.
    fn set_own(&mut self, address: u32, value: u32) -> bool {
        match address {
            HALTING if value >> 16 == 0xa05f => self.halt(value & 0xffff),
            SELECT => {
                // Both stack pointers are one here.
                let number = match value & 0x7f {
                    17 | 18 => 13,
                    number => number as usize,
                };
                // The address of the next instruction has no bit for Thumb.
                let mask = if number == 15 { !1 } else { !0 };
                match (self.core.registers.get_mut(number), value >> 16 & 1) {
                    (Some(register), 1) => *register = self.memory.word(TRANSFER) & mask,
                    (Some(register), _) => _ = self.memory.words.insert(TRANSFER, *register),
                    (None, 0) => _ = self.memory.words.insert(TRANSFER, 0x0100_0000),
                    (None, _) => {}
                }
            }
            RESET if value >> 16 == 0x05fa && value & 4 != 0 => self.reset(),
            WHY_HALTED => {
                let left = self.memory.word(WHY_HALTED) & !value;
                self.memory.words.insert(WHY_HALTED, left);
            }
            HALTING | IDENTITY | PROCESSOR | BREAKPOINTS | RESET => {}
            _ => return false,
        }
        true
    }

    fn halt(&mut self, control: u32) {
        self.halting = control;
        let asked = control & (DEBUG | HALT | STEP);
        if asked & DEBUG == 0 {
            if self.runs == Runs::Nothing {
                self.runs = Runs::Firmware;
            }
            return;
        }
        if asked & HALT != 0 {
            self.stop(1);
        } else if self.runs == Runs::Nothing {
            let most = if asked & STEP != 0 { 1 } else { LONGEST };
            self.go(most);
        }
    }

    /// Executes what is in RAM; firmware in flash is taken to run.
    fn go(&mut self, most: u32) {
        if self.core.registers[15] < MEMORY && most > 1 {
            self.runs = Runs::Firmware;
            return;
        }
        for _ in 0..most {
            match self.core.step(&mut self.memory) {
                Ok(()) if !self.is_supplied() => return,
                Ok(()) => {}
                Err(Stop::Breakpoint) => return self.stop(2),
                Err(Stop::Fault) => {
                    self.runs = Runs::Lost;
                    return;
                }
            }
        }
        if most == 1 {
            self.stop(1);
        } else {
            self.runs = Runs::Lost;
        }
    }

    fn stop(&mut self, why: u32) {
        self.runs = Runs::Nothing;
        self.was_halted = true;
        self.driven_while_halted |= self.is_driven();
        let word = self.memory.words.entry(WHY_HALTED).or_default();
        *word |= why;
    }

    fn reset(&mut self) {
        self.was_reset = true;
        self.memory.flash.reset();
        // The bits for the debugger outlast a reset.
        let outlast = [STOPS, CATCH, TRANSFER];
        self.memory
            .words
            .retain(|address, _| outlast.contains(address));
        let vector = |chip: &Self, at: usize| {
            let bytes = &chip.memory.flash.bytes[at..at + 4];
            u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
        };
        let (stack, entry) = (vector(self, 0), vector(self, 4));
        self.core = Thumb::default();
        self.core.registers[13] = stack;
        self.entry = entry & !1;
        self.core.registers[15] = self.entry;
        let starts = flash::RANGE.contains(&entry) && entry & 1 == 1;
        self.runs = if starts { Runs::Firmware } else { Runs::Lost };
        if self.halting & DEBUG != 0 && self.memory.word(CATCH) & 1 != 0 {
            self.stop(8);
        }
    }
}

/// The widest access that an address and a length allow.
fn width(address: u32, length: usize) -> usize {
    [4, 2]
        .into_iter()
        .find(|size| (address as usize | length).is_multiple_of(*size))
        .unwrap_or(1)
}

impl Memory {
    fn word(&self, address: u32) -> u32 {
        self.words.get(&address).copied().unwrap_or(0)
    }
}

impl Bus for Memory {
    fn load(&mut self, address: u32, size: u32) -> Option<u32> {
        let within = |bytes: &[u8], start: u32| {
            let at = address.checked_sub(start)? as usize;
            let bytes = bytes.get(at..at + size as usize)?;
            let word = |word, byte: &u8| word << 8 | u32::from(*byte);
            Some(bytes.iter().rev().fold(0, word))
        };
        if flash::REGISTERS.contains(&address) {
            return Some(self.flash.register(address - flash::REGISTERS.start));
        }
        within(&self.flash.bytes, flash::START)
            .or_else(|| within(&self.ram, MEMORY))
            .or_else(|| is_register(address).then(|| self.word(address)))
    }

    fn store(&mut self, address: u32, size: u32, value: u32) -> Option<()> {
        if flash::REGISTERS.contains(&address) {
            self.flash
                .set_register(address - flash::REGISTERS.start, value);
        } else if flash::RANGE.contains(&address) {
            let offset = (address - flash::START) as usize;
            self.flash.program(offset, size, value);
        } else if is_register(address) {
            self.words.insert(address, value);
        } else {
            let at = address.checked_sub(MEMORY)? as usize;
            let place = self.ram.get_mut(at..at + size as usize)?;
            place.copy_from_slice(&value.to_le_bytes()[..size as usize]);
        }
        Some(())
    }
}

/// Peripherals and the core's own registers.
fn is_register(address: u32) -> bool {
    (0x4000_0000..0x6000_0000).contains(&address) || address >= 0xe000_0000
}
