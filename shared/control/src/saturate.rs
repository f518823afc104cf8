//! Saturation without a panic, and counts of consecutive cycles.

/// Limits a value to `low`..`high`. Unlike `clamp` it cannot panic, as the board's image requires.
pub fn saturate(value: f32, low: f32, high: f32) -> f32 {
    if value < low {
        low
    } else if value > high {
        high
    } else {
        value
    }
}

/// Number of consecutive cycles with a condition, after one more cycle.
pub fn consecutive(cycles: u32, holds: bool) -> u32 {
    if holds { cycles.saturating_add(1) } else { 0 }
}
