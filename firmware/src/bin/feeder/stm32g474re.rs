//! STM32G474RE on its Nucleo, from the internal oscillator.

use embassy_stm32::Peri;
use embassy_stm32::adc::{Adc, AdcConfig, SampleTime};
use embassy_stm32::interrupt;
use embassy_stm32::pac;
use embassy_stm32::peripherals::ADC1;
use kband_firmware::start::Cause;

/// Clock of core and TIM1 in Hz.
pub const CORE_CLOCK: u32 = 170_000_000;

/// The interrupt that ends a conversion.
pub const CONVERTED: pac::Interrupt = pac::Interrupt::ADC1_2;

/// The clocks.
pub fn config() -> embassy_stm32::Config {
    use embassy_stm32::rcc::*;
    let mut config = embassy_stm32::Config::default();
    config.rcc.pll = Some(Pll {
        source: PllSource::HSI,
        prediv: PllPreDiv::DIV4,
        mul: PllMul::MUL85,
        divp: None,
        divq: None,
        divr: Some(PllRDiv::DIV2),
    });
    config.rcc.boost = true;
    config.rcc.sys = Sysclk::PLL1_R;
    config.rcc.mux.adc12sel = mux::Adcsel::SYS;
    config
}

/// The converter and the time it takes to sample: 92.5 cycles at 42.5 MHz, 2.2 us.
pub fn converter(converter: Peri<'static, ADC1>) -> (Adc<'static, ADC1>, SampleTime) {
    (
        Adc::new(converter, AdcConfig::default()),
        SampleTime::CYCLES92_5,
    )
}

/// Why the chip was reset; the flags are cleared for the next time.
pub fn cause() -> Cause {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|status| status.set_rmvf(true));
    if flags.iwdgrstf() || flags.wwdgrstf() {
        Cause::Watchdog
    } else if flags.sftrstf() {
        Cause::Software
    } else {
        // This chip has one flag for power-on and brown-out: the drive waits for a new enable.
        Cause::BrownOut
    }
}

/// A sample was converted: see [`crate::board::sample`].
#[interrupt]
fn ADC1_2() {
    pac::ADC1.isr().write(|status| status.set_jeos(true));
    // SAFETY: this handler alone, once a call.
    unsafe { crate::board::sample() };
}
