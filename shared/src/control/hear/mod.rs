//! What the accelerometer says of the track and of the parts.
//!
//! | file | holds |
//! |---|---|
//! | `signal` | the path of one sample: drive phase, demodulation, onset detection, drive output |
//! | `onset` | impacts, detected in what the drive does not explain |
//! | `energy` | its energy over the turn |
//! | `fold` | that residual, summed over many cycles |
//! | `phases` | circular statistics of the impacts' phases |
//! | `deaf` | whether it hears at all |
//! | `gear` | the share of time in gear |
//! | `share` | the same of many parts at once |
//! | `margin` | how far that is from being lost |
//! | `lock` | the phases at which a wanted lock strikes |
//! | `listener` | whether the parts are locked, and their regime |

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

#[cfg(feature = "plant")]
pub use blanked::{outweighed, repeated};
pub use deaf::{Deafness, Sound};
#[cfg(all(test, feature = "plant"))]
pub use energy::Energy;
#[cfg(feature = "plant")]
pub use energy::{SECTORS, SECTORS_HANDED, Sectors};
#[cfg(feature = "plant")]
pub use fold::Fold;
pub use fold::{HANDED, Layout, PLACES};
pub use gear::{GEAR_WINDOW, GearHearing, HeardWith};
pub use listener::Listener;
pub use load::{Load, LoadMeter, Weighed};
pub use lock::LockWindow;
pub use margin::GearMargin;

pub use share::{GearShare, Tuned};

#[cfg(any(test, feature = "plant"))]
pub use onset::{HEARD_PER_CYCLE, Heard, OnsetDetector, QUARTILE};
pub use onset::{HighPass, Onset, Standard};
#[cfg(feature = "plant")]
pub use signal::MOST_BLANKED;
pub use signal::{AdcCode, Command, Cycle, Overtone, Sampled, Signal};
pub use weighing::Weighing;
