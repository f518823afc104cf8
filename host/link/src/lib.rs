//! The link to a board: a serial port, or the emulated CPU.

pub mod emulator;
mod link;
pub mod serial;
mod settings;
mod update;

pub use emulator::Emulated;
pub use link::{BoardMessage, CheckStop, Link};
pub use settings::{BoardSetting, BoardSettings, set_all};
