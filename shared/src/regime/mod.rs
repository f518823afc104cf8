//! Regimes of the impact map: lock, period doubling, chaos and rest, and the capture of a part onto
//! the lock.

pub mod band;
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub mod capture;
#[cfg(any(test, feature = "analysis"))]
pub mod cascade;
#[cfg(any(test, feature = "analysis"))]
pub mod chaos;
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub mod classify;
#[cfg(any(test, feature = "analysis"))]
pub mod exponent;
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub mod gear;
mod lock;
#[cfg(any(test, feature = "analysis"))]
pub mod reach;
#[cfg(any(test, feature = "analysis"))]
mod series;
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub mod spread;
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub mod wave_band;

pub use lock::{HIGHEST_ORDER, Lock, Multipliers};
