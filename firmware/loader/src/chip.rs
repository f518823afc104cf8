//! The loader of the STM32F405: swaps the slots for an update, takes an update back that was not
//! confirmed, and starts the program.
//!
//! It runs on the internal oscillator of 16 MHz, as after a reset. All outputs float meanwhile, but
//! FAULT (PB11), which is on during a swap. The independent watchdog runs with its longest period.
//! The loader uses only RAM of the program's stack. It leaves every register as after a reset, but
//! the watchdog's after a swap.

use core::ptr::{read_volatile, write_volatile};

use cortex_m::peripheral::SCB;
use cortex_m_rt::entry;
use embassy_boot::{BootLoader, BootLoaderConfig};
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use kband_loader::StatePages;
use kband_loader::layout::{ACTIVE, FIRST_SECTOR, SECTOR, STATE, UPDATE};

/// Registers of the flash's controller (RM0090, 3.9).
const FLASH_KEY: u32 = 0x4002_3c04;
const FLASH_STATUS: u32 = 0x4002_3c0c;
const FLASH_CONTROL: u32 = 0x4002_3c10;
const FLASH_KEYS: [u32; 2] = [0x4567_0123, 0xcdef_89ab];
const PROGRAM: u32 = 1;
const ERASE_SECTOR: u32 = 1 << 1;
/// Parallelism of 32 bits; it needs a supply of 2.7 V.
const BY_WORDS: u32 = 2 << 8;
const START: u32 = 1 << 16;
const LOCK: u32 = 1 << 31;
const BUSY: u32 = 1 << 16;
const ERRORS: u32 = 0xf2;
/// Registers of the independent watchdog (21.4), and its longest period: 22 to 62 s.
const WATCHDOG: [u32; 3] = [0x4000_3000, 0x4000_3004, 0x4000_3008];
const WATCHDOG_START: u32 = 0xcccc;
const WATCHDOG_OPEN: u32 = 0x5555;
const WATCHDOG_FEED: u32 = 0xaaaa;
/// Clocks of port B (AHB1, 7.3.10) and of the supply monitor (APB1, 7.3.13).
const AHB1_CLOCKS: u32 = 0x4002_3830;
const APB1_CLOCKS: u32 = 0x4002_3840;
const PORT_B: u32 = 1 << 1;
const POWER: u32 = 1 << 28;
/// Control and status of the power controller (5.4), and the monitor at its level of 2.9 V.
const POWER_CONTROL: u32 = 0x4000_7000;
const POWER_STATUS: u32 = 0x4000_7004;
const MONITOR: u32 = 7 << 5 | 1 << 4;
const BELOW: u32 = 1 << 2;
/// Mode and set register of port B, and the FAULT pin.
const PORT_B_MODE: u32 = 0x4002_0400;
const PORT_B_SET: u32 = 0x4002_0418;
const FAULT: u32 = 11;
/// Addresses of the RAM, for the check of a program's stack.
const RAM: core::ops::RangeInclusive<u32> = 0x2000_0000..=0x2002_0000;
/// Number of loops for which the supply must be good: about 0.1 s at 16 MHz.
const SETTLED: u32 = 200_000;

fn read(register: u32) -> u32 {
    // SAFETY: a register of the chip, which the loader has to itself.
    unsafe { read_volatile(register as *const u32) }
}

fn write(register: u32, value: u32) {
    // SAFETY: as above.
    unsafe { write_volatile(register as *mut u32, value) }
}

/// Waits until the supply was good for 0.1 s, or returns at once where it is.
fn await_supply() {
    write(WATCHDOG[0], WATCHDOG_FEED);
    if read(POWER_STATUS) & BELOW == 0 {
        return;
    }
    let mut good = 0;
    while good < SETTLED {
        good = if read(POWER_STATUS) & BELOW == 0 {
            good + 1
        } else {
            0
        };
        write(WATCHDOG[0], WATCHDOG_FEED);
    }
}

/// Does one operation of the flash; false on an error of its controller.
fn operate(control: u32, begin: impl FnOnce()) -> bool {
    for key in FLASH_KEYS {
        write(FLASH_KEY, key);
    }
    write(FLASH_STATUS, ERRORS);
    write(FLASH_CONTROL, control);
    begin();
    cortex_m::asm::dsb();
    while read(FLASH_STATUS) & BUSY != 0 {}
    let failed = read(FLASH_STATUS) & ERRORS != 0;
    write(FLASH_CONTROL, LOCK);
    !failed
}

/// A part of the flash.
struct Part {
    start: u32,
    length: u32,
}

impl Part {
    fn new(range: core::ops::Range<u32>) -> Self {
        Self {
            start: range.start,
            length: range.end - range.start,
        }
    }

    fn holds(&self, from: u32, length: u32) -> bool {
        from.checked_add(length)
            .is_some_and(|end| end <= self.length)
    }
}

/// The flash failed.
#[derive(Debug)]
struct Failed;

impl NorFlashError for Failed {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl ErrorType for Part {
    type Error = Failed;
}

impl ReadNorFlash for Part {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Failed> {
        if !self.holds(offset, bytes.len() as u32) {
            return Err(Failed);
        }
        for (byte, address) in bytes.iter_mut().zip(self.start + offset..) {
            // SAFETY: an address of the flash.
            *byte = unsafe { read_volatile(address as *const u8) };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.length as usize
    }
}

impl NorFlash for Part {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR as usize;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Failed> {
        let whole = from.is_multiple_of(SECTOR) && to.is_multiple_of(SECTOR);
        if !whole || from > to || !self.holds(from, to - from) {
            return Err(Failed);
        }
        let first = FIRST_SECTOR + (self.start - ACTIVE.start) / SECTOR;
        for sector in first + from / SECTOR..first + to / SECTOR {
            await_supply();
            let control = ERASE_SECTOR | BY_WORDS | sector << 3;
            if !operate(control, || write(FLASH_CONTROL, control | START)) {
                return Err(Failed);
            }
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Failed> {
        let whole = offset.is_multiple_of(4) && bytes.len().is_multiple_of(4);
        if !whole || !self.holds(offset, bytes.len() as u32) {
            return Err(Failed);
        }
        let (words, _) = bytes.as_chunks::<4>();
        for (address, word) in (self.start + offset..).step_by(4).zip(words) {
            let word = u32::from_le_bytes(*word);
            // An erased word needs no programming.
            if read(address) == word {
                continue;
            }
            await_supply();
            let done = operate(PROGRAM | BY_WORDS, || write(address, word));
            if !done || read(address) != word {
                return Err(Failed);
            }
        }
        Ok(())
    }
}

/// Switches FAULT, supply monitor and watchdog on.
fn begin() {
    for (register, value) in [
        (WATCHDOG[0], WATCHDOG_START),
        (WATCHDOG[0], WATCHDOG_OPEN),
        (WATCHDOG[1], 6),
        (WATCHDOG[2], 0xfff),
        (WATCHDOG[0], WATCHDOG_FEED),
        (AHB1_CLOCKS, read(AHB1_CLOCKS) | PORT_B),
        (APB1_CLOCKS, read(APB1_CLOCKS) | POWER),
        (PORT_B_SET, 1 << FAULT),
    ] {
        write(register, value);
    }
    write(PORT_B_MODE, read(PORT_B_MODE) | 1 << (2 * FAULT));
    write(POWER_CONTROL, read(POWER_CONTROL) | MONITOR);
    // The monitor needs a moment.
    cortex_m::asm::delay(1_000);
}

/// Leaves port and supply monitor as after a reset.
fn end() {
    write(PORT_B_MODE, read(PORT_B_MODE) & !(3 << (2 * FAULT)));
    write(PORT_B_SET, 1 << (16 + FAULT));
    write(POWER_CONTROL, read(POWER_CONTROL) & !MONITOR);
    write(AHB1_CLOCKS, read(AHB1_CLOCKS) & !PORT_B);
    write(APB1_CLOCKS, read(APB1_CLOCKS) & !POWER);
}

/// Whether the active slot begins with the vector table of a program.
fn has_program() -> bool {
    let [stack, entry] = [0, 4].map(|offset| read(ACTIVE.start + offset));
    RAM.contains(&stack) && ACTIVE.contains(&entry) && entry & 1 == 1
}

#[entry]
fn main() -> ! {
    let mut state = StatePages::new(Part::new(STATE), 0..STATE.end - STATE.start);
    let swaps = state.is_swap_due();
    if swaps {
        begin();
        let mut loader = BootLoader::new(BootLoaderConfig {
            active: Part::new(ACTIVE),
            dfu: Part::new(UPDATE),
            state,
        });
        if loader.prepare_boot(&mut [0; 1024]).is_err() {
            SCB::sys_reset();
        }
        end();
    }
    if has_program() {
        // SAFETY: the vector table of the program; the loader uses no memory afterwards.
        unsafe {
            (*SCB::PTR).vtor.write(ACTIVE.start);
            cortex_m::asm::bootload(ACTIVE.start as *const u32);
        }
    }
    // An image without a program is taken back at once.
    if swaps {
        SCB::sys_reset();
    }
    begin();
    loop {
        write(WATCHDOG[0], WATCHDOG_FEED);
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    SCB::sys_reset()
}
