//! The amplitude for a target, and the searches that find it with the impact map.
//!
//! | file | holds |
//! |---|---|
//! | `setpoint` | the amplitude for a target, chosen for the whole lot |
//! | `gear` | the amplitude at which the lot stays in gear the longest |
//! | `retune` | whether the plan for gear must be repeated |
//! | `speed` | the lock that conveys at a wanted speed |
//! | `flow` | the order of gear that gives a wanted flow |
//! | `chaos` | the widest chaotic stretch of k |
//! | `kicks` | the kicks that bring the lot onto a lock |
//! | `selection` | the target, its setpoint, and the searches that still run |

mod chaos;
mod flow;
mod gear;
mod kicks;
mod retune;
mod selection;
mod setpoint;
mod speed;

#[cfg(any(test, feature = "memo"))]
pub use gear::GearPlanned;
pub use gear::{GearSearch, drive_limits};
#[cfg(any(test, feature = "memo"))]
pub use kicks::KickResult;
pub use selection::Selection;
pub use setpoint::NoSetpoint;
