//! USART2 by its registers: receives by interrupt, sends by polling.

use cortex_m::peripheral::NVIC;
use embassy_futures::yield_now;
use embassy_stm32::{interrupt, pac};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use kband_firmware::link::Line;

/// Received bytes not yet read. Further bytes are lost, and the checksum refuses their frame.
static RECEIVED: Pipe<CriticalSectionRawMutex, 384> = Pipe::new();

/// The serial port.
pub struct Serial;

/// Switches the port on.
pub fn start() {
    pac::USART2.cr1().write(|control| {
        control.set_ue(true);
        control.set_te(true);
        control.set_re(true);
        control.set_rxneie(true);
    });
    // SAFETY: no critical section relies on this interrupt's mask.
    unsafe { NVIC::unmask(pac::Interrupt::USART2) };
}

/// Receives a byte. Deadline at 115200 baud: 87 us, or the byte is lost.
#[interrupt]
fn USART2() {
    if pac::USART2.sr().read().rxne() {
        let byte = pac::USART2.dr().read().dr() as u8;
        // A full pipe loses the byte.
        let _ = RECEIVED.try_write(&[byte]);
    }
}

impl Line for Serial {
    async fn read(&mut self, bytes: &mut [u8]) -> usize {
        RECEIVED.read(bytes).await
    }

    fn send(&mut self, frame: &[u8]) -> bool {
        for &byte in frame {
            while !pac::USART2.sr().read().txe() {}
            pac::USART2.dr().write(|data| data.set_dr(u16::from(byte)));
        }
        true
    }

    async fn millisecond(&mut self) {
        yield_now().await;
    }
}
