//! Estimates of the track's motion and of the parts from the accelerometer.
//!
//! | file | holds |
//! |---|---|
//! | `signal` | the path of one sample: drive phase, demodulation, onset detection, drive output |
//! | `onset` | detection of impacts in the residual without the drive |
//! | `energy` | energy of the residual by phase of the turn |
//! | `fold` | coherent average of the residual over many cycles |
//! | `phases` | circular statistics of the impacts' phases |
//! | `deaf` | detection of a sensor that misses impacts |
//! | `gear` | time in gear and restitution, from single impacts |
//! | `share` | time in gear of many parts, from the energy |
//! | `margin` | margin to the loss of gear |
//! | `lock` | window of phases of a lock |
//! | `listener` | detection of lock, gear, regime and an empty track |
//! | `load` | mass and flow of the parts |
//! | `blanked` | bias of the demodulator by blanked samples |
//! | `weighing` | events on changes of the load |

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
pub use fold::Fold;
pub use fold::{HANDED, Layout, PLACES};
pub use gear::{DriveState, GearEstimator};
pub use listener::Listener;
pub use load::{Load, LoadMeter, Weighed};
pub use lock::LockWindow;
pub use margin::GearMargin;

pub use share::GearShare;

pub use onset::{DetectedImpact, HighPass, MAX_IMPACTS_PER_CYCLE, OnsetDetector};
pub use signal::MAX_BLANKED_SHARE;
pub use signal::{AdcCode, Command, Cycle, Overtone, Sampled, Signal};
pub use weighing::LoadEvents;
