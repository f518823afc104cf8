//! Scenes, read from TOML, simulated and evaluated; final regimes of orbits on the exact map.
//!
//! | module | holds |
//! |---|---|
//! | [`refusal`] | the one message of a refused value or run |
//! | [`fields`] | numbers and flags of a scene besides the controller's settings |
//! | `section`, `timeline`, `parts`, `expect`, `scene` | sections of a scene file, and the whole file |
//! | `engine` | the closed loop of a scene, cycle by cycle |
//! | `record`, `outcome` | record of a run, its result and unmet expectations |
//! | [`ending`] | final regime of an orbit on the exact map |
//! | [`design`] | feeders with the drive of a scene, on a Pareto front |
//!
//! A module in the middle rows uses only those above it, and [`ending`].

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
pub use timeline::{change, describe};
