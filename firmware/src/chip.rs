//! What a chip owes its board: in what the STM32s of the boards differ.
//!
//! Pins and peripherals are the same on every board ([`crate::stm32`]). A new board is a file that implements [`Chip`] for
//! its `Board`, in `src/bin/feeder`, and the description of its memory, `NAME.x` in this crate's folder; both have the name
//! of the cargo feature that chooses the board, and `main.rs` names the file.

use embassy_stm32::Peri;
use embassy_stm32::adc::{Adc, SampleTime};
use embassy_stm32::pac::Interrupt;
use embassy_stm32::peripherals::{ADC1, FLASH};

use kband::wire::SetUp;

use crate::start::Signs;
use crate::store::{Store, StoreFailed};

/// The clocks that a chip starts with.
pub struct ChipClocks {
    /// Their frequencies and sources.
    pub config: embassy_stm32::Config,
    /// Whether they are what the board is to run from: the drive stays off where they are not.
    pub sound: bool,
}

/// The chip of a board.
pub trait Chip {
    /// Clock of core and TIM1 in Hz.
    const CORE_CLOCK: u32;

    /// The interrupt that ends a conversion. Its handler stands in the chip's file: it clears the converter's flag
    /// and takes the sample, within 50 us.
    const CONVERTED: Interrupt;

    /// The memory of the settings.
    type Memory: Store;

    /// The clocks, from which [`Chip::CORE_CLOCK`] follows; APB1 runs USART2 at 115200 baud within 2 %. The
    /// independent watchdog runs before this is called, and nothing here waits for ever.
    fn clocks() -> ChipClocks;

    /// Once the clocks run: has the chip watch the oscillator that it runs from and its supply, where either fails the
    /// bridge has to open; and has its flash read ahead.
    fn watch(clocks_sound: bool);

    /// Whether the supply is, or was since the last call, below what the chip needs.
    fn supply_low() -> bool;

    /// Whether the supply is high enough to close the bridge: asked in the sample that closes it.
    fn supply_allows() -> bool;

    /// Starts the window watchdog, which [`crate::stm32::Window`] feeds.
    fn start_window();

    /// What the option bytes say.
    fn set_up() -> SetUp;

    /// The converter, and its time to sample the accelerometer: with the conversion well below 50 us.
    fn converter(converter: Peri<'static, ADC1>) -> (Adc<'static, ADC1>, SampleTime);

    /// The settings in at least two pages at the end of the flash, which no image reaches.
    fn memory(flash: Peri<'static, FLASH>) -> Result<Self::Memory, StoreFailed>;

    /// What the chip shows of its last reset; the flags are cleared for the next time.
    fn signs() -> Signs;
}
