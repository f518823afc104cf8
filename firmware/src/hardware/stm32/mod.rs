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
pub use flash::{erase_page, image_is_valid, program_words};
pub use inputs::{Terminals, recipe_inputs, strapped, watch_recipe_inputs, watch_strap};
pub use lamps::Lamps;
pub use serial::{Buffers, LINE_RATE, Serial};
pub use watchdogs::{IndependentWatchdog, count_sample, start_window_watchdog};
