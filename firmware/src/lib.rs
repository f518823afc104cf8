//! The feeder drive application over small traits.
//!
//! The same code runs on the board, on an emulated CPU and at the desk; only the traits of
//! [`board`] differ. Three activities run, in order of urgency:
//!
//! - The sample interrupt (20 kHz, deadline 50 us): drive phase, sample, enable input,
//!   demodulation, drive output; nothing else.
//! - The cycle task, once a drive cycle (20 ms at 50 Hz, which is its deadline): control,
//!   supervision, report.
//! - Planning, link and task supervision, when the others rest: they have no deadline and never
//!   delay the others.
#![no_std]

#[cfg(test)]
extern crate std;

mod access;
pub mod application;
pub mod board;
pub mod bus;
pub mod exchange;
#[cfg(target_os = "none")]
pub mod hardware;
pub mod inputs;
pub mod link;
pub mod start;
pub mod station;
pub mod storage;
#[cfg(test)]
mod testing;
pub mod trial;
pub mod update;
pub mod watch;
