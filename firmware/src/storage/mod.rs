//! Non-volatile memory: settings, targets and recipes, and the log of events.

pub(crate) mod journal;
pub mod last_words;
pub mod recipes;
pub mod resets;
pub(crate) mod saves;
pub mod store;
pub mod waiting;
