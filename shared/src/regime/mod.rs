//! Regimes of the impact map: lock, period doubling, chaos, rest, and capture onto the lock.

pub mod band;
pub mod capture;
pub mod cascade;
pub mod chaos;
pub mod classify;
pub mod exponent;
pub mod gear;
mod lock;
pub mod reach;
pub mod wave_band;

pub use lock::{Lock, MAX_ORDER, Multipliers};

/// Launch velocity in `b w` below which the rest of a chatter is summed as a series. The error in
/// the time of rest is below 2 % of that chatter.
const MAX_SERIES_CHATTER_VELOCITY: f32 = 0.01;

/// Duration in rad of a decaying chatter, summed as a series (docs/theory-impacts.md#t4.1), from
/// the pull `k - A` and the slope of A; `None` unless the pull outlasts it.
#[inline(always)]
fn chatter_duration(velocity: f32, [pull, slope]: [f32; 2], restitution: f32) -> Option<f32> {
    let x = 2.0 * velocity / (pull * (1.0 - restitution));
    if pull <= 0.0 || x * slope.abs() > 0.1 * pull {
        return None;
    }
    Some(x * (1.0 + x * slope / (3.0 * pull)))
}
