//! The slot for an update in sectors 8 to 11, and its marks in sector 0.

use super::Board;
use super::flash::erase_sector;
use embassy_stm32::flash::{Blocking, Error, Flash};
use embassy_stm32::peripherals::FLASH;
use kband_firmware::hardware::chip::Chip;
use kband_firmware::hardware::stm32::program_words;
use kband_firmware::update::{SecondSlot, Slot, Writer};
use kband_loader::StatePages;
use kband_loader::layout::{ACTIVE, FIRST_SECTOR, SECTOR, STATE, UPDATE};

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
            mark: || Board::supply_settled() && state().mark(),
            confirm: || Board::supply_settled() && state().confirm(),
            has_room: || state().have_room(),
        }),
    }
}

fn flash() -> Flash<'static, Blocking> {
    // SAFETY: one task uses this and the memory of the settings, one complete operation at a time.
    Flash::new_blocking(unsafe { FLASH::steal() })
}

fn state() -> StatePages<Flash<'static, Blocking>> {
    StatePages::new(flash(), STATE.start - START..STATE.end - START)
}

fn write(offset: u32, bytes: &[u8]) -> bool {
    let (mut flash, from) = (flash(), UPDATE.start - START + offset);
    let written = program_words::<4>(bytes, Board::supply_settled, |at, word| {
        flash.blocking_write(from + at, word)?;
        let mut stored = [0; 4];
        flash.blocking_read(from + at, &mut stored)?;
        (stored == *word).then_some(()).ok_or(Error::Prog)
    });
    written.is_ok()
}
