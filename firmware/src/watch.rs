//! Task supervision: the watchdog is fed only when every task has checked in.

use core::sync::atomic::{AtomicU32, Ordering};

/// Tasks that must check in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Watched {
    /// The sample interrupt.
    Samples = 1,
    /// The control of each drive cycle.
    Cycle = 2,
}

const ALL: u32 = Watched::Samples as u32 | Watched::Cycle as u32;

/// Record of the tasks that have checked in since the last feed, one bit each.
#[derive(Debug, Default)]
pub struct Roll(AtomicU32);

impl Roll {
    /// Builds an empty record.
    pub const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    /// Checks `who` in. Safe from an interrupt.
    pub fn check_in(&self, who: Watched) {
        self.0.fetch_or(who as u32, Ordering::Relaxed);
    }

    /// Whether all tasks have checked in; if so, the record is cleared.
    pub fn complete(&self) -> bool {
        let complete = self.0.load(Ordering::Relaxed) == ALL;
        if complete {
            self.0.store(0, Ordering::Relaxed);
        }
        complete
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_missing_task_is_enough_to_starve_the_watchdog() {
        let (samples, cycle) = (Watched::Samples, Watched::Cycle);
        for (missing, other) in [(samples, cycle), (cycle, samples)] {
            let roll = Roll::new();
            roll.check_in(other);
            assert!(!roll.complete(), "{missing:?}");
            roll.check_in(missing);
            assert!(roll.complete());
            assert!(!roll.complete(), "the roll starts anew");
        }
    }
}
