//! The flash: check of the image, erasure and programming.

use super::watchdogs::{ERASURE_PERIOD, WINDOW_FED, change_period, restart_sample_count};
use core::hint::black_box;
use core::ptr::{read_volatile, write_volatile};
use embassy_stm32::flash::Error;
use embassy_stm32::pac;

/// Data register of the CRC unit (RM0090, 4.4; RM0440, 16.4; the same on both).
const CRC_DATA: *mut u32 = 0x4002_3000 as *mut u32;
const CRC_CONTROL: *mut u32 = 0x4002_3008 as *mut u32;
const CRC_RESET: u32 = 1;

/// Whether the flash holds the program as written: its CRC-32 is behind the image.
pub fn image_is_valid() -> bool {
    unsafe extern "C" {
        static _image_start: u32;
        static _image_end: u32;
    }
    pac::RCC.ahb1enr().modify(|clocks| clocks.set_crcen(true));
    let end = &raw const _image_end;
    let mut word = &raw const _image_start;
    // SAFETY: registers that no other code uses, and the words of the flash between the linker's
    // bounds of the image. The unit processes the highest bit first, CRC-32 the lowest.
    unsafe {
        write_volatile(CRC_CONTROL, CRC_RESET);
        while word < end {
            write_volatile(CRC_DATA, read_volatile(word).reverse_bits());
            word = word.add(1);
        }
        !read_volatile(CRC_DATA).reverse_bits() == read_volatile(end)
    }
}

/// Busy bit of the flash controller's status, the same on all STM32F4 and STM32G4.
const FLASH_BUSY: u32 = 1 << 16;
/// Start bit of the flash controller's control register, the same on all STM32F4 and STM32G4.
const FLASH_START: u32 = 1 << 16;
const WINDOW: *mut u32 = 0x4000_2c00 as *mut u32;
const WINDOW_RUNS: u32 = 0x80;
/// Its count, which falls by one a step.
const WINDOW_COUNT: u32 = 0x7f;
/// Count at which it is fed during an erasure: halfway to its reset.
const HALF_WAY: u32 = 0x58;

/// Erases the pages of `size` bytes from `from` up to `to`, each by its number with `erase`.
///
/// # Errors
/// The range is not of whole pages, exceeds `capacity` bytes, or an erasure failed.
pub fn erase_pages(
    (from, to): (u32, u32),
    size: u32,
    capacity: usize,
    erase: impl FnMut(u32) -> bool,
) -> Result<(), Error> {
    let is_whole = from.is_multiple_of(size) && to.is_multiple_of(size);
    if !is_whole || from > to || to as usize > capacity {
        return Err(Error::Size);
    }
    let erased = (from / size..to / size).all(erase);
    erased.then_some(()).ok_or(Error::Prog)
}

/// Erases a page of the flash with interrupts off, if the bridge is open. `page` in the control
/// register selects it; the error flags `errors` are cleared before. For up to 2 s the CPU cannot
/// fetch from that flash: code in RAM waits and feeds the window watchdog. Returns whether it ended
/// with a good supply.
pub fn erase_page(page: u32, errors: u32, settled: fn() -> bool) -> bool {
    let (status, control) = (pac::FLASH.sr(), pac::FLASH.cr());
    // Called by its address because it lies beyond the range of a branch.
    let erase: unsafe fn(*const u32, *mut u32, u32) -> bool = black_box(erase);
    let usual = (pac::IWDG.pr().read().pr(), pac::IWDG.rlr().read().rl());
    let began = cortex_m::interrupt::free(|_| {
        if pac::TIM1.bdtr().read().moe() || !settled() {
            return false;
        }
        change_period(ERASURE_PERIOD);
        pac::FLASH.keyr().write_value(0x4567_0123);
        pac::FLASH.keyr().write_value(0xcdef_89ab);
        status.write_value(pac::flash::regs::Sr(errors));
        // SAFETY: interrupts are off, and the registers are the controller's. It is not busy: one
        // task works on the flash, one complete operation at a time.
        if unsafe { erase(status.as_ptr().cast(), control.as_ptr().cast(), page) } {
            // A feed after fewer than 40 samples would reset the chip.
            restart_sample_count();
        }
        control.modify(|control| control.set_lock(true));
        forget_flash();
        true
    });
    if began {
        change_period(usual);
    }
    // By now a pending interrupt of the supply monitor has run.
    began && settled()
}

/// Programs `bytes`, whose number is a multiple of `SIZE`, in words of `SIZE` bytes, each while the
/// supply is `settled`; else fails.
pub fn program_words<const SIZE: usize>(
    bytes: &[u8],
    settled: fn() -> bool,
    mut program: impl FnMut(u32, &[u8; SIZE]) -> Result<(), Error>,
) -> Result<(), Error> {
    let (words, _) = bytes.as_chunks::<SIZE>();
    for (at, word) in (0..).step_by(SIZE).zip(words) {
        let done = cortex_m::interrupt::free(|_| settled().then(|| program(at, word)));
        match done {
            Some(result) => result?,
            None => return Err(Error::Prog),
        }
    }
    Ok(())
}

/// Erases a page; returns whether the window watchdog was fed meanwhile.
///
/// # Safety
/// The controller is unlocked and not busy; nothing may run from or read the flash meanwhile.
#[unsafe(link_section = ".data.erase")]
#[inline(never)]
unsafe fn erase(status: *const u32, control: *mut u32, page: u32) -> bool {
    let mut fed = false;
    // SAFETY: registers of the flash and of the window watchdog, which the caller alone uses.
    unsafe {
        write_volatile(control, page);
        write_volatile(control, page | FLASH_START);
        while read_volatile(status) & FLASH_BUSY != 0 {
            let window = read_volatile(WINDOW);
            if window & WINDOW_RUNS != 0 && window & WINDOW_COUNT <= HALF_WAY {
                write_volatile(WINDOW, WINDOW_FED);
                fed = true;
            }
        }
        write_volatile(control, 0);
    }
    fed
}

/// Clears the flash caches after an erasure, while they are off (RM0090, 3.5.2; RM0440, 3.3.5).
fn forget_flash() {
    let access = pac::FLASH.acr();
    let before = access.read();
    access.modify(|access| {
        access.set_icen(false);
        access.set_dcen(false);
    });
    access.modify(|access| {
        access.set_icrst(true);
        access.set_dcrst(true);
    });
    access.modify(|access| {
        access.set_icrst(false);
        access.set_dcrst(false);
    });
    access.write_value(before);
}
