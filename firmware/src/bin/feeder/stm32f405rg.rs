//! STM32F405RG with a crystal of 8 MHz: Olimex STM32-H405 and its like.

use embassy_stm32::Peri;
use embassy_stm32::adc::{Adc, SampleTime};
use embassy_stm32::flash::{Bank1Region3, Blocking, Flash};
use embassy_stm32::interrupt;
use embassy_stm32::pac;
use embassy_stm32::peripherals::{ADC1, FLASH};
use embassy_stm32::time::Hertz;
use kband_firmware::chip::Chip;
use kband_firmware::cortex::remembers_running;
use kband_firmware::start::Signs;
use kband_firmware::stm32::Pages;
use kband_firmware::store::{Records, StoreFailed};

/// The board's chip.
pub struct Board;

impl Chip for Board {
    type Memory = Records<Pages<Bank1Region3<'static, Blocking>>>;

    const CORE_CLOCK: u32 = 168_000_000;

    const CONVERTED: pac::Interrupt = pac::Interrupt::ADC;

    fn clocks() -> embassy_stm32::Config {
        use embassy_stm32::rcc::*;
        let mut config = embassy_stm32::Config::default();
        config.rcc.hse = Some(Hse {
            freq: Hertz(8_000_000),
            mode: HseMode::Oscillator,
        });
        config.rcc.pll_src = PllSource::HSE;
        config.rcc.pll = Some(Pll {
            prediv: PllPreDiv::DIV4,
            mul: PllMul::MUL168,
            divp: Some(PllPDiv::DIV2),
            divq: Some(PllQDiv::DIV7),
            divr: None,
        });
        config.rcc.ahb_pre = AHBPrescaler::DIV1;
        config.rcc.apb1_pre = APBPrescaler::DIV4;
        config.rcc.apb2_pre = APBPrescaler::DIV2;
        config.rcc.sys = Sysclk::PLL1_P;
        config
    }

    /// Has the chip watch its crystal: where that stops, the bridge opens by the break of TIM1, which needs no
    /// clock, and an interrupt without a handler resets the board.
    fn watch_clock() {
        pac::RCC.cr().modify(|control| control.set_csson(true));
    }

    /// The converter and the time it takes to sample: 56 cycles at 21 MHz, 2.7 us.
    fn converter(converter: Peri<'static, ADC1>) -> (Adc<'static, ADC1>, SampleTime) {
        (Adc::new(converter), SampleTime::CYCLES56)
    }

    /// The settings lie in the last two sectors of 128 KiB, the faults in the two before them.
    fn memory(flash: Peri<'static, FLASH>) -> Result<Self::Memory, StoreFailed> {
        let region = Flash::new_blocking(flash)
            .into_blocking_regions()
            .bank1_region3;
        let (end, page) = (region.0.size, region.0.erase_size);
        Records::new(
            Pages(region),
            end - 2 * page..end,
            end - 4 * page..end - 2 * page,
        )
    }

    fn signs() -> Signs {
        let flags = pac::RCC.csr().read();
        pac::RCC.csr().modify(|status| status.set_rmvf(true));
        Signs {
            watchdog: flags.wdgrstf() || flags.wwdgrstf(),
            software: flags.sftrstf(),
            // Power-on sets both.
            sag: flags.borrstf() && !flags.porrstf(),
            remembered: remembers_running(),
        }
    }
}

/// A sample was converted: see [`crate::board::sample`].
#[interrupt]
fn ADC() {
    pac::ADC1.sr().modify(|status| status.set_jeoc(false));
    // SAFETY: this handler alone, once a call.
    unsafe { crate::board::sample() };
}
