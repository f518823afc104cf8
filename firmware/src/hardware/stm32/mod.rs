//! Hardware layer of the STM32 boards.
//!
//! The pins are the same on every board, so that one wiring page applies to all.

mod bridge;
mod converter;
mod flash;
mod inputs;
mod lamps;
mod serial;
mod watchdogs;

pub use bridge::{HalfBridge, drive_off, forget_break};
pub use converter::Converter;
pub use flash::{erase_page, erase_pages, image_is_valid, program_words};
pub use inputs::{Terminals, pull_inputs_up, recipe_inputs, strapped};
pub use lamps::Lamps;
pub use serial::{LINE_RATE, Serial};
pub use watchdogs::{count_sample, feed_watchdog, start_watchdog, start_window_watchdog};
