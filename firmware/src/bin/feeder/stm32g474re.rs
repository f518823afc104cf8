//! Chip STM32G474RE on its Nucleo board, on the internal oscillator.

use embassy_stm32::adc::{Adc, AdcConfig, SampleTime};
use embassy_stm32::flash::Flash;
use embassy_stm32::pac::wwdg::vals::Wdgtb;
use embassy_stm32::peripherals::{ADC1, FLASH};
use embassy_stm32::{Peri, Peripherals, interrupt, pac};
use flash::Pages;
use kband_control::wire::SetUp;
use kband_firmware::hardware::chip::{Chip, Memory, supply_crossed, watch_supply};
use kband_firmware::hardware::cortex::{remembers_running, waiting_faults};
use kband_firmware::hardware::stm32::start_window_watchdog;
use kband_firmware::start::ResetFlags;
use kband_firmware::storage::store::{Records, StoreFailed};
use kband_firmware::update::{Slot, Writer};
use kband_loader::layout::stm32g474::{BOARD, NOTE, SLOT};
use kband_loader::note::Note;

#[path = "stm32g474re/flash.rs"]
mod flash;

/// Highest level of the supply monitor: 2.9 V (DS12288, table 21).
const HIGHEST_LEVEL: u8 = 6;

/// Bit R1MODE of PWR_CR5: range 1 without boost (RM0440, 6.4.5).
const NORMAL_RANGE_1: u32 = 1 << 8;

fn exchange_note(note: Note) -> Note {
    let place = NOTE as *mut Note;
    // SAFETY: one task uses this RAM, which lies behind all data; any bytes are a valid `Note`.
    unsafe {
        let before = place.read_volatile();
        place.write_volatile(note);
        before
    }
}

/// Interrupt at each crossing of the monitor's level, at which TIM1's break opens the bridge.
#[interrupt]
fn PVD_PVM() {
    supply_crossed();
}

/// The board's chip.
pub struct Board;

impl Chip for Board {
    type Flash = Pages;

    const CORE_CLOCK: u32 = 170_000_000;

    const CONVERTED: pac::Interrupt = pac::Interrupt::ADC1_2;

    /// Range 1 boost; without it the core may run at 150 MHz at most (RM0440, 6.1.5).
    /// `stm32-metapac` 21.0.0 places R1MODE at bit 0 of PWR_CR5, but it is bit 8. So the chip
    /// starts on its 16 MHz oscillator and gets the fast clock after the bit is clear.
    fn start() -> (Peripherals, bool) {
        use embassy_stm32::rcc::*;
        let mut peripherals = embassy_stm32::init(embassy_stm32::Config::default());
        pac::PWR.cr5().modify(|w| w.0 &= !NORMAL_RANGE_1);
        let mut config = Config::default();
        config.pll = Some(Pll {
            source: PllSource::HSI,
            prediv: PllPreDiv::DIV4,
            mul: PllMul::MUL85,
            divp: None,
            divq: None,
            divr: Some(PllRDiv::DIV2),
        });
        config.boost = true;
        config.sys = Sysclk::PLL1_R;
        config.mux.adc12sel = mux::Adcsel::SYS;
        reinit(config, &mut peripherals.RCC);
        (peripherals, true)
    }

    /// The internal oscillator stops with the chip. A supply below 2.9 V, a core lock-up and a
    /// flash error open the bridge by the break of TIM1, without the program.
    fn watch(_clocks_ok: bool) {
        pac::PWR.cr2().modify(|control| {
            control.set_pls(HIGHEST_LEVEL);
            control.set_pvde(true);
        });
        pac::RCC.apb2enr().modify(|w| w.set_syscfgen(true));
        pac::SYSCFG.cfgr2().modify(|breaks| {
            breaks.set_pvdl(true);
            breaks.set_cll(true);
            breaks.set_eccl(true);
        });
        watch_supply(pac::Interrupt::PVD_PVM);
        pac::FLASH.acr().modify(|access| access.set_prften(true));
    }

    fn is_below() -> bool {
        pac::PWR.sr2().read().pvdo()
    }

    fn start_window() {
        pac::RCC.apb1enr1().modify(|clocks| clocks.set_wwdgen(true));
        // 170 MHz divided by 4.
        start_window_watchdog(Wdgtb::DIV4);
    }

    fn set_up() -> SetUp {
        let options = pac::FLASH.optr().read();
        SetUp {
            // Typical thresholds of a falling supply (DS12288, table 21); level 0 is power-on.
            brown_out: match options.bor_lev() {
                1 => 2000,
                2 => 2200,
                3 => 2490,
                4 => 2760,
                _ => 0,
            },
            watchdog: !options.idwg_sw(),
            ..SetUp::default()
        }
    }

    /// Sets up the converter with a sampling time of 47.5 cycles at 42.5 MHz, 1.1 us.
    fn converter(converter: Peri<'static, ADC1>) -> (Adc<'static, ADC1>, SampleTime) {
        let converter = Adc::new(converter, AdcConfig::default());
        (converter, SampleTime::CYCLES47_5)
    }

    /// Settings in the last two pages of 2 KiB of the second bank, faults in the two before them.
    fn memory(flash: Peri<'static, FLASH>) -> Result<Memory<Pages>, StoreFailed> {
        let region = (Flash::new_blocking(flash).into_blocking_regions()).bank2_region;
        let (end, page) = (region.0.size, region.0.erase_size);
        Records::new(
            Pages(region),
            end - 2 * page..end,
            end - 4 * page..end - 2 * page,
            waiting_faults().ok_or(StoreFailed::Memory)?,
            Board::supply_settled,
        )
    }

    fn slot(restart: fn()) -> Slot {
        Slot {
            board: BOARD,
            size: SLOT.end - SLOT.start,
            restart,
            writer: Writer::Loader(|key| _ = exchange_note(Note::request(*key))),
        }
    }

    fn signs() -> ResetFlags {
        let flags = pac::RCC.csr().read();
        pac::RCC.csr().modify(|status| status.set_rmvf(true));
        let remembered = remembers_running();
        if exchange_note(Note::NONE) == Note::STARTED {
            return ResetFlags::default();
        }
        ResetFlags {
            watchdog: flags.iwdgrstf() || flags.wwdgrstf(),
            software: flags.sftrstf(),
            // One flag for power-on and brown-out: the preserved mark in RAM tells them apart.
            sag: false,
            remembered,
        }
    }
}

/// End of a conversion: see [`crate::board::sample`].
#[interrupt]
fn ADC1_2() {
    pac::ADC1.isr().write(|status| status.set_jeos(true));
    // SAFETY: only this handler calls it, once.
    unsafe { crate::board::sample() };
}
