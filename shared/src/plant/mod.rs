//! The simulated feeder that the controller is tried against: drive, parts, accelerometer, and the
//! one loop that joins them to the controller.
//!
//! A part's flight is one step of the impact map with the amplitude that the track has where the
//! flight begins; the amplitude's own change within a flight (at most an eighth of its distance to go
//! at Q = 25) is left out. Integers, single precision and the map's own arithmetic only: the same
//! bits at the desk and on the emulated CPU.

mod bench;
mod closed_loop;
mod drive;
mod feeder;
mod noise;
mod part;
mod scene;

pub use bench::Bench;
pub use closed_loop::{ClosedLoop, Moment};
pub use feeder::{Plant, STRIKES};
pub use noise::Noise;
pub use part::Strike;
pub use scene::{Change, DISTURBANCES, Disturbance, DriveModel, PARTS, Scene, SensorModel};
