//! The chips of the boards: what they are, the images that fit them, and the way to them through a debug probe.

#[cfg(feature = "flash")]
mod apart;
mod image;
mod model;
#[cfg(feature = "flash")]
mod reach;
#[cfg(feature = "flash")]
mod write;

#[cfg(test)]
pub(crate) use image::tests::slot_elf;
pub use image::{Image, Piece};
pub use model::{CHIPS, Chip, Controller, OptionBytes, STM32F405RG, STM32G474RE, Sector};
#[cfg(feature = "flash")]
pub use write::write;
