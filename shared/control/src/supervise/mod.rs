//! Supervision: states, captures, faults, limits.
//!
//! | file | holds |
//! |---|---|
//! | `interlock` | the causes that keep the drive off until somebody acts at the machine |
//! | `machine` | the state machine of a drive |
//! | `capture` | the attempts at capturing the parts, kick by kick |
//! | `faults` | detection of faults of the sensor and the drive |
//! | `sensor` | tests of the accelerometer: its mean at rest, a small swing at each start |
//! | `limits` | the limits that hold the drive back |

mod capture;
mod faults;
mod interlock;
mod limits;
mod machine;
mod sensor;

pub use faults::{FaultDetector, Prediction};
pub use interlock::Interlock;
pub use limits::{LimitInputs, LimitMonitor};
pub use machine::{Clearance, Decision, EnableResponse, Observation, StateMachine};
pub use sensor::{RestTest, SwingResult, TestSwing};
