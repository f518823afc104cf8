//! The message of a refused or failed run, and its exit status.

use std::borrow::Cow;
use std::fmt;
use std::path::Path;

use kband::feeder::OutOfRange;

/// Refusal of a request: cause, accepted range, next step. Exit status 2, or 130 if interrupted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    cause: String,
    accepted: Option<String>,
    next: String,
    interrupted: bool,
    /// The key of a scene concerned, such as `track.frequency`.
    key: Option<String>,
}

impl Refusal {
    /// A refusal with its cause and the next step.
    pub fn new(cause: impl Into<String>, next: impl Into<String>) -> Self {
        Self {
            cause: cause.into(),
            accepted: None,
            next: next.into(),
            interrupted: false,
            key: None,
        }
    }

    /// `key = value` is not within `accepted`; `next` is the next step.
    pub fn value(
        key: impl fmt::Display,
        value: impl fmt::Display,
        accepted: impl Into<String>,
        next: impl Into<String>,
    ) -> Self {
        Self {
            accepted: Some(accepted.into()),
            ..Self::new(format!("{key} = {value} is refused"), next)
        }
    }

    /// The same refusal, with the accepted range.
    pub fn accepting(mut self, accepted: impl Into<String>) -> Self {
        self.accepted = Some(accepted.into());
        self
    }

    /// A file that could not be read or written; or the refusal that the error contains.
    pub fn file(path: &Path, error: &std::io::Error, next: impl Into<String>) -> Self {
        let inner = error
            .get_ref()
            .and_then(|inner| inner.downcast_ref::<Self>());
        inner
            .cloned()
            .unwrap_or_else(|| Self::new(format!("{}: {error}", path.display()), next))
    }

    /// Interrupted by Ctrl-C before the result was complete.
    pub fn interrupted() -> Self {
        let cause = "interrupted before the result was complete; nothing was written";
        Self::cut(cause, "start it again; fewer points finish sooner")
    }

    /// Interrupted by Ctrl-C; `cause` describes the unfinished work.
    pub fn cut(cause: impl Into<String>, next: impl Into<String>) -> Self {
        Self {
            interrupted: true,
            ..Self::new(cause, next)
        }
    }

    /// Whether it is the refusal of a value out of range.
    pub fn is_of_value(&self) -> bool {
        self.accepted.is_some()
    }

    /// The same refusal, for a key of a scene.
    pub fn of_key(mut self, key: impl Into<String>) -> Self {
        self.key = Some(key.into());
        self
    }

    /// The key of a scene concerned.
    pub fn key(&self) -> Option<&str> {
        self.key.as_deref()
    }

    /// The same refusal, preceded by its place (a line of a file, a key of a scene).
    pub fn at(mut self, place: impl fmt::Display) -> Self {
        self.cause = format!("{place}: {}", self.cause);
        self
    }

    /// The same refusal with another next step.
    pub fn then(mut self, next: impl Into<String>) -> Self {
        self.next = next.into();
        self
    }

    /// Exit status.
    pub fn status(&self) -> u8 {
        if self.interrupted { 130 } else { 2 }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "error: {}", readable(&self.cause))?;
        if let Some(accepted) = &self.accepted {
            write!(formatter, "\n  accepted: {}", readable(accepted.trim_end()))?;
        }
        write!(formatter, "\n  next: {}", readable(&self.next))
    }
}

const MAX_MESSAGE_CHARACTERS: usize = 2000;

/// Long text with its middle left out: a refused value may be a file of 3 MB.
fn readable(text: &str) -> Cow<'_, str> {
    let count = text.chars().count();
    if count <= MAX_MESSAGE_CHARACTERS {
        return text.into();
    }
    let half = MAX_MESSAGE_CHARACTERS / 2;
    let begin: String = text.chars().take(half).collect();
    let end: String = text.chars().skip(count - half).collect();
    let left_out = count - 2 * half;
    format!("{begin} ... ({left_out} characters left out) ... {end}").into()
}

impl std::error::Error for Refusal {}

impl From<OutOfRange> for Refusal {
    fn from(refused: OutOfRange) -> Self {
        let value = if refused.value.abs() < 1e15 {
            refused.value.to_string()
        } else {
            format!("{:e}", refused.value)
        };
        let next = format!("change {} and run again", refused.parameter);
        Self::value(refused.parameter, value, refused.accepted, next)
    }
}
