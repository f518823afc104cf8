//! Saturation without a panic.

/// Limits a value to `low`..`high`. Unlike `clamp` it cannot panic; a test requires that of the
/// board's image.
pub fn saturate(value: f32, low: f32, high: f32) -> f32 {
    if value < low {
        low
    } else if value > high {
        high
    } else {
        value
    }
}
