//! Capture: bringing a part from rest onto the locked orbit by a temporary rise of the amplitude (a
//! kick).
//!
//! In the band alone, a part at rest reaches the lock only at low restitution, and nowhere above
//! R = 0.26 (docs/theory-capture.md#t7.2). A kick is chosen by simulating parts of the whole lot
//! with the impact map. Desk and board use the same code.

mod kick;
mod lag;
mod plan;
mod trial;

pub use kick::{Kick, KickSettings};
pub(crate) use lag::KickEnvelope;
pub use lag::{DriveLag, DriveLagSettings};
pub use plan::{Lot, Plan, PlanSettings, Planner, ScoredKick};
pub use trial::{Outcome, Trial, TrialRun};
