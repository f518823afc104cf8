//! Scenes at the desk: run with progress, drawn, and varied.
//!
//! A file of these uses those before it only: run; read, picture, trace, runs, axes, sweep, schema.

pub mod axes;
mod picture;
mod read;
mod run;
pub mod runs;
pub mod schema;
pub mod sweep;
pub mod trace;

/// Amplitude in m up to which a track counts as at rest: it has no k.
pub const RESTING_AMPLITUDE: f64 = 1e-6;

pub use kband_scene::{
    DEFAULT, Distribution, Fidelity, Lot, Outcome, SETTLED, SceneFile, Watch, describe, kin,
    within_reach, words,
};
pub use picture::{STATE_FILLS, draw, state_fill};
pub(crate) use read::SceneText;
pub use run::{run, run_on, watched};
pub use runs::Runs;
