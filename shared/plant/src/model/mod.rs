//! The true plant without its simulation: scene, disturbances, drive, and parts on the track.

pub(crate) mod crowd;
pub(crate) mod drive;
pub(crate) mod hopper;
pub(crate) mod law;
mod moment;
pub(crate) mod part;
pub(crate) mod scene;
pub(crate) mod timeline;

pub use moment::Moment;
pub use part::Strike;
pub use scene::{
    Change, DISTURBANCES, Disturbance, Disturbances, DriveModel, PARTS, Parts, Scene, SensorModel,
};
