//! Margin of parts in gear to its loss, estimated from the phases of their impacts.

use serde::{Deserialize, Serialize};

/// Estimated margin to the loss of gear. One part: from each flight. Several parts: from the
/// profile of their impacts over the turn (docs/theory-real-parts.md#t10.7).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GearMargin {
    /// Trace of the tangent map of one impact (symbol tr J): `1 + R^2 - A (1 + R)^2/k`.
    pub trace: f32,
    /// Estimated restitution (symbol R), 0..1.
    pub restitution: f32,
    /// Standard error of that restitution.
    pub error: f32,
    /// Scatter of restitution from impact to impact (symbol s): of one part, or the lot's.
    pub scatter: f32,
    /// Distance from the period doubling, `1 + R^2 + tr J`: 0 at the flip, negative beyond it.
    pub flip: f32,
    /// Expected drive cycles until gear is lost: cycles in gear over losses plus one, or the map's.
    pub to_loss: f32,
}
