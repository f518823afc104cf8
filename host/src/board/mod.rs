//! Boards for the verbs; the link is in the crate `kband-link`.

mod address;
mod closed_loop;
mod record;

pub use address::Address;
pub(crate) use closed_loop::BoardLoop;
pub use kband_link::Emulated;
pub(crate) use kband_link::{BoardSetting, BoardSettings, Link, Unsolicited};
pub use record::replay;
pub(crate) use record::{BoardMessage, NEXT};
