//! Chips of the boards, images for them, and access through a debug probe.

mod image;
mod model;
#[cfg(feature = "flash")]
mod reach;
#[cfg(feature = "flash")]
mod write;

pub use image::Image;
pub use model::STM32F405RG;
pub(crate) use model::{Chip, OptionBytes, Sector};
#[cfg(feature = "flash")]
pub(crate) use write::write;
