//! Pages of the second flash bank. Its words carry an error-correcting code: a word torn by a power
//! cut causes an NMI when read.

use super::Board;
use core::sync::atomic::{AtomicBool, Ordering};
use cortex_m::asm::dsb;
use cortex_m_rt::exception;
use embassy_stm32::flash::{Bank2Region, Blocking, Error};
use embassy_stm32::pac;
use embedded_storage::nor_flash::{NorFlash as _, ReadNorFlash as _};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use kband_firmware::hardware::chip::Chip;
use kband_firmware::hardware::cortex::unexpected;
use kband_firmware::hardware::stm32::{erase_page, erase_pages, forget_break, program_words};

/// Size of a page with the flash in two banks, bytes.
const SIZE: u32 = 2 * 1024;
/// Bits of the flash controller's control register (RM0440, 3.7).
const ERASE_PAGE: u32 = 1 << 1;
const SECOND_BANK: u32 = 1 << 11;
/// Error bits of the status register, cleared by writing 1. A set bit prevents an erasure.
const ERRORS: u32 = 0xc3fa;
const NMI: i16 = -14;

/// Whether the program reads these pages, and whether a word with two wrong bits was read.
static IS_READING: AtomicBool = AtomicBool::new(false);
static READ_FAILED: AtomicBool = AtomicBool::new(false);

/// Two wrong bits in a word of the flash (RM0440, 3.3.7). In the pages of the settings they come
/// from a power cut within a record, which the checksum detects. Elsewhere the program is damaged.
#[exception]
unsafe fn NonMaskableInt() {
    let errors = pac::FLASH.eccr().read();
    if !(errors.eccd() || errors.eccd2()) || !IS_READING.load(Ordering::Relaxed) {
        unexpected(NMI);
    }
    // Writing 1 clears the flag.
    pac::FLASH.eccr().write_value(errors);
    READ_FAILED.store(true, Ordering::Relaxed);
}

/// Pages of the second bank.
pub struct Pages(pub Bank2Region<'static, Blocking>);

impl ErrorType for Pages {
    type Error = Error;
}

impl ReadNorFlash for Pages {
    const READ_SIZE: usize = 1;

    /// Returns the raw bytes of a torn word, but never all bits set (erased).
    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        READ_FAILED.store(false, Ordering::Relaxed);
        IS_READING.store(true, Ordering::Relaxed);
        let read = self.0.read(offset, bytes);
        dsb();
        IS_READING.store(false, Ordering::Relaxed);
        if READ_FAILED.load(Ordering::Relaxed) {
            // The flash error has also triggered the break, which is not an over-current.
            forget_break();
            if let Some(first) = bytes.first_mut().filter(|first| **first == 0xff) {
                *first = 0;
            }
        }
        read
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl NorFlash for Pages {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = SIZE as usize;

    /// Refused while the bridge is closed or the supply is low.
    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        erase_pages((from, to), SIZE, self.0.capacity(), |page| {
            let page = ERASE_PAGE | SECOND_BANK | page << 3;
            erase_page(page, ERRORS, Board::supply_settled)
        })
    }

    /// Stops at the word at which the supply is low.
    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        program_words::<8>(bytes, Board::supply_settled, |at, word| {
            self.0.write(offset + at, word)
        })
    }
}
