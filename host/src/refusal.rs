//! Exit status of a verb, and its message after a refusal.

pub use kband_scene::refusal::Refusal;

/// A result whose error is a refusal, unless another one is named.
pub type Result<T, E = Refusal> = std::result::Result<T, E>;

/// End of a verb without a refusal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// Done: status 0.
    Done,
    /// Done, and a requested check failed: status 1.
    CheckFailed,
}
