//! The impact map in f64: [`map`] from state to state, [`first`] the first impact of a launch.

pub(super) mod bracket;
pub(super) mod first;
pub(super) mod launch;
pub(super) mod low;
pub(super) mod short;
pub(super) mod step;
pub(super) mod tall;

mod map;
mod search;

pub use map::Map;
