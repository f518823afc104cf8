//! The log on USART1. The board keeps it in memory that a debug probe reads.

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicBool, Ordering};

use embassy_stm32::pac;
use embassy_time::Instant;

defmt::timestamp!("{=u64:ms}", Instant::now().as_millis());

#[defmt::global_logger]
struct Logger;

struct Encoder(UnsafeCell<defmt::Encoder>);

// SAFETY: used between `acquire`, which panics while it is in use, and `release`.
unsafe impl Sync for Encoder {}

static ENCODER: Encoder = Encoder(UnsafeCell::new(defmt::Encoder::new()));
static TAKEN: AtomicBool = AtomicBool::new(false);

/// Switches the port on.
pub fn start() {
    pac::USART1.cr1().write(|control| {
        control.set_ue(true);
        control.set_te(true);
    });
}

fn send(bytes: &[u8]) {
    for &byte in bytes {
        while !pac::USART1.sr().read().txe() {}
        pac::USART1.dr().write(|data| data.set_dr(u16::from(byte)));
    }
}

// SAFETY: tasks of one executor log, no interrupt does; each frame ends before the next begins.
unsafe impl defmt::Logger for Logger {
    fn acquire() {
        assert!(!TAKEN.swap(true, Ordering::Relaxed), "a log within a log");
        // SAFETY: taken just now.
        unsafe { &mut *ENCODER.0.get() }.start_frame(send);
    }

    unsafe fn flush() {}

    unsafe fn release() {
        // SAFETY: acquired, as the caller guarantees.
        unsafe { &mut *ENCODER.0.get() }.end_frame(send);
        TAKEN.store(false, Ordering::Relaxed);
    }

    unsafe fn write(bytes: &[u8]) {
        // SAFETY: acquired, as the caller guarantees.
        unsafe { &mut *ENCODER.0.get() }.write(bytes, send);
    }
}
