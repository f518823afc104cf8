//! Simulated feeder for the controller: drive, parts, accelerometer, and the closed loop.
//!
//! A part's flight is one step of the impact map at the track's amplitude at launch. The change of
//! the amplitude within a flight is neglected; at Q = 25 it is at most an eighth of the remaining
//! change.
//!
//! There are two plants. The waveform ([`ClosedLoop`]) passes each sample through the firmware's
//! signal path. It uses integers, single precision and the map's arithmetic only, so desk and
//! emulated CPU give the same bits. The envelope ([`EnvelopeLoop`]) advances by a drive cycle in
//! closed form, under the same controller.

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
