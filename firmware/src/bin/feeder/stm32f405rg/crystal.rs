//! Frequency check of the crystal against the internal oscillator.
//!
//! Each wait has a limit, and the core never runs faster than the crystal itself.

use cortex_m::peripheral::DWT;
use embassy_stm32::pac;
use embassy_stm32::pac::iwdg::vals::Key;
use embassy_stm32::pac::rcc::vals::Sw;

/// Frequency of the internal oscillator, Hz.
const INTERNAL: u32 = 16_000_000;
/// Start-up limit of the crystal, core cycles (100 ms).
const START_TIMEOUT: u32 = INTERNAL / 10;
/// Limit of one wait for the watchdog's clock or a clock switch, core cycles (10 ms).
const STEP_TIMEOUT: u32 = INTERNAL / 100;
/// Number of register transfers to the watchdog's clock per measurement, five of its periods each.
const TRANSFERS: u32 = 8;

/// Whether the crystal oscillates within 1/8 of `nominal` Hz, measured by the internal oscillator
/// (error up to 8 %, DS8626, table 39).
///
/// Both are measured against the running independent watchdog's clock, whose own frequency cancels.
/// The core runs on the internal oscillator before and after.
pub fn swings(nominal: u32) -> bool {
    let clocks = pac::RCC;
    clocks.cr().modify(|control| control.set_hseon(true));
    let is_ready = wait_for(START_TIMEOUT, || clocks.cr().read().hserdy()) && {
        let internal = measure();
        let crystal = if run_from(Sw::HSE) { measure() } else { None };
        run_from(Sw::HSI)
            && internal
                .zip(crystal)
                .is_some_and(|(internal, crystal)| within(nominal, internal, crystal))
    };
    if !is_ready {
        clocks.cr().modify(|control| control.set_hseon(false));
    }
    is_ready
}

/// Whether the two core cycle counts over the same time fit a crystal within 1/8 of `nominal` Hz.
fn within(nominal: u32, internal: u32, crystal: u32) -> bool {
    let measured = u64::from(crystal) * u64::from(INTERNAL);
    let expected = u64::from(internal) * u64::from(nominal);
    measured.abs_diff(expected) <= expected / 8
}

fn run_from(source: Sw) -> bool {
    let clocks = pac::RCC;
    clocks.cfgr().modify(|register| register.set_sw(source));
    wait_for(STEP_TIMEOUT, || clocks.cfgr().read().sws() == source)
}

/// Core cycles of [`TRANSFERS`] transfers to the watchdog's clock; `None` if it has stopped.
fn measure() -> Option<u32> {
    // The first transfer synchronises with an edge.
    if !transfer() {
        return None;
    }
    let began = DWT::cycle_count();
    for _ in 0..TRANSFERS {
        if !transfer() {
            return None;
        }
    }
    Some(DWT::cycle_count().wrapping_sub(began))
}

fn transfer() -> bool {
    let watchdog = pac::IWDG;
    if !wait_for(STEP_TIMEOUT, || !watchdog.sr().read().pvu()) {
        return false;
    }
    let prescaler = watchdog.pr().read().pr();
    watchdog.kr().write(|key| key.set_key(Key::ENABLE));
    watchdog.pr().write(|register| register.set_pr(prescaler));
    wait_for(STEP_TIMEOUT, || !watchdog.sr().read().pvu())
}

/// Waits up to `cycles` core cycles for `is_done`; returns whether it became true.
fn wait_for(cycles: u32, is_done: impl Fn() -> bool) -> bool {
    let began = DWT::cycle_count();
    loop {
        if is_done() {
            return true;
        }
        if DWT::cycle_count().wrapping_sub(began) > cycles {
            return false;
        }
    }
}
