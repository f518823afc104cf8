//! The phases at which a lock is heard.

use crate::arithmetic::Phase;

/// Where a lock is heard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LockWindow {
    /// Drive cycles per impact.
    pub order: u8,
    /// k of the setpoint.
    pub k: f64,
    /// Phase at which the lot's parts strike.
    pub phase: Phase,
    /// Half width of the phases that count, in rad.
    pub width: f32,
}
