//! The serial port of the link.

use crate::link::Line;
use core::task::Poll;
use embassy_futures::poll_once;
use embassy_stm32::Peri;
use embassy_stm32::interrupt::{self, typelevel::Binding};
use embassy_stm32::peripherals::{PA2, PA3, USART2};
use embassy_stm32::usart::{BufferedInterruptHandler, BufferedUart, ConfigError};
use embassy_time::Timer;
use embedded_io_async::{Read, Write};

/// Rate of the link, bytes a second: 115200 baud, ten bits a byte.
pub const LINE_RATE: u32 = 11_520;

/// The link's serial port: USART2, 115200 baud, sends on PA2 and receives on PA3.
pub struct Serial(BufferedUart<'static>);

impl Serial {
    /// Opens the port; it sends and receives by these buffers.
    ///
    /// # Errors
    /// The clocks do not give its baud rate.
    pub fn new(
        port: Peri<'static, USART2>,
        receive: Peri<'static, PA3>,
        send: Peri<'static, PA2>,
        interrupts: impl Binding<interrupt::typelevel::USART2, BufferedInterruptHandler<USART2>>
        + 'static,
        [sent, received]: &'static mut [[u8; 512]; 2],
    ) -> Result<Self, ConfigError> {
        let config = embassy_stm32::usart::Config::default();
        let port = BufferedUart::new(port, receive, send, sent, received, interrupts, config);
        port.map(Self)
    }
}

impl Line for Serial {
    async fn read(&mut self, bytes: &mut [u8]) -> usize {
        // Noise loses bytes, and the frame's checksum then rejects the frame.
        Read::read(&mut self.0, bytes).await.unwrap_or(0)
    }

    /// `embassy-stm32` 0.6.0 (usart/buffered.rs, `BufferedUartTx::write`) accepts a whole frame, or
    /// returns `Pending` without a waker. An await might then never end, so the future is polled
    /// once. Check this at each update of the crate.
    fn send(&mut self, frame: &[u8]) -> bool {
        let written = poll_once(Write::write(&mut self.0, frame));
        matches!(written, Poll::Ready(Ok(_)))
    }

    async fn millisecond(&mut self) {
        Timer::after_millis(1).await;
    }
}
