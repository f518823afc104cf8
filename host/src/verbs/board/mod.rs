//! The verbs for a board: settings, targets, recipes, updates, readings.

pub(super) mod backup;
pub(super) mod commission;
pub(super) mod disable;
pub(super) mod enable;
pub(super) mod flash;
pub(super) mod identify;
pub(super) mod lock;
pub(super) mod monitor;
pub mod recipe;
pub(super) mod serve;
pub mod settings;
pub(super) mod status;
pub(super) mod target;
pub(super) mod unlock;
pub(super) mod update;
