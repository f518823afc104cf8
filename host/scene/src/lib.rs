//! Scenes, read from TOML, simulated and evaluated; final regimes of orbits on the exact map.
//! `scene` reads a scene file, `engine` runs it, `record` and `outcome` report the run.

pub mod design;
pub mod ending;
mod engine;
mod expect;
pub mod fields;
mod outcome;
mod parts;
mod record;
pub mod refusal;
mod scene;
mod section;
mod timeline;

pub use engine::{Engine, Fidelity, Glance, Lot, Plans};
pub use expect::Expectation;
pub use outcome::{Outcome, ProgressCheck, cycles, regime_text};
pub use parts::{Distribution, PartGroup, part_group, restitutions};
pub use record::{Curve, Record, STATISTICS_START, Sketch, Take, TimedEvent, Watch, add_strike};
pub use scene::{
    DEFAULT, DEFAULT_DURATION, DEFAULT_PART_LENGTH, SceneFile, at_line, table, toml_table,
    within_reach,
};
pub use section::number as toml_number;
pub use timeline::{band_name, change, describe};
