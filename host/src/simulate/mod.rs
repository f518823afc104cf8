//! Scenes at the desk: read, run, drawn and judged.

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
pub mod sweep;
pub mod trace;

pub use engine::Fidelity;
pub use expect::Expectation;
pub use outcome::{Outcome, Take, Watch, words};
pub use parts::Distribution;
pub use picture::draw;
pub use record::{Happened, Record, Sketch};
pub use runs::Runs;
pub use scene::{DEFAULT, SceneFile, describe, table as scene_table};
