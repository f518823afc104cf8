//! The link to a board: a serial port, or the emulated CPU.
//!
//! | module | holds |
//! |---|---|
//! | [`emulator`] | the emulated CPU as a process |
//! | [`serial`] | serial ports |
//! | `link` | requests to a board and its answers, each with a time limit |
//! | `settings` | the settings of a board |
//! | `update` | an update of its firmware |

pub mod emulator;
mod link;
pub mod serial;
mod settings;
mod update;

pub use emulator::Emulated;
pub use link::{BoardMessage, CheckStop, Link};
pub use settings::{BoardSetting, BoardSettings, set_all};
