//! Scenes at the desk: run with progress, drawn, and varied. Each of these modules uses only
//! earlier ones: schema; run, picture, trace, runs, sweep.

mod picture;
mod run;
pub(crate) mod runs;
pub(crate) mod schema;
pub(crate) mod sweep;
pub(crate) mod trace;

/// Largest amplitude in m of a track that counts as at rest, without k.
pub(crate) const RESTING_AMPLITUDE: f64 = 1e-6;

pub use kband_scene::{DEFAULT, Distribution, Fidelity, Outcome, SceneFile, Watch};
pub(crate) use kband_scene::{
    Lot, STATISTICS_START, band_name, describe, part_group, regime_text, within_reach,
};
pub(crate) use picture::{STATE_FILLS, draw, state_fill};
pub(crate) use run::SceneText;
pub use run::{run_on, run_watched};
pub use runs::Runs;
