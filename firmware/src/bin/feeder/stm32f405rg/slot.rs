//! The slot for an update in sectors 8 to 11, and its marks in sector 0.

use embassy_stm32::flash::{Blocking, Error, Flash};
use embassy_stm32::peripherals::FLASH;
use kband_firmware::stm32::program_words;
use kband_firmware::update::{SecondSlot, Slot, Writer};
use kband_loader::StatePages;
use kband_loader::layout::{ACTIVE, FIRST_SECTOR, SECTOR, STATE, UPDATE};

use super::flash::erase_sector;
use super::supply_settled;

/// First address of the flash.
const START: u32 = 0x0800_0000;

/// The slot; `restart` restarts the board.
pub fn slot(restart: fn()) -> Slot {
    Slot {
        board: "stm32f405rg",
        size: ACTIVE.end - ACTIVE.start,
        restart,
        writer: Writer::Program(SecondSlot {
            sector: SECTOR,
            erase: |offset| {
                erase_sector(FIRST_SECTOR + (UPDATE.start - ACTIVE.start + offset) / SECTOR)
            },
            write,
            read: |offset, bytes| _ = flash().blocking_read(UPDATE.start - START + offset, bytes),
            on_trial: || state().is_swap_due(),
            mark: || supply_settled() && state().mark(),
            confirm: || supply_settled() && state().confirm(),
            has_room: || state().have_room().unwrap_or(false),
        }),
    }
}

/// The flash's controller.
fn flash() -> Flash<'static, Blocking> {
    // SAFETY: this and the memory of the settings are used by one task only, each for whole
    // operations.
    Flash::new_blocking(unsafe { FLASH::steal() })
}

fn state() -> StatePages<Flash<'static, Blocking>> {
    StatePages::new(flash(), STATE.start - START..STATE.end - START)
}

/// Programs words and verifies them.
fn write(offset: u32, bytes: &[u8]) -> bool {
    let (mut flash, from) = (flash(), UPDATE.start - START + offset);
    let written = program_words::<4, _>(bytes, supply_settled, Error::Prog, |at, word| {
        flash.blocking_write(from + at, word)?;
        let mut held = [0; 4];
        flash.blocking_read(from + at, &mut held)?;
        if held == *word {
            Ok(())
        } else {
            Err(Error::Prog)
        }
    });
    written.is_ok()
}
