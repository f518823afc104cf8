//! Resets in a row: after three without ten good seconds between them the board stays at rest.

use core::sync::atomic::{AtomicU32, Ordering};

use kband::control::StartCause;

use crate::start::ResetCause;

/// Resets by a watchdog or by the firmware in a row from which on the board stays at rest.
const RESETS_IN_A_ROW: u32 = 3;
/// Time in s of good operation after which they are forgotten.
pub const GOOD_SECONDS: u64 = 10;
/// Count after an acknowledgement.
const ACKNOWLEDGED: u32 = 0xacac_acac;
/// Tells a count from what RAM holds after power-on.
const MARK: u32 = 0x7a3c_59e1;

/// A count in RAM that a reset leaves alone; what that RAM holds after power-on counts as none.
pub struct Resets {
    count: AtomicU32,
    check: AtomicU32,
}

impl Resets {
    /// No resets.
    #[must_use]
    pub const fn none() -> Self {
        Self {
            count: AtomicU32::new(0),
            check: AtomicU32::new(0),
        }
    }

    fn count(&self) -> u32 {
        let count = self.count.load(Ordering::Relaxed);
        let sound = self.check.load(Ordering::Relaxed) == count ^ MARK;
        if sound { count } else { 0 }
    }

    fn keep(&self, count: u32) {
        self.count.store(count, Ordering::Relaxed);
        self.check.store(count ^ MARK, Ordering::Relaxed);
    }

    /// Counts a start for this cause; how the controller has to start.
    pub fn start(&self, cause: ResetCause) -> StartCause {
        let count = match (cause, self.count()) {
            // The reset that follows an acknowledgement is no fault.
            (ResetCause::Software, ACKNOWLEDGED) => {
                self.forget();
                return StartCause::PowerOn;
            }
            (ResetCause::Power | ResetCause::BrownOut, _) | (_, ACKNOWLEDGED) => 0,
            (ResetCause::Watchdog | ResetCause::Software, count) => count + 1,
        };
        self.keep(count.min(RESETS_IN_A_ROW));
        if count < RESETS_IN_A_ROW {
            cause.start()
        } else {
            StartCause::Repeated
        }
    }

    /// The board works: the resets are forgotten.
    pub fn forget(&self) {
        self.keep(0);
    }

    /// Somebody acknowledged the resets: the next one, by the firmware, is no fault.
    pub fn acknowledge(&self) {
        self.keep(ACKNOWLEDGED);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_third_reset_in_a_row_is_one_too_many() {
        let resets = Resets::none();
        let (fault, repeated) = (StartCause::Reset, StartCause::Repeated);
        assert_eq!(resets.start(ResetCause::Power), StartCause::PowerOn);
        for cause in [ResetCause::Watchdog, ResetCause::Software] {
            resets.forget();
            assert_eq!(resets.start(cause), fault);
            assert_eq!(resets.start(ResetCause::Watchdog), fault);
            assert_eq!(resets.start(cause), repeated);
            assert_eq!(resets.start(cause), repeated);
            assert_eq!(resets.start(ResetCause::BrownOut), fault);
        }
        // Acknowledged, the firmware resets the board and starts as after power-on.
        resets.acknowledge();
        assert_eq!(resets.start(ResetCause::Software), StartCause::PowerOn);
        assert_eq!(resets.start(ResetCause::Watchdog), fault);
        // What the RAM holds after power-on is no count.
        resets.count.store(0xdead_beef, Ordering::Relaxed);
        assert_eq!(resets.start(ResetCause::Watchdog), fault);
        assert_eq!(resets.start(ResetCause::Watchdog), fault);
        assert_eq!(resets.start(ResetCause::Watchdog), repeated);
    }
}
