//! The numbered lists of the controller, and the state table.

mod lists;
mod transition;

pub use lists::{Event, Events, Fault, Limits, State};
pub use transition::{TRANSITIONS, Transition};
