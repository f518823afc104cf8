//! Scenes at the desk: read, run, drawn and judged.

mod expect;
mod outcome;
mod picture;
pub mod runs;
mod scene;

pub use expect::Expectation;
pub use outcome::{Happened, Outcome, words};
pub use picture::draw;
pub use runs::Runs;
pub use scene::{DEFAULT, SceneFile, describe};
