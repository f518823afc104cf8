//! A board on the link: a real one on a serial port, or the emulated CPU.

mod address;
mod clock;
mod closed_loop;
mod emulator;
mod link;
mod record;
mod serial;
mod settings;
mod tether;

pub use address::Address;
pub use clock::Clock;
pub use closed_loop::BoardLoop;
pub use emulator::Emulated;
pub use link::{Link, Unsolicited};
pub use record::{Remains, Said, replay};
pub use settings::{BoardSetting, BoardSettings};
