//! Conveying speed of parts along the track, in each regime (docs/theory-transport.md#t8).
//!
//! The observed speed is the TIME mean: displacement over time, rests included. The paper's mean is
//! per impact, which weights short and long hops equally; here it is called the impact mean.
//! Velocities are relative to the track in units of `b w`, displacements in units of b. A velocity
//! times [`crate::feeder::Track::velocity_unit`] is in m/s.

mod conveyed;
pub mod locked;
mod sample_mean;
mod scattered;
mod sensitivity;
pub mod stationary;
mod survey;
mod wave_survey;

pub use conveyed::{Conveyed, Conveying};
pub use sample_mean::SampleMean;
pub use scattered::{WaveLaw, convey_from_rest};
pub use sensitivity::sensitivity;
pub use survey::{Effort, Measured, Motion, Origin, measure};
pub use wave_survey::measure_on_tones;
