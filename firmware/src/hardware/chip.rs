//! Interface of a chip to its board: the differences between the STM32s.
//!
//! A new board is a file in `src/bin/feeder` that implements [`Chip`] for its `Board`, and a
//! description of its memory, `NAME.x`, in this crate's folder. Both have the name of the cargo
//! feature that selects the board. `main.rs` names the file.

use crate::inputs::supply::Supply;
use crate::start::ResetFlags;
use crate::storage::store::{Records, StoreFailed};
use crate::storage::waiting::Waiting;
use crate::update::Slot;
use cortex_m::peripheral::NVIC;
use embassy_stm32::adc::{Adc, SampleTime};
use embassy_stm32::pac::{self, Interrupt};
use embassy_stm32::peripherals::{ADC1, FLASH};
use embassy_stm32::{Peri, Peripherals};
use embassy_time::Instant;
use embedded_storage_async::nor_flash::NorFlash;
use kband_control::wire::SetUp;

/// EXTI line of the supply monitor.
const SUPPLY_LINE: usize = 16;

static SUPPLY: Supply = Supply::new();

/// Records a crossing of the supply monitor's level, in its interrupt.
pub fn supply_crossed() {
    SUPPLY.falls();
    pac::EXTI.pr(0).write(|w| w.set_line(SUPPLY_LINE, true));
}

/// Enables the interrupt of the supply monitor at both edges.
pub fn watch_supply(interrupt: Interrupt) {
    for edges in [pac::EXTI.rtsr(0), pac::EXTI.ftsr(0), pac::EXTI.imr(0)] {
        edges.modify(|lines| lines.set_line(SUPPLY_LINE, true));
    }
    // SAFETY: no critical section relies on this interrupt's mask; its handler uses atomics and
    // registers.
    unsafe { NVIC::unmask(interrupt) };
}

fn now() -> u32 {
    Instant::now().as_millis() as u32
}

/// Memory of settings and faults; faults wait in RAM that a reset leaves unchanged.
pub type Memory<F> = Records<F, &'static mut Waiting>;

/// The chip of a board.
pub trait Chip {
    /// Clock of core and TIM1 in Hz.
    const CORE_CLOCK: u32;

    /// The interrupt that ends a conversion. Its handler is in the chip's file: it clears the
    /// converter's flag and takes the sample, within 50 us.
    const CONVERTED: Interrupt;

    /// Flash of settings and faults.
    type Flash: NorFlash;

    /// Starts the clocks, with [`Chip::CORE_CLOCK`] for the core, and APB1 for 115200 baud within 2
    /// %. The independent watchdog already runs; each wait here has a limit. Returns the
    /// peripherals, and whether the clocks are the configured ones; otherwise the drive stays off.
    fn start() -> (Peripherals, bool);

    /// Monitors oscillator and supply: a failure opens the bridge. Switches the flash prefetch on.
    fn watch(clocks_ok: bool);

    /// Whether the supply is below the monitor's level, 2.9 V.
    fn is_below() -> bool;

    /// Whether the supply is low, or was since the last call.
    fn supply_low() -> bool {
        SUPPLY.take_is_low(Self::is_below(), now())
    }

    /// Whether the supply was good for the settling time.
    fn supply_settled() -> bool {
        SUPPLY.is_settled(Self::is_below(), now())
    }

    /// Whether the supply is high enough to close the bridge; read in the sample that closes it.
    fn supply_allows() -> bool {
        !SUPPLY.has_fallen() && !Self::is_below()
    }

    /// Starts the window watchdog, which [`crate::hardware::stm32::count_sample`] feeds.
    fn start_window();

    /// Configuration in the option bytes.
    fn set_up() -> SetUp;

    /// Sets up the converter with the sampling time of its channels; both take well below 50 us.
    fn converter(converter: Peri<'static, ADC1>) -> (Adc<'static, ADC1>, SampleTime);

    /// Opens the settings and the faults in four pages of the flash, which no image reaches.
    fn memory(flash: Peri<'static, FLASH>) -> Result<Memory<Self::Flash>, StoreFailed>;

    /// The slot for an update; `restart` restarts the board.
    fn slot(restart: fn()) -> Slot;

    /// Flags of the last reset; the call clears them.
    fn signs() -> ResetFlags;
}
