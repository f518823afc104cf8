//! The feeder drive application over small traits.
//!
//! The same code runs on the board, on an emulated CPU and at the desk; only the traits of [`board`]
//! differ. Three things run, in order of urgency:
//!
//! | what | when | deadline | does |
//! |---|---|---|---|
//! | sample interrupt | 20 kHz | 50 us | drive phase, sample, enable input, demodulation, drive output; nothing else |
//! | cycle task | each drive cycle | one drive cycle (20 ms at 50 Hz) | control, supervision, report |
//! | planning, link, supervision of the tasks | when the others rest | none | may be late, never hinders the others |
#![no_std]

#[cfg(test)]
extern crate std;

pub mod access;
pub mod application;
pub mod board;
#[cfg(target_os = "none")]
pub mod chip;
#[cfg(target_os = "none")]
pub mod cortex;
pub mod enable;
pub mod exchange;
pub mod journal;
pub mod last_words;
pub mod link;
#[cfg(target_os = "none")]
pub mod log;
pub mod resets;
pub mod saves;
pub mod start;
pub mod station;
#[cfg(target_os = "none")]
pub mod stm32;
pub mod store;
pub mod supply;
pub mod trial;
pub mod waiting;
pub mod watch;
