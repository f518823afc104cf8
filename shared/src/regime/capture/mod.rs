//! Capture: bringing a part from rest onto the locked orbit by a kick of the amplitude.
//!
//! A band is not enough: from rest a part reaches the locked orbit only in a small piece of the band at
//! low restitution, and nowhere above R = 0.26 (docs/theory-capture.md#t7.2). A kick raises the amplitude for
//! some cycles and lets it come back; which kick works is computed with the impact map itself, for every
//! part of a lot, by the desk and by the board alike.

mod follow;
mod kick;
mod lag;
mod plan;

#[cfg(feature = "unstable")]
pub use follow::{Follow, Outcome, Trial};
#[cfg(not(feature = "unstable"))]
use follow::{Follow, Outcome, Trial};
pub use kick::{Kick, KickSettings};
pub(crate) use lag::KickEnvelope;
pub use lag::{DriveLag, DriveLagSettings};
pub use plan::{Lot, Plan, PlanSettings, Planner, Scored};
