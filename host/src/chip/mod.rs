//! The board's chip: what it is, the image that fits it, and the way to it through a debug probe.

#[cfg(feature = "flash")]
mod apart;
mod image;
mod model;
#[cfg(feature = "flash")]
mod reach;
#[cfg(feature = "flash")]
mod ring;
#[cfg(feature = "flash")]
mod write;

pub use image::{Image, Piece};
pub use model::{Chip, STM32F405RG, Sector};
#[cfg(feature = "flash")]
pub use ring::follow;
#[cfg(feature = "flash")]
pub use write::write;
