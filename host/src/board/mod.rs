//! Boards for the verbs; the link is in the crate `kband-link`.

mod address;
mod closed_loop;
mod record;

pub use address::Address;
pub(crate) use closed_loop::BoardLoop;
pub use kband_link::Emulated;
pub(crate) use kband_link::{BoardMessage, BoardSetting, BoardSettings, Link};
pub(crate) use record::NEXT;
pub use record::replay;
