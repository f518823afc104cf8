//! How a verb ended: by itself, or with the one message of a refusal.

pub use kband_scene::refusal::Refusal;

/// How a verb ended when it ended by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// It did what was asked: status 0.
    Done,
    /// It ran, and a check that it was asked to make failed: status 1.
    CheckFailed,
}
