//! Window of phases in which the impacts of a lock count.

use kband::arithmetic::Phase;

/// Phases in which impacts count for a lock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LockWindow {
    /// Drive cycles per impact (symbol r).
    pub order: u8,
    /// k of the setpoint.
    pub k: f64,
    /// Predicted phase of the impacts.
    pub phase: Phase,
    /// Half width of the window, in rad.
    pub width: f32,
}
