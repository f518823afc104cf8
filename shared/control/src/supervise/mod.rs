//! Supervision: states, captures, faults, limits.

mod capture;
mod faults;
mod interlock;
mod limits;
mod machine;
mod sensor;

pub use faults::{FaultDetector, Prediction};
pub use interlock::Interlock;
pub use limits::{LimitInputs, LimitMonitor};
pub use machine::{Clearance, Decision, Observation, StateMachine};
pub use sensor::{RestTest, TestSwing};
