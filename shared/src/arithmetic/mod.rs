//! The number systems: binary angles, their sine and cosine, fixed-point formats.

#[allow(dead_code)]
pub(crate) mod node;
mod phase;
mod trigonometry;

pub use phase::Phase;
pub use trigonometry::{sine_cosine_fixed, sine_cosine_single};
