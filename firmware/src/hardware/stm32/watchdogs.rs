//! The independent watchdog of the tasks, and the window watchdog of the samples.

use core::sync::atomic::{AtomicU8, Ordering};
use embassy_stm32::pac;
use embassy_stm32::pac::iwdg::vals::{Key, Pr};
use embassy_stm32::pac::wwdg::regs::Cr;
use embassy_stm32::pac::wwdg::vals::Wdgtb;

/// Period of the independent watchdog as prescaler and reload: 0.8 s.
const PERIOD: (Pr, u16) = (Pr::DIVIDE_BY16, 1600);
/// Its period during an erasure of the flash: 32 s.
pub(super) const ERASURE_PERIOD: (Pr, u16) = (Pr::DIVIDE_BY256, 0xfff);
/// Core cycles for the transfer of a period to the watchdog's clock domain (32 kHz), which takes
/// five of its cycles: 0.3 ms at the 170 MHz of the fastest board.
const TRANSFER_CYCLES: u32 = 51_000;

/// Starts the independent watchdog, on its own oscillator; only a reset stops it.
pub fn start_watchdog() {
    pac::IWDG.kr().write(|key| key.set_key(Key::START));
    set_period(PERIOD);
}

/// Defers the reset by the independent watchdog by another period.
pub fn feed_watchdog() {
    pac::IWDG.kr().write(|key| key.set_key(Key::RESET));
}

/// Sets prescaler and reload of the independent watchdog and feeds it.
pub(super) fn change_period(period: (Pr, u16)) {
    set_period(period);
    cortex_m::asm::delay(TRANSFER_CYCLES);
    feed_watchdog();
}

fn set_period((prescaler, reload): (Pr, u16)) {
    let watchdog = pac::IWDG;
    watchdog.kr().write(|key| key.set_key(Key::ENABLE));
    watchdog.pr().write(|register| register.set_pr(prescaler));
    watchdog.rlr().write(|register| register.set_rl(reload));
}

/// Number of window watchdog steps (about 97 us) after a feed at which the chip is reset: 4.7 ms.
const TIMEOUT_TICKS: u8 = 48;
/// Smallest number of such steps between two feeds. Forty samples take 20 or 21 steps (97.5 us at
/// 42 MHz, 96.4 us at 42.5 MHz), 13 or 14 at 1.5 times the rate. A flash word costs two.
const MIN_FEED_TICKS: u8 = 16;
/// Number of samples between feeds of the window watchdog: 2 ms.
const FEED: u8 = 40;
/// Last count of the window watchdog before the reset.
const LAST_COUNT: u8 = 0x40;
/// Value of the window watchdog's control register that starts and feeds it.
pub(super) const WINDOW_FED: u32 = 0x80 | (LAST_COUNT + TIMEOUT_TICKS - 1) as u32;

static SAMPLED: AtomicU8 = AtomicU8::new(0);

/// Starts the window watchdog. A step is 4096 x `divider` periods of its peripheral clock.
///
/// It resets the chip, which opens the bridge, after 4.7 ms without a sample, or at 1.5 times the
/// sample rate. Its clock and the samples' clock have the same source.
pub fn start_window_watchdog(divider: Wdgtb) {
    pac::WWDG.cfr().write(|register| {
        register.set_wdgtb(divider);
        register.set_w(LAST_COUNT + TIMEOUT_TICKS - 1 - MIN_FEED_TICKS);
    });
    restart_sample_count();
    feed_window_watchdog();
}

/// Counts a sample for the window watchdog; for the sample interrupt only.
#[inline]
pub fn count_sample() {
    let samples = SAMPLED.load(Ordering::Relaxed) + 1;
    SAMPLED.store(samples % FEED, Ordering::Relaxed);
    if samples == FEED {
        feed_window_watchdog();
    }
}

/// Makes the next feed of the window watchdog 40 samples away.
pub(super) fn restart_sample_count() {
    SAMPLED.store(0, Ordering::Relaxed);
}

#[inline]
fn feed_window_watchdog() {
    pac::WWDG.cr().write_value(Cr(WINDOW_FED));
}
