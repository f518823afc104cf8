//! The true plant without its simulation: scene, disturbances, drive, and parts on the track.

pub(crate) mod crowd;
pub(crate) mod drive;
pub(crate) mod hopper;
pub(crate) mod law;
pub(crate) mod part;
pub(crate) mod scene;
pub(crate) mod timeline;

use kband_control::Report;

/// One cycle of the closed loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Time at the end of the cycle in s.
    pub time: f64,
    /// The controller's report.
    pub report: Report,
    /// Impacts of all parts in this cycle.
    pub strikes: u32,
    /// Mean displacement of the parts along the track so far in m, positive upwards.
    pub displacement: f64,
    /// Mass of the parts on the track over that of the track (symbol m/M).
    pub load: f64,
}
