//! A board as the verbs use it; the link itself is the crate `kband-link`.

mod address;
mod clock;
mod closed_loop;
mod record;

pub use address::Address;
pub use clock::Clock;
pub use closed_loop::BoardLoop;
pub use kband_link::{BoardSetting, BoardSettings, Emulated, Link, Unsolicited};
pub use record::{Remains, Said, replay};
