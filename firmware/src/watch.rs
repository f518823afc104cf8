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

/// Record of the tasks that have checked in since the last feed.
#[derive(Debug)]
pub struct Roll {
    expected: u32,
    present: AtomicU32,
}

impl Roll {
    /// Requires all of `expected` to check in.
    pub const fn of(expected: &[Watched]) -> Self {
        let mut bits = 0;
        let mut index = 0;
        while index < expected.len() {
            bits |= expected[index] as u32;
            index += 1;
        }
        Self {
            expected: bits,
            present: AtomicU32::new(0),
        }
    }

    /// Checks `who` in. Safe from an interrupt.
    pub fn check_in(&self, who: Watched) {
        self.present.fetch_or(who as u32, Ordering::Relaxed);
    }

    /// Whether all tasks have checked in; if so, the record is cleared.
    pub fn complete(&self) -> bool {
        let complete = self.present.load(Ordering::Relaxed) & self.expected == self.expected;
        if complete {
            self.present.store(0, Ordering::Relaxed);
        }
        complete
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Watched; 2] = [Watched::Samples, Watched::Cycle];

    #[test]
    fn one_missing_task_is_enough_to_starve_the_watchdog() {
        for missing in ALL {
            let roll = Roll::of(&ALL);
            for who in ALL.into_iter().filter(|who| *who != missing) {
                roll.check_in(who);
            }
            assert!(!roll.complete(), "{missing:?}");
            roll.check_in(missing);
            assert!(roll.complete());
            assert!(!roll.complete(), "the roll starts anew");
        }
    }
}
