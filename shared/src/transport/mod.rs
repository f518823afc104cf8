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
//! | `wave_survey` | the same on several tones, with friction |
//! | `scattered` | speed and time in gear of parts whose restitution scatters |
//! | `interval` | distribution and correlation of the times between impacts (28 to 32) |
//! | `inelastic` | the limit of restitution 0, a one-dimensional map (38) |
//! | `sensitivity` | how the speed answers a change of amplitude |
//! | `sample_mean` | mean and standard error of independent values |

mod conveyed;
mod inelastic;
mod interval;
pub mod locked;
mod sample_mean;
mod scattered;
mod sensitivity;
pub mod stationary;
mod survey;
mod wave_survey;

pub use conveyed::{Conveyed, Conveying};
pub use inelastic::{Inelastic, InelasticFlight};
pub use interval::Intervals;
pub use sample_mean::SampleMean;
pub use scattered::{WaveLaw, convey_from_rest};
pub use sensitivity::Sensitivity;
pub use survey::{Effort, Measured, Motion, Origin, measure};
pub use wave_survey::measure_on_tones;
