//! Images onto the board: checked at the desk, then written through a probe.

mod chip;
mod image;
#[cfg(feature = "flash")]
mod probe;

pub use chip::{Chip, STM32F405RG, Sector};
pub use image::{Image, Piece};
#[cfg(feature = "flash")]
pub use probe::write;
