//! Modbus RTU of the board: its line, its registers, and the task that answers.

pub mod line;
mod machine;
#[cfg(target_os = "none")]
pub mod uart;

use embassy_futures::select::{Either, select};
use kband_bus::Answer;
use kband_bus::rtu::{self, MAX_FRAME_BYTES};
use kband_control::Settings;

pub use line::BusLine;

use crate::station::Station;
pub(crate) use machine::Registers;

/// Parity of the characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parity {
    /// None, with a second stop bit.
    None,
    /// Odd.
    Odd,
    /// Even.
    Even,
}

/// Configuration of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineConfig {
    /// Address of the board, 1..=247.
    pub unit: u8,
    /// Rate, baud.
    pub baud: u32,
    /// Parity.
    pub parity: Parity,
}

impl LineConfig {
    /// The configuration of these settings; `None` if the bus is off.
    pub fn of(settings: &Settings) -> Option<Self> {
        let unit = settings.bus_address as u8;
        (unit > 0).then_some(Self {
            unit,
            baud: settings.bus_baud as u32,
            parity: match settings.bus_parity as u8 {
                0 => Parity::None,
                1 => Parity::Odd,
                _ => Parity::Even,
            },
        })
    }
}

/// The serial port of the bus. Its interrupt exchanges bytes with the [`BusLine`].
pub trait BusPort {
    /// Drops transfers in progress, disables the driver, and listens with another configuration;
    /// `None` switches the port off.
    fn configure(&mut self, config: Option<LineConfig>);

    /// Enables the driver and sends the bytes of the line. The interrupt at the end of the last
    /// stop bit disables the driver.
    fn start_sending(&mut self);
}

/// The task of the bus. It has no control deadline and no watchdog. If it hangs, the drive behaves
/// as for a lost link (limit 7).
pub async fn bus(mut port: impl BusPort, station: &Station, image: &'static str) -> ! {
    let line = &station.exchange.bus;
    let mut in_use = None;
    let mut frame = [0; MAX_FRAME_BYTES];
    let mut answer = Answer::new();
    loop {
        let config = LineConfig::of(&station.settings());
        if config != in_use {
            port.configure(config);
            in_use = config;
        }
        let changed = station.bus.settings_changed.wait();
        let length = match select(line.frame(&mut frame), changed).await {
            Either::First(length) => length,
            Either::Second(()) => continue,
        };
        let unit = in_use.map_or(rtu::BROADCAST, |config| config.unit);
        let mut registers = Registers {
            station,
            image,
            read_only: false,
        };
        let request = frame.get(..length).unwrap_or_default();
        let mut server = station.bus.server.borrow_mut();
        if rtu::answer(&mut server, unit, request, &mut registers, &mut answer) {
            if line.send(&answer) {
                port.start_sending();
            }
        } else {
            line.listen();
        }
    }
}

#[cfg(test)]
mod tests;
