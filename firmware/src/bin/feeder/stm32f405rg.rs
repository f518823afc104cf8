//! Chip STM32F405RG with a crystal of 8 MHz: Olimex STM32-H405 and similar boards.

use embassy_stm32::adc::{Adc, SampleTime};
use embassy_stm32::flash::Flash;
use embassy_stm32::pac::wwdg::vals::Wdgtb;
use embassy_stm32::peripherals::{ADC1, FLASH};
use embassy_stm32::time::Hertz;
use embassy_stm32::{Peri, Peripherals, interrupt, pac};
use flash::Sectors;
use kband_control::wire::SetUp;
use kband_firmware::hardware::chip::{Chip, Memory, supply_crossed, watch_supply};
use kband_firmware::hardware::cortex::{remembers_running, waiting_faults};
use kband_firmware::hardware::stm32::{drive_off, start_window_watchdog};
use kband_firmware::start::ResetFlags;
use kband_firmware::storage::store::{Records, StoreFailed};
use kband_firmware::update::Slot;

#[path = "stm32f405rg/crystal.rs"]
mod crystal;
#[path = "stm32f405rg/flash.rs"]
mod flash;
#[path = "stm32f405rg/slot.rs"]
mod slot;

/// Frequency of the board's crystal, Hz.
const CRYSTAL: u32 = 8_000_000;
/// Highest level of the supply monitor: 2.9 V (DS8626, table 19).
const HIGHEST_LEVEL: u8 = 7;

/// Interrupt at each crossing of the monitor's level. It opens the bridge first.
#[interrupt]
fn PVD() {
    drive_off();
    supply_crossed();
}

/// The board's chip.
pub struct Board;

impl Chip for Board {
    type Flash = Sectors;

    const CORE_CLOCK: u32 = 168_000_000;

    const CONVERTED: pac::Interrupt = pac::Interrupt::ADC;

    /// Selects the crystal if it oscillates at its frequency, else the internal oscillator. With
    /// another crystal the core would run far above its highest frequency.
    fn start() -> (Peripherals, bool) {
        use embassy_stm32::rcc::*;
        let clocks_ok = crystal::swings(CRYSTAL);
        let mut config = embassy_stm32::Config::default();
        config.rcc.hse = clocks_ok.then_some(Hse {
            freq: Hertz(CRYSTAL),
            mode: HseMode::Oscillator,
        });
        let (source, prediv) = if clocks_ok {
            (PllSource::HSE, PllPreDiv::DIV4)
        } else {
            (PllSource::HSI, PllPreDiv::DIV8)
        };
        config.rcc.pll_src = source;
        config.rcc.pll = Some(Pll {
            prediv,
            mul: PllMul::MUL168,
            divp: Some(PllPDiv::DIV2),
            divq: Some(PllQDiv::DIV7),
            divr: None,
        });
        config.rcc.ahb_pre = AHBPrescaler::DIV1;
        config.rcc.apb1_pre = APBPrescaler::DIV4;
        config.rcc.apb2_pre = APBPrescaler::DIV2;
        config.rcc.sys = Sysclk::PLL1_P;
        (embassy_stm32::init(config), clocks_ok)
    }

    /// A stopped crystal opens the bridge by the break of TIM1, which needs no clock. Its interrupt
    /// has no handler and resets the board. A supply below 2.9 V opens the bridge by interrupt: at
    /// 168 MHz the core needs 2.7 V.
    fn watch(clocks_ok: bool) {
        pac::RCC.cr().modify(|w| w.set_csson(clocks_ok));
        pac::PWR.cr1().modify(|control| {
            control.set_pls(HIGHEST_LEVEL);
            control.set_pvde(true);
        });
        watch_supply(pac::Interrupt::PVD);
        flash::read_ahead();
    }

    fn is_below() -> bool {
        pac::PWR.csr1().read().pvdo()
    }

    fn start_window() {
        pac::RCC.apb1enr().modify(|clocks| clocks.set_wwdgen(true));
        // Clock of 42 MHz.
        start_window_watchdog(Wdgtb::DIV1);
    }

    fn set_up() -> SetUp {
        let options = pac::FLASH.optcr().read();
        SetUp {
            // Typical thresholds for a falling supply (DS8626, table 19).
            brown_out: match options.bor_lev() {
                0 => 2830,
                1 => 2500,
                2 => 2190,
                _ => 0,
            },
            watchdog: !options.wdg_sw(),
            ..SetUp::default()
        }
    }

    /// A sampling time of 28 cycles at 21 MHz, 1.3 us, is enough for 27 kOhm.
    fn converter(converter: Peri<'static, ADC1>) -> (Adc<'static, ADC1>, SampleTime) {
        (Adc::new(converter), SampleTime::CYCLES28)
    }

    /// Settings in sectors 1 and 2, faults in sectors 3 and 4.
    fn memory(flash: Peri<'static, FLASH>) -> Result<Memory<Sectors>, StoreFailed> {
        Records::new(
            Sectors(Flash::new_blocking(flash)),
            0..2 * flash::PAGE,
            2 * flash::PAGE..4 * flash::PAGE,
            waiting_faults().ok_or(StoreFailed::Memory)?,
            Board::supply_settled,
        )
    }

    fn slot(restart: fn()) -> Slot {
        slot::slot(restart)
    }

    fn signs() -> ResetFlags {
        let flags = pac::RCC.csr().read();
        pac::RCC.csr().modify(|status| status.set_rmvf(true));
        ResetFlags {
            watchdog: flags.wdgrstf() || flags.wwdgrstf(),
            software: flags.sftrstf(),
            // Power-on sets both flags.
            sag: flags.borrstf() && !flags.porrstf(),
            remembered: remembers_running(),
        }
    }
}

/// End of a conversion: see [`crate::board::sample`].
#[interrupt]
fn ADC() {
    pac::ADC1.sr().modify(|status| status.set_jeoc(false));
    // SAFETY: only this handler calls it, once.
    unsafe { crate::board::sample() };
}
