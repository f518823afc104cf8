//! The board's log: what happened, for whoever looks through a probe.

use kband::control::{Event, Report};

use crate::cortex::IDENTITY;
use crate::last_words::LastWords;
use crate::start::ResetCause;

/// Which image started, why, and what was said last before.
pub fn start(cause: ResetCause, last_words: &LastWords) {
    defmt::info!("kband {}, started by {}", IDENTITY, cause.name());
    if let Some(words) = last_words.read() {
        defmt::error!("before this reset: {}", words);
    }
}

/// The events of a cycle.
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
