//! The amplitude for a target, and the searches that find it with the impact map.

mod chaos;
mod flow;
mod gear;
mod kicks;
mod retune;
mod selection;
mod setpoint;
mod speed;

pub use chaos::ChaosSearch;
#[cfg(any(test, feature = "memo"))]
pub use gear::GearPlanned;
pub use gear::{GearSearch, drive_limits};
#[cfg(any(test, feature = "memo"))]
pub use kicks::KickResult;
pub use selection::Selection;
pub use setpoint::NoSetpoint;
