//! Log of the board for a debug probe.

use crate::hardware::cortex::IDENTITY;
use crate::start::ResetCause;
use crate::storage::last_words::LastWords;
use kband_control::{Event, Report, Settings};

/// Logs the image, the cause of the start and the last words.
pub fn start(cause: ResetCause, last_words: &LastWords) {
    defmt::info!("kband {}, started by {}", IDENTITY, cause.name());
    if let Some(words) = last_words.read() {
        defmt::error!("before this reset: {}", words);
    }
}

/// Logs each setting that is missing in the stored record, with its default; bit n of `added` is
/// for `Settings::KEYS[n]`.
pub fn new_settings(added: u64) {
    for (number, key) in Settings::KEYS.iter().enumerate() {
        if added >> number & 1 == 1 {
            defmt::info!(
                "settings: {} is new, {} {}",
                key.name,
                key.default,
                key.unit
            );
        }
    }
}

/// Logs the events of a cycle.
pub fn report(report: &Report) {
    for event in report.events.iter() {
        defmt::info!(
            "cycle {}: {} (k {}, b {} mm)",
            report.cycle,
            event.name(),
            report.k,
            report.amplitude * 1e3
        );
        if let (Event::Faulted, Some(fault)) = (event, report.fault) {
            defmt::error!("fault {}: {}", fault.number(), fault.name());
        }
        if let (Event::Weighed, Some(load)) = (event, report.load) {
            defmt::info!("weighed: {} g, {} g/s", load.mass, load.flow);
        }
    }
}
