//! The simulated feeder that the controller is tried against: drive, parts, accelerometer, and the
//! one loop that joins them to the controller.
//!
//! A part's flight is one step of the impact map with the amplitude that the track has where the
//! flight begins; the amplitude's own change within a flight (at most an eighth of its distance to go
//! at Q = 25) is left out.
//!
//! Two fidelities: the waveform ([`ClosedLoop`]) takes every sample through the firmware's signal path,
//! in integers, single precision and the map's own arithmetic only, so that it gives the same bits at the
//! desk and on the emulated CPU; the envelope ([`EnvelopeLoop`]) goes from cycle to cycle in closed form,
//! under the same controller.

mod bench;
mod blanking;
mod closed_loop;
#[cfg(test)]
mod drawn;
mod drive;
mod energy;
mod envelope;
mod envelope_loop;
mod feeder;
#[cfg(test)]
mod heaps;
#[cfg(test)]
mod held;
mod hopper;
mod law;
mod load;
#[cfg(test)]
mod lots;
mod massive;
mod noise;
mod onset;
mod part;
mod powers;
mod readings;
mod recurrence;
mod scene;
mod sense;
mod timeline;
#[cfg(test)]
mod tones;
mod track_motion;
mod upper;

pub use bench::Bench;
pub use closed_loop::{ClosedLoop, Moment, Sample};
pub use envelope_loop::EnvelopeLoop;
pub use feeder::Plant;
pub use noise::Noise;
pub use part::Strike;
pub use scene::{
    Change, DISTURBANCES, Disturbance, Disturbances, DriveModel, PARTS, Parts, Scene, SensorModel,
};
