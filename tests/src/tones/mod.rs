//! Tracks of several tones: launches for testing a map, the oracle that judges it, and the soak
//! test.

mod launches;
mod oracle;
mod soak;

pub use launches::{Kind, edge, track};
pub use oracle::Track;
pub use soak::{NAMES, Seen, Tally, soak};
