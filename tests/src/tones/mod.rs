//! Tracks of several tones: launches for testing a map, and the soak test.

mod launches;
mod soak;

pub use launches::{Kind, touching, track};
pub use soak::{NAMES, Seen, Tally, soak};
