//! Estimates of the track's motion and of the parts from the accelerometer.

mod average;
mod blanking;
mod energy;
mod gear;
mod listener;
mod load;
mod load_events;
mod missed_impacts;
mod onset;
mod phases;
mod share;
mod signal;

pub use average::{BINS_PER_CYCLE, BinLayout, MAX_BINS, SynchronousAverage};
pub use blanking::{impulse_weight, last_cycle_gain};
pub use energy::{EnergyHistogram, SECTORS, SECTORS_PER_CYCLE, Sectors};
pub use gear::{DriveState, GearEstimator, GearMargin};
pub use listener::Listener;
pub use load::{Load, LoadMeasurement, LoadMeter};
pub use load_events::LoadEvents;
pub use missed_impacts::{ImpactEvidence, MissedImpactDetector};
pub use onset::{DetectedImpact, HighPass, MAX_IMPACTS_PER_CYCLE, OnsetDetector};
pub use phases::LockWindow;
pub use share::GearShare;
pub use signal::{AdcCode, Command, Cycle, MAX_BLANKED_SHARE, Sampled, Signal};
