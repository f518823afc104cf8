//! Flash sectors for settings and faults, and the flash accelerator.
//!
//! Sectors 1 to 4 are pages of 16 KiB; the last three quarters of sector 4 stay unused. The chip
//! has one flash bank: during an erasure of up to 2 s it cannot fetch from any sector. Code in RAM
//! waits for the end, with interrupts off and the drive off, and feeds the window watchdog.

use super::Board;
use embassy_stm32::flash::{Blocking, Error, Flash};
use embassy_stm32::pac;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use kband_firmware::hardware::chip::Chip;
use kband_firmware::hardware::stm32::{erase_page, erase_pages, program_words};

/// Size of a page, bytes.
pub const PAGE: u32 = 16 * 1024;
const PAGES: u32 = 4;
/// Number of the sector of the first page. Its offset in the flash is one page.
const FIRST: u32 = 1;

/// Lowest revision of the chip with a working flash prefetch: 1, 2, Y, Z (ES0182).
const FETCHES_AHEAD: u16 = 0x1001;

/// Bit of the flash controller's control register (RM0090, 3.9).
const ERASE_SECTOR: u32 = 1 << 1;
/// Parallelism of 32 bits, which takes half the time of 8 bits (DS8626, flash memory programming).
/// It needs a supply of 2.7 V, which the supply monitor ensures.
const BY_WORDS: u32 = 2 << 8;

/// Switches prefetch and caches on: at 168 MHz each fetch costs five wait states.
pub fn read_ahead() {
    let ahead = pac::DBGMCU.idcode().read().rev_id() >= FETCHES_AHEAD;
    pac::FLASH.acr().modify(|access| {
        access.set_prften(ahead);
        access.set_icen(true);
        access.set_dcen(true);
    });
}

/// The flash from the first page on.
pub struct Sectors(pub Flash<'static, Blocking>);

impl ErrorType for Sectors {
    type Error = Error;
}

impl ReadNorFlash for Sectors {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        self.0.blocking_read(FIRST * PAGE + offset, bytes)
    }

    fn capacity(&self) -> usize {
        (PAGES * PAGE) as usize
    }
}

impl NorFlash for Sectors {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE as usize;

    /// Refused while the bridge is closed or the supply is low.
    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        erase_pages((from, to), PAGE, self.capacity(), |page| {
            erase_sector(FIRST + page)
        })
    }

    /// Stops at the word at which the supply is low.
    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        if offset as usize + bytes.len() > self.capacity() {
            return Err(Error::Size);
        }
        program_words::<4>(bytes, Board::supply_settled, |at, word| {
            self.0.blocking_write(FIRST * PAGE + offset + at, word)
        })
    }
}

/// Erases a sector by its number; refused while the bridge is closed or the supply is low.
pub fn erase_sector(number: u32) -> bool {
    let page = ERASE_SECTOR | BY_WORDS | number << 3;
    erase_page(page, 0, Board::supply_settled)
}
