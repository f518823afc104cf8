//! The sectors of the flash that outlive the program's image, and the flash's accelerator.
//!
//! The chip has one bank: while a sector is erased, up to 2 s, nothing can be fetched from any other. The erasure is
//! waited for from RAM, with interrupts off, where the window watchdog is fed; the drive is off.

use embassy_stm32::flash::{Bank1Region3, Blocking, Error};
use embassy_stm32::pac;
use embedded_storage::nor_flash::{NorFlash as _, ReadNorFlash as _};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use kband_firmware::stm32::{erase_page, program_words};

use super::supply_settled;

/// The first sector of 128 KiB, and the size of each.
const FIRST: u32 = 5;
const SIZE: u32 = 128 * 1024;

/// Revision of the chip from which its flash can be fetched from ahead: 1, 2, Y, Z (ES0182).
const FETCHES_AHEAD: u16 = 0x1001;

/// Registers of the flash's controller (RM0090, 3.9).
const STATUS: *const u32 = 0x4002_3c0c as *const u32;
const CONTROL: *mut u32 = 0x4002_3c10 as *mut u32;
const ERASE_SECTOR: u32 = 1 << 1;
/// By words of 32 bits, which halves the 4 s of bytes (DS8626, flash memory programming). They need a supply of 2.7 V, which
/// its monitor grants.
const BY_WORDS: u32 = 2 << 8;

/// Has the flash read ahead and remember: at 168 MHz each fetch would cost five wait states.
pub fn read_ahead() {
    let ahead = pac::DBGMCU.idcode().read().rev_id() >= FETCHES_AHEAD;
    pac::FLASH.acr().modify(|access| {
        access.set_prften(ahead);
        access.set_icen(true);
        access.set_dcen(true);
    });
}

/// The sectors of 128 KiB.
pub struct Sectors(pub Bank1Region3<'static, Blocking>);

impl ErrorType for Sectors {
    type Error = Error;
}

impl ReadNorFlash for Sectors {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        self.0.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl NorFlash for Sectors {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SIZE as usize;

    /// Refused while the bridge is closed or the supply is low.
    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        if !from.is_multiple_of(SIZE) || !to.is_multiple_of(SIZE) {
            return Err(Error::Unaligned);
        }
        let end = self.0.capacity() as u32;
        if from > to || to > end {
            return Err(Error::Size);
        }
        for sector in from / SIZE..to / SIZE {
            let page = ERASE_SECTOR | BY_WORDS | (FIRST + sector) << 3;
            // SAFETY: the registers are this chip's.
            if !unsafe { erase_page(STATUS, CONTROL, page, supply_settled, unlock) } {
                return Err(Error::Prog);
            }
        }
        Ok(())
    }

    /// Stops at the word at which the supply is low.
    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        program_words::<4, _>(bytes, supply_settled, Error::Prog, |at, word| {
            self.0.write(offset + at, word)
        })
    }
}

fn unlock() {
    pac::FLASH.keyr().write_value(0x4567_0123);
    pac::FLASH.keyr().write_value(0xcdef_89ab);
}
