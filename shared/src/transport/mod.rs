//! Conveying speed of parts along the track, in each regime (docs/theory-transport.md#t8).
//!
//! The observed speed is the TIME mean: displacement over time, rests included. The paper's mean is
//! per impact, which weighs short and long hops equally; here it is the impact mean. Velocities are
//! relative to the track in units of `b w`, displacements in units of b. A velocity times
//! [`crate::feeder::Track::velocity_unit`] is in m/s.
//!
//! | module | holds |
//! |---|---|
//! | `conveyed` | the observer that sums distance and time of an orbit (equations 10 and 11) |
//! | `locked` | closed forms of the locked regime, critical slope, bound (20 to 23, 37) |
//! | `stationary` | the exact impact mean of any hopping regime (34, corrected) |
//! | `survey` | measuring one orbit after it has settled |
//! | `tones` | the same on several tones, with friction |
//! | `interval` | distribution and correlation of the times between impacts (28 to 32) |
//! | `inelastic` | the limit of dead parts, a one-dimensional map (38) |
//! | `sensitivity` | how the speed answers a change of amplitude |
//! | `spread` | mean and standard error of independent values |

#[cfg(any(test, feature = "analysis"))]
mod conveyed;
#[cfg(any(test, feature = "analysis"))]
mod inelastic;
#[cfg(any(test, feature = "analysis"))]
mod interval;
pub mod locked;
#[cfg(any(test, feature = "analysis"))]
mod sensitivity;
#[cfg(any(test, feature = "analysis"))]
mod spread;
#[cfg(any(test, feature = "analysis"))]
pub mod stationary;
#[cfg(any(test, feature = "analysis"))]
mod survey;
#[cfg(any(test, feature = "analysis"))]
mod tones;

#[cfg(any(test, feature = "analysis"))]
pub use conveyed::{Conveyed, Conveying};
#[cfg(any(test, feature = "analysis"))]
pub use inelastic::{DeadFlight, Inelastic};
#[cfg(any(test, feature = "analysis"))]
pub use interval::Intervals;
#[cfg(any(test, feature = "analysis"))]
pub use sensitivity::Sensitivity;
#[cfg(any(test, feature = "analysis"))]
pub use spread::Spread;
#[cfg(any(test, feature = "analysis"))]
pub use survey::{Effort, Measured, Motion, Origin, measure, measure_scattered};
#[cfg(any(test, feature = "analysis"))]
pub use tones::measure_on_tones;
