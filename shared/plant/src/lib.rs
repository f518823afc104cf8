//! Simulated feeder for the controller: drive, parts, accelerometer, and the closed loop.
//!
//! A part's flight is one step of the impact map at the track's amplitude at launch. Its change
//! within a flight is neglected; at Q = 25 it is at most an eighth of the remaining change.
//!
//! There are two plants. The waveform ([`ClosedLoop`]) passes each sample through the firmware's
//! signal path. With integers, single precision and the map's arithmetic, desk and emulated CPU
//! give the same bits. The envelope ([`EnvelopeLoop`]) advances by a drive cycle in closed form.
//!
//! `examples/board.rs` is a closed loop with a simulated feeder in place of the board.
#![no_std]
#![deny(unsafe_code)]

#[cfg(test)]
extern crate std;

#[cfg(test)]
mod drawn;
mod envelope;
mod model;
mod waveform;

pub use envelope::EnvelopeLoop;
pub use model::Moment;
pub use model::part::Strike;
pub use model::scene::{
    Change, DISTURBANCES, Disturbance, Disturbances, DriveModel, PARTS, Parts, Scene, SensorModel,
};
pub use waveform::{Bench, ClosedLoop, Sample};
