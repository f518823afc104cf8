//! Scenes at the desk: read, run, drawn and judged.
//!
//! A file of these uses those before it only: fields, section; timeline; engine; parts, expect,
//! scene; record, outcome; unmet, picture, trace, runs, axes, sweep, schema.

pub mod axes;
mod engine;
mod expect;
mod fields;
mod outcome;
mod parts;
mod picture;
mod record;
pub mod runs;
mod scene;
pub mod schema;
mod section;
pub mod sweep;
mod timeline;
pub mod trace;
mod unmet;

/// Amplitude in m up to which a track counts as at rest: it has no k.
pub const RESTING_AMPLITUDE: f64 = 1e-6;

pub use engine::{Fidelity, Lot};
pub use expect::Expectation;
pub use outcome::{Outcome, words};
pub use parts::{Distribution, Kin, kin};
pub use picture::{STATE_FILLS, draw, state_fill};
pub use record::{Happened, Record, SETTLED, Sketch, Struck, Take, Watch};
pub use runs::Runs;
pub use scene::{DEFAULT, SceneFile, at_line, table as scene_table, within_reach};
pub use timeline::describe;
