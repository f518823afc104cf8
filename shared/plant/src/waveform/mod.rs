//! Waveform plant: every sample passes through the firmware's signal path.

mod bench;
mod closed_loop;
mod massive;

pub use bench::Bench;
pub use closed_loop::{ClosedLoop, Sample};
