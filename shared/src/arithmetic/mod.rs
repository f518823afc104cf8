//! The number systems: binary angles, their sine and cosine, fixed-point formats.

mod phase;

pub use phase::Phase;
