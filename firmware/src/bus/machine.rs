//! The board behind the registers.

use crate::station::Station;
use kband_bus::{Authority, Exception, Machine, SaveProgress, Snapshot};
use kband_control::wire::{Access, Record, Refusal, Telemetry};
use kband_control::{Settings, Target};

/// A station, as the bus server accesses it.
pub struct Registers<'a> {
    pub station: &'a Station,
    pub image: &'static str,
    /// Whether nothing may be written, regardless of the settings.
    pub read_only: bool,
}

impl Machine for Registers<'_> {
    fn snapshot(&self) -> Snapshot<'_> {
        let station = self.station;
        Snapshot {
            telemetry: Telemetry::from(&station.report()),
            status: station.status(Access::Full),
            authority: if self.read_only {
                Authority::Read
            } else {
                Authority::of(&station.settings())
            },
            target: station.target(),
            save: station.bus.save.get(),
            events: station.log.borrow().next,
            missed: station.exchange.missed(),
            writable: station.bus.writable.get(),
            image: self.image,
        }
    }

    fn settings(&self) -> Settings {
        self.station.settings()
    }

    fn event(&self, number: u32) -> Option<Record> {
        let record = self.station.event(number)?;
        (record.number == number).then_some(record)
    }

    fn set_target(&mut self, target: Target) -> Result<(), Exception> {
        self.station.set_target(target).map_err(exception)
    }

    fn set_settings(&mut self, settings: &Settings) -> Result<(), Exception> {
        self.station.set_settings(settings).map_err(exception)
    }

    fn save(&mut self) -> Result<(), Exception> {
        match self.station.bus.save.replace(SaveProgress::Pending) {
            SaveProgress::Pending => Err(Exception::Busy),
            _ => Ok(()),
        }
    }

    fn select_recipe(&mut self, recipe: u16) -> Result<(), Exception> {
        let number = u8::try_from(recipe).map_err(|_| Exception::Value)?;
        self.station.use_recipe(number).map_err(exception)
    }
}

fn exception(refusal: Refusal<'_>) -> Exception {
    match refusal {
        Refusal::Running => Exception::Busy,
        _ => Exception::Value,
    }
}
