//! The state table: every change of state that the controller makes, and its cause.

use super::lists::State;

/// A change of state from one cycle to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transition {
    /// The state before.
    pub from: State,
    /// The state after.
    pub to: State,
    /// Its cause, in the words of the manual.
    pub when: &'static str,
}

const fn on(from: State, to: State, when: &'static str) -> Transition {
    Transition { from, to, when }
}

/// Every change of state: a scene makes each one, and no random scene another.
pub const TRANSITIONS: [Transition; 37] = {
    use State::{Capturing, Fault, Holding, Limiting, Locked, Lost, Off, Starting, Stopping};
    const ENABLED: &str = "enable given";
    const WITHDRAWN: &str = "enable withdrawn";
    const FAULT: &str = "any fault";
    const LOCK_DETECTED: &str = "lock heard";
    const LIMITED: &str = "any limit";
    const TARGET: &str = "new target";
    [
        on(Off, Starting, ENABLED),
        on(Off, Limiting, "enable given, no setpoint"),
        on(Off, Fault, "fault of the board"),
        on(Starting, Holding, "setpoint reached"),
        on(Starting, Limiting, LIMITED),
        on(Starting, Fault, FAULT),
        on(Starting, Stopping, WITHDRAWN),
        on(Holding, Starting, "new target, out of chaos"),
        on(Holding, Capturing, "lock not heard"),
        on(Holding, Locked, LOCK_DETECTED),
        on(Holding, Limiting, LIMITED),
        on(Holding, Fault, FAULT),
        on(Holding, Stopping, WITHDRAWN),
        on(Capturing, Starting, TARGET),
        on(Capturing, Holding, "kicks used up"),
        on(Capturing, Locked, LOCK_DETECTED),
        on(Capturing, Limiting, LIMITED),
        on(Capturing, Fault, FAULT),
        on(Capturing, Stopping, WITHDRAWN),
        on(Locked, Starting, TARGET),
        on(Locked, Holding, "on to chaos"),
        on(Locked, Lost, "lock not heard"),
        on(Locked, Limiting, LIMITED),
        on(Locked, Fault, FAULT),
        on(Locked, Stopping, WITHDRAWN),
        on(Lost, Starting, TARGET),
        on(Lost, Capturing, "still not heard"),
        on(Lost, Locked, LOCK_DETECTED),
        on(Lost, Limiting, LIMITED),
        on(Lost, Fault, FAULT),
        on(Lost, Stopping, WITHDRAWN),
        on(Limiting, Starting, "freed, new target"),
        on(Limiting, Fault, FAULT),
        on(Limiting, Stopping, WITHDRAWN),
        on(Fault, Off, "enable withdrawn, cause gone"),
        on(Stopping, Off, "at rest"),
        on(Stopping, Fault, FAULT),
    ]
};
