//! What the drive does next: from state to state, up to its limits, until a fault.
//!
//! | file | holds |
//! |---|---|
//! | `interlock` | what keeps the drive off until somebody acts at the machine |
//! | `machine` | the state machine of a drive |
//! | `capture` | the attempts at capturing the parts, kick by kick |
//! | `faults` | what looks like a fault of the sensor or the drive, and is one where it lasts |
//! | `sensor` | tests of the accelerometer itself: its mean at rest, a small swing at each start |
//! | `limits` | what holds the drive back |

mod capture;
mod faults;
mod interlock;
mod limits;
mod machine;
mod sensor;

pub use faults::{Expected, FaultDetector};
pub use interlock::Interlock;
pub use limits::{LimitInputs, LimitMonitor};
pub use machine::{Clearance, Decision, EnableResponse, Observation, Standstill, StateMachine};
pub use sensor::{RestTest, SwingResult, TestSwing};
