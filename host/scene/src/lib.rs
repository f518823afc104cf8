//! Scenes: read from TOML, simulated and judged. Endings of orbits on the exact map.
//!
//! | module | holds |
//! |---|---|
//! | [`refusal`] | the one message of a refused value or run |
//! | [`fields`] | numbers and flags of a scene that are no settings of the controller |
//! | `section`, `timeline`, `parts`, `expect`, `scene` | the parts of a scene file, and the whole |
//! | `engine` | the closed loop of a scene, cycle by cycle |
//! | `record`, `outcome`, `unmet` | what is kept of a run, what came of it, what was expected |
//! | [`ending`] | where an orbit of the exact map ends |
//! | [`design`] | feeders with the drive of a scene, on a Pareto front |
//!
//! A file of the middle rows uses those before it only, and [`ending`].

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
mod unmet;

pub use engine::{Engine, Fidelity, Glance, Lot};
pub use expect::Expectation;
pub use outcome::{GoOn, Outcome, cycles, words};
pub use parts::{Distribution, Kin, kin};
pub use record::{Curve, Happened, Record, SETTLED, Sketch, Struck, Take, Watch};
pub use scene::{
    DEFAULT, DEFAULT_DURATION, DEFAULT_PART_LENGTH, SceneFile, at_line, table, toml_table,
    within_reach,
};
pub use section::number as toml_number;
pub use timeline::{change, describe};
