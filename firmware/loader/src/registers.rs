//! Registers that are the same on both chips: the independent watchdog and the flash controller.
//!
//! Each loader includes this file, because a safe function for any address must not be public.

use core::ptr::{read_volatile, write_volatile};

/// Bit of the flash's control register: program.
pub const PROGRAM: u32 = 1;
/// Bit of the flash's control register: erase a sector or page.
const ERASE: u32 = 1 << 1;
const START: u32 = 1 << 16;
const LOCK: u32 = 1 << 31;
const BUSY: u32 = 1 << 16;
const FLASH_KEYS: [u32; 2] = [0x4567_0123, 0xcdef_89ab];
/// Key, prescaler and reload of the watchdog (RM0090, 21.4; RM0440, 42.4).
const WATCHDOG: [u32; 3] = [0x4000_3000, 0x4000_3004, 0x4000_3008];
const WATCHDOG_FEED: u32 = 0xaaaa;

/// Reads a register, or a word of the flash.
#[inline]
pub fn read(address: u32) -> u32 {
    // SAFETY: a register of the chip or a word of its flash, used by the loader alone.
    unsafe { read_volatile(address as *const u32) }
}

/// Writes a register, or a word of the flash during an operation.
#[inline]
pub fn write(address: u32, value: u32) {
    // SAFETY: as above.
    unsafe { write_volatile(address as *mut u32, value) }
}

/// Clears, then sets bits of registers: `(register, clears, sets)`.
#[inline]
pub fn change(changes: &[(u32, u32, u32)]) {
    for &(register, clears, sets) in changes {
        write(register, read(register) & !clears | sets);
    }
}

/// Copies the flash's content from an address on.
#[inline]
pub fn copy(address: u32, bytes: &mut [u8]) {
    for (byte, address) in bytes.iter_mut().zip(address..) {
        // SAFETY: an address of the flash.
        *byte = unsafe { read_volatile(address as *const u8) };
    }
}

/// Starts the watchdog with its longest period: 22 to 62 s (STM32F405), 30 to 35 s (STM32G474).
#[inline]
pub fn start_watchdog() {
    write(WATCHDOG[0], 0xcccc);
    write(WATCHDOG[0], 0x5555);
    write(WATCHDOG[1], 6);
    write(WATCHDOG[2], 0xfff);
    feed_watchdog();
}

#[inline]
pub fn feed_watchdog() {
    write(WATCHDOG[0], WATCHDOG_FEED);
}

/// Registers of a flash's controller: keys, status and control; and its error flags.
pub struct FlashController {
    pub key: u32,
    pub status: u32,
    pub control: u32,
    /// Error flags of the status register; writing 1 clears them.
    pub errors: u32,
}

impl FlashController {
    /// Runs one operation; returns false on an error of the controller.
    #[inline]
    pub fn operate(&self, control: u32, begin: impl FnOnce()) -> bool {
        feed_watchdog();
        for key in FLASH_KEYS {
            write(self.key, key);
        }
        write(self.status, self.errors);
        write(self.control, control);
        begin();
        cortex_m::asm::dsb();
        while read(self.status) & BUSY != 0 {}
        let failed = read(self.status) & self.errors != 0;
        write(self.control, LOCK);
        !failed
    }

    /// Erases the sector or page that `control` selects; false on an error of the controller.
    #[inline]
    pub fn erase(&self, control: u32) -> bool {
        let control = ERASE | control;
        self.operate(control, || write(self.control, control | START))
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    cortex_m::peripheral::SCB::sys_reset()
}

/// Starts the program whose vector table is at this address.
///
/// # Safety
/// A vector table is there, and nothing of the loader is used afterwards.
#[inline]
pub unsafe fn start_program(vectors: u32) -> ! {
    // SAFETY: as required above.
    unsafe {
        (*cortex_m::peripheral::SCB::PTR).vtor.write(vectors);
        cortex_m::asm::bootload(vectors as *const u32)
    }
}
