//! Regimes of the impact map: where a part locks to the drive, doubles, goes chaotic or rests, and how it
//! is brought onto the lock.

pub mod band;
pub mod capture;
pub mod cascade;
pub mod chaos;
pub mod classify;
pub mod exponent;
pub mod gear;
mod lock;
pub mod reach;
pub mod spread;
pub mod wave_band;

pub use lock::{HIGHEST_ORDER, Lock, Multipliers};
