//! Regimes of the impact map: lock, period doubling, chaos and rest, and the capture of a part onto
//! the lock.

pub mod band;
pub mod capture;
pub mod cascade;
pub mod chaos;
pub mod classify;
pub mod exponent;
pub mod gear;
mod lock;
pub mod reach;
mod series;
pub mod wave_band;

pub use lock::{Lock, MAX_ORDER, Multipliers};

/// Launch velocity in `b w` below which the rest of a chatter is summed as a series. The error in
/// the time of rest is below 2 % of that chatter.
const MAX_SERIES_CHATTER_VELOCITY: f32 = 0.01;
