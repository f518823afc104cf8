//! The controller of a feeder drive: measurement, estimation, decision, control.
//!
//! A drive needs two calls. [`Signal::sample`] runs in the sample interrupt at [`SAMPLE_RATE`], and
//! [`Controller::cycle`] once per drive cycle. The signal path latches its command at the next wrap
//! of the phase. [`Controller::plan_step`] plans in idle time. The code uses single precision,
//! integers and the impact map. Desk, emulator and board compute the same bits.
//!
//! `controller` runs the folders in the order of one drive cycle; ARCHITECTURE.md says what each
//! holds. The terms are defined in docs/glossary.md#the-controller.
#![no_std]
#![deny(unsafe_code)]

#[cfg(test)]
extern crate std;

mod aim;
mod angle;
mod controller;
mod drive;
mod hear;
mod identify;
mod inputs;
mod recipe;
mod report;
mod saturate;
mod settings;
mod state;
mod supervise;
mod target;
#[cfg(test)]
mod testing;

#[cfg(feature = "memo")]
pub use aim::{GearPlanned, KickResult};
pub use aim::{NoSetpoint, drive_limits};
pub use angle::{SAMPLE_RATE, phase_of, phase_step};
pub use controller::{Controller, PLAN_SLICES};
pub use drive::{LoopMargins, Shape, UPPER, UpperTone, affordable_tones};
pub use hear::{AdcCode, Command, Cycle, GearMargin, GearShare, Load, Sampled, Signal};
pub use identify::{Identification, Identified, Unidentified};
pub use inputs::{BusCommand, Inputs, StartCause};
pub use recipe::{Recipe, RecipeName};
pub use report::Report;
pub use settings::{Key, Settings};
pub use state::{Event, Events, Fault, Limits, State, TRANSITIONS, Transition};
pub use supervise::Interlock;
pub use target::Target;

/// Stages of the signal path, for a simulated feeder that computes them cycle by cycle.
pub mod signal_path {
    pub use crate::hear::{
        DetectedImpact, EnergyHistogram, HighPass, MAX_BLANKED_SHARE, MAX_IMPACTS_PER_CYCLE,
        OnsetDetector, SECTORS, SECTORS_PER_CYCLE, Sectors, SynchronousAverage, impulse_weight,
        last_cycle_gain,
    };
}
pub mod wire;
