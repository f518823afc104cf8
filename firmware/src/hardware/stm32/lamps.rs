//! The lamps READY and FAULT.

use crate::hardware::log;
use embassy_stm32::Peri;
use embassy_stm32::gpio::{Level, Output, Speed};
use embassy_stm32::peripherals::{PB11, PC2};
use kband_control::Report;

/// Outputs: ready on PC2 (the target is met), fault on PB11.
pub struct Lamps {
    ready: Output<'static>,
    fault: Output<'static>,
}

impl Lamps {
    /// Sets up the outputs, both off.
    pub fn new(ready: Peri<'static, PC2>, fault: Peri<'static, PB11>) -> Self {
        Self {
            ready: Output::new(ready, Level::Low, Speed::Low),
            fault: Output::new(fault, Level::Low, Speed::Low),
        }
    }

    /// Shows the report of a drive cycle, and whether the target is met; logs its events.
    pub fn report(&mut self, report: &Report, ready: bool) {
        self.ready.set_level(ready.into());
        self.fault.set_level(report.fault.is_some().into());
        log::report(report);
    }
}
