//! Tracks of several tones: launches that try a map, the oracle that judges it, and their soak.

mod launches;
mod oracle;
mod soak;

pub use launches::{Kind, edge, track};
pub use oracle::Track;
pub use soak::{NAMES, Seen, Tally, soak};
