//! Regimes of the impact map: where a part locks to the drive, and how it gets there.

pub mod band;
pub mod capture;
pub mod lock;

pub use band::{Band, Margins, NoBand};
pub use lock::Lock;
