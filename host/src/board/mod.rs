//! A board on the link: a real one on a serial port, or the emulated CPU.

mod address;
mod closed_loop;
mod line;
mod record;
mod serial;
mod settings;
mod tether;

pub use address::{Address, Emulated};
pub use closed_loop::BoardLoop;
pub use line::{Line, Unasked};
pub use record::{Remains, Said, replay};
pub use settings::{BoardSetting, BoardSettings};
