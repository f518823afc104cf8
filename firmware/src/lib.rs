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
#[cfg(target_os = "none")]
pub mod chip;
#[cfg(target_os = "none")]
pub mod cortex;
pub mod enable;
pub mod exchange;
mod journal;
pub mod last_words;
pub mod link;
#[cfg(target_os = "none")]
pub mod log;
pub mod recipes;
pub mod resets;
mod saves;
pub mod selector;
pub mod start;
pub mod station;
#[cfg(target_os = "none")]
pub mod stm32;
pub mod store;
pub mod supply;
#[cfg(test)]
mod testing;
pub mod trial;
pub mod update;
pub mod waiting;
pub mod watch;
