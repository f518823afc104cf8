//! Estimates of the track's motion and of the parts from the accelerometer.

mod blanked;
mod deaf;
mod energy;
mod fold;
mod gear;
mod listener;
mod load;
mod lock;
mod margin;
mod onset;
mod phases;
mod share;
mod signal;
mod weighing;

pub use blanked::{last_cycle_gain, push_weight};
pub use deaf::{ImpactEvidence, MissedImpactDetector};
pub use energy::{EnergyHistogram, SECTORS, SECTORS_HANDED, Sectors};
pub use fold::{Fold, HANDED, Layout, PLACES};
pub use gear::{DriveState, GearEstimator};
pub use listener::Listener;
pub use load::{Load, LoadMeter, Weighed};
pub use lock::LockWindow;
pub use margin::GearMargin;

pub use share::GearShare;

pub use onset::{DetectedImpact, HighPass, MAX_IMPACTS_PER_CYCLE, OnsetDetector};
pub use signal::{AdcCode, Command, Cycle, MAX_BLANKED_SHARE, Overtone, Sampled, Signal};
pub use weighing::LoadEvents;
