//! How far parts in gear are from losing it, told from the phases at which they strike.

/// What the parts' phases say of their gear, without the setpoint being moved.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GearMargin {
    /// Trace of the tangent map of one impact (symbol tr J), `1 + R^2 - A (1 + R)^2/k`, with A averaged over the impacts.
    pub trace: f32,
    /// Restitution (symbol R) as heard, 0..1.
    pub restitution: f32,
    /// Standard error of that restitution.
    pub error: f32,
    /// Standard deviation of restitution from impact to impact (symbol s) as heard.
    pub scatter: f32,
    /// Distance of the trace from the doubling of the period, `1 + R^2 + tr J`: 0 at the flip, negative beyond it.
    pub flip: f32,
    /// Expected drive cycles until gear is lost: those in gear over its losses and one, and where none was heard not less than
    /// the map has of the lot.
    pub to_loss: f32,
}
