//! What the drive does next: from state to state, up to its limits, until a fault.
//!
//! | file | holds |
//! |---|---|
//! | `machine` | the state machine of a drive |
//! | `capture` | the attempts at capturing the parts, kick by kick |
//! | `faults` | what looks like a fault of the sensor or the drive, and is one where it lasts |
//! | `limits` | what holds the drive back |

mod capture;
mod faults;
mod limits;
mod machine;

pub use faults::{Expected, Suspicions};
pub use limits::{Restraint, Shown as Restrained};
pub use machine::{Course, Decision, Rest, Shown, Turn};
