//! Saturation that cannot panic.

/// A value held between two bounds. Unlike `clamp` it cannot panic, which the image of the board is
/// checked for.
pub fn saturate(value: f32, low: f32, high: f32) -> f32 {
    if value < low {
        low
    } else if value > high {
        high
    } else {
        value
    }
}
