//! The loader of the STM32F405. It swaps the slots for an update, reverts an unconfirmed update,
//! and starts the program.
//!
//! It runs on the internal oscillator of 16 MHz, as after a reset. All outputs float meanwhile,
//! except FAULT (PB11), which is on during a swap. The independent watchdog runs with its longest
//! period. The loader uses only RAM of the program's stack. It leaves every register as after a
//! reset, except the watchdog's after a swap.

use core::ops::Range;
use cortex_m::peripheral::SCB;
use cortex_m_rt::entry;
use embassy_boot::{BootLoader, BootLoaderConfig};
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};
use kband_loader::StatePages;
use kband_loader::layout::{ACTIVE, FIRST_SECTOR, SECTOR, STATE, UPDATE};
use registers::{
    FlashController, PROGRAM, change, copy, feed_watchdog, read, start_program, start_watchdog,
    write,
};

#[path = "registers.rs"]
mod registers;

/// The flash's controller (RM0090, 3.9).
const FLASH: FlashController = FlashController {
    key: 0x4002_3c04,
    status: 0x4002_3c0c,
    control: 0x4002_3c10,
    errors: 0xf2,
};
/// Parallelism of 32 bits; it needs a supply of 2.7 V.
const BY_WORDS: u32 = 2 << 8;
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

/// Waits until the supply was good for 0.1 s; returns at once if it is good.
fn await_supply() {
    let is_good = || read(POWER_STATUS) & BELOW == 0;
    if is_good() {
        return;
    }
    let mut good = 0;
    while good < SETTLED {
        good = if is_good() { good + 1 } else { 0 };
        feed_watchdog();
    }
}

struct Part(Range<u32>);

const FAILED: NorFlashErrorKind = NorFlashErrorKind::Other;

impl ErrorType for Part {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Part {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        check_read(self, offset, bytes.len())?;
        copy(self.0.start + offset, bytes);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.len()
    }
}

impl NorFlash for Part {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR as usize;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        check_erase(self, from, to)?;
        let first = FIRST_SECTOR + (self.0.start - ACTIVE.start) / SECTOR;
        for sector in first + from / SECTOR..first + to / SECTOR {
            await_supply();
            if !FLASH.erase(BY_WORDS | sector << 3) {
                return Err(FAILED);
            }
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        check_write(self, offset, bytes.len())?;
        let (words, _) = bytes.as_chunks::<4>();
        for (address, word) in (self.0.start + offset..).step_by(4).zip(words) {
            let word = u32::from_le_bytes(*word);
            // An erased word needs no programming.
            if read(address) == word {
                continue;
            }
            await_supply();
            let done = FLASH.operate(PROGRAM | BY_WORDS, || write(address, word));
            if !done || read(address) != word {
                return Err(FAILED);
            }
        }
        Ok(())
    }
}

fn begin() {
    start_watchdog();
    change(&[(AHB1_CLOCKS, 0, PORT_B), (APB1_CLOCKS, 0, POWER)]);
    write(PORT_B_SET, 1 << FAULT);
    change(&[
        (PORT_B_MODE, 0, 1 << (2 * FAULT)),
        (POWER_CONTROL, 0, MONITOR),
    ]);
    // The monitor needs time to start.
    cortex_m::asm::delay(1_000);
}

/// Resets port and supply monitor to their state after a reset.
fn end() {
    change(&[(PORT_B_MODE, 3 << (2 * FAULT), 0)]);
    write(PORT_B_SET, 1 << (16 + FAULT));
    change(&[
        (POWER_CONTROL, MONITOR, 0),
        (AHB1_CLOCKS, PORT_B, 0),
        (APB1_CLOCKS, POWER, 0),
    ]);
}

/// Whether the active slot begins with the vector table of a program.
fn has_program() -> bool {
    let [stack, entry] = [0, 4].map(|offset| read(ACTIVE.start + offset));
    RAM.contains(&stack) && ACTIVE.contains(&entry) && entry & 1 == 1
}

#[entry]
fn main() -> ! {
    let mut state = StatePages::new(Part(STATE), 0..STATE.end - STATE.start);
    let swaps = state.is_swap_due();
    if swaps {
        begin();
        let mut loader = BootLoader::new(BootLoaderConfig {
            active: Part(ACTIVE),
            dfu: Part(UPDATE),
            state,
        });
        if loader.prepare_boot(&mut [0; 1024]).is_err() {
            SCB::sys_reset();
        }
        end();
    }
    if has_program() {
        // SAFETY: the vector table of the program; the loader uses no memory afterwards.
        unsafe { start_program(ACTIVE.start) }
    }
    // An image without a program is reverted at once.
    if swaps {
        SCB::sys_reset();
    }
    begin();
    loop {
        feed_watchdog();
    }
}
