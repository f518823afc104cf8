//! UART4 as the port of the bus: sends on PC10, receives on PC11, enables the driver on PC12.
//!
//! The chip of the default board drives no enable pin by itself. A task would lower the pin too
//! late: a slice of planning takes up to 14 ms, a character at 19200 baud 0.57 ms. So the interrupt
//! at the end of the last stop bit lowers it.

use super::{BusLine, BusPort, LineConfig, Parity};
use embassy_stm32::gpio::{AfType, Flex, Level, Output, OutputType, Pull, Speed};
use embassy_stm32::pac::usart::vals::{M0, Ps, Stop};
use embassy_stm32::peripherals::{PC10, PC11, PC12, UART4};
use embassy_stm32::usart::{RxPin, TxPin};
use embassy_stm32::{Peri, pac, rcc};
use kband_bus::rtu::silence_us;

/// Pin number of the driver's enable on port C.
const ENABLE: usize = 12;

/// The port.
pub struct Uart {
    line: &'static BusLine,
    /// Frequency of the port's clock, Hz.
    clock: u32,
}

impl Uart {
    /// Sets up the pins, with the driver disabled, and the port's clock.
    pub fn new(
        line: &'static BusLine,
        _port: Peri<'static, UART4>,
        send: Peri<'static, PC10>,
        receive: Peri<'static, PC11>,
        enable: Peri<'static, PC12>,
    ) -> Self {
        // `forget` keeps the pin configured while the program runs.
        core::mem::forget(Output::new(enable, Level::Low, Speed::Low));
        let send_function = TxPin::<UART4>::af_num(&*send);
        let receive_function = RxPin::<UART4>::af_num(&*receive);
        let (mut send, mut receive) = (Flex::new(send), Flex::new(receive));
        let output = AfType::output(OutputType::PushPull, Speed::Low);
        send.set_as_af_unchecked(send_function, output);
        receive.set_as_af_unchecked(receive_function, AfType::input(Pull::Up));
        core::mem::forget((send, receive));
        rcc::enable_and_reset::<UART4>();
        Self::with_clock(line, rcc::frequency::<UART4>().0)
    }

    /// The port without pins, for a machine that has none; `clock` of the port in Hz.
    pub fn with_clock(line: &'static BusLine, clock: u32) -> Self {
        Self { line, clock }
    }
}

impl BusPort for Uart {
    fn configure(&mut self, config: Option<LineConfig>) {
        let port = pac::UART4;
        port.cr1().write(|_| {});
        disable_driver();
        let Some(LineConfig { baud, parity, .. }) = config else {
            return;
        };
        self.line.restart(silence_us(baud));
        let divider = (self.clock + baud / 2) / baud.max(1);
        port.brr().write(|rate| rate.set_brr(divider as u16));
        port.cr2().write(|control| {
            control.set_stop(match parity {
                Parity::None => Stop::STOP2,
                Parity::Odd | Parity::Even => Stop::STOP1,
            });
        });
        port.cr1().write(|control| {
            if parity != Parity::None {
                // Nine bits, parity included.
                control.set_m0(M0::BIT9);
                control.set_pce(true);
                let is_odd = parity == Parity::Odd;
                control.set_ps(if is_odd { Ps::ODD } else { Ps::EVEN });
            }
            control.set_te(true);
            control.set_re(true);
            control.set_rxneie(true);
            control.set_ue(true);
        });
    }

    fn start_sending(&mut self) {
        pac::GPIOC.bsrr().write(|pins| pins.set_bs(ENABLE, true));
        pac::UART4.cr1().modify(|control| control.set_txeie(true));
    }
}

fn disable_driver() {
    pac::GPIOC.bsrr().write(|pins| pins.set_br(ENABLE, true));
}

#[cfg(feature = "stm32f405rg")]
mod registers {
    use super::pac::{self, usart::regs::Sr};

    pub fn status() -> Sr {
        pac::UART4.sr().read()
    }

    /// Reads the byte; after a read of the status this clears the receiver's flags.
    pub fn read() -> u8 {
        pac::UART4.dr().read().dr() as u8
    }

    pub fn write(byte: u8) {
        pac::UART4.dr().write(|data| data.set_dr(byte.into()));
    }
}

#[cfg(feature = "stm32g474re")]
mod registers {
    use super::pac::{self, usart::regs::Isr};

    pub fn status() -> Isr {
        pac::UART4.isr().read()
    }

    /// Reads the byte and clears the receiver's flags.
    pub fn read() -> u8 {
        pac::UART4.icr().write(|clear| {
            clear.set_pe(true);
            clear.set_fe(true);
            clear.set_ne(true);
            clear.set_ore(true);
        });
        pac::UART4.rdr().read().dr() as u8
    }

    pub fn write(byte: u8) {
        pac::UART4.tdr().write(|data| data.set_dr(byte.into()));
    }
}

/// The port's interrupt: a received byte, room for the next one, or the end of the answer. `now` in
/// us, wrapping.
///
/// Deadline: one character, 95 us at 115200 baud.
#[inline]
pub fn interrupt(line: &BusLine, now: u32) {
    let port = pac::UART4;
    let status = registers::status();
    if status.rxne() || status.ore() {
        let damaged = status.pe() || status.fe() || status.ne() || status.ore();
        let byte = registers::read();
        line.receive((!damaged).then_some(byte), now);
    }
    let control = port.cr1().read();
    if status.txe() && control.txeie() {
        match line.next() {
            Some(byte) => registers::write(byte),
            None => port.cr1().modify(|control| {
                control.set_txeie(false);
                control.set_tcie(true);
            }),
        }
    } else if status.tc() && control.tcie() {
        disable_driver();
        port.cr1().modify(|control| control.set_tcie(false));
        line.end_sending();
    }
}
