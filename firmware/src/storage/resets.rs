//! Counter of successive resets: after three without 10 s of good operation in between, the board
//! stays at rest.

use crate::start::ResetCause;
use core::sync::atomic::{AtomicU32, Ordering};
use kband_control::StartCause;

/// Number of successive resets by a watchdog or the firmware at which the board stays at rest.
const MAX_SUCCESSIVE_RESETS: u32 = 3;
/// Time of good operation after which the count is cleared, s.
pub const GOOD_OPERATION_S: u64 = 10;
/// Value of the count after an acknowledgement.
const ACKNOWLEDGED: u32 = 0xacac_acac;
/// Mark that distinguishes a count from the arbitrary RAM content after power-on.
const MARK: u32 = 0x7a3c_59e1;

/// Count in RAM that a reset does not change. Without its mark it counts as zero.
pub struct Resets {
    count: AtomicU32,
    check: AtomicU32,
}

impl Resets {
    /// No resets.
    pub const fn none() -> Self {
        Self {
            count: AtomicU32::new(0),
            check: AtomicU32::new(0),
        }
    }

    fn count(&self) -> u32 {
        let count = self.count.load(Ordering::Relaxed);
        let is_valid = self.check.load(Ordering::Relaxed) == count ^ MARK;
        if is_valid { count } else { 0 }
    }

    fn keep(&self, count: u32) {
        self.count.store(count, Ordering::Relaxed);
        self.check.store(count ^ MARK, Ordering::Relaxed);
    }

    /// Counts a start with this cause; returns the cause of the start for the controller.
    pub fn start(&self, cause: ResetCause) -> StartCause {
        let count = match (cause, self.count()) {
            // The reset after an acknowledgement is not a fault.
            (ResetCause::Software, ACKNOWLEDGED) => {
                self.clear();
                return StartCause::PowerOn;
            }
            (ResetCause::Power | ResetCause::BrownOut, _) | (_, ACKNOWLEDGED) => 0,
            (ResetCause::Watchdog | ResetCause::Software, count) => count + 1,
        };
        self.keep(count.min(MAX_SUCCESSIVE_RESETS));
        if count < MAX_SUCCESSIVE_RESETS {
            cause.start()
        } else {
            StartCause::Repeated
        }
    }

    /// Clears the count after good operation.
    pub fn clear(&self) {
        self.keep(0);
    }

    /// Records an acknowledgement: the next reset by the firmware is not a fault.
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
            resets.clear();
            assert_eq!(resets.start(cause), fault);
            assert_eq!(resets.start(ResetCause::Watchdog), fault);
            assert_eq!(resets.start(cause), repeated);
            assert_eq!(resets.start(cause), repeated);
            assert_eq!(resets.start(ResetCause::BrownOut), fault);
        }
        // After an acknowledgement the firmware resets the board, which starts as after power-on.
        resets.acknowledge();
        assert_eq!(resets.start(ResetCause::Software), StartCause::PowerOn);
        assert_eq!(resets.start(ResetCause::Watchdog), fault);
        // Arbitrary RAM content after power-on does not count.
        resets.count.store(0xdead_beef, Ordering::Relaxed);
        assert_eq!(resets.start(ResetCause::Watchdog), fault);
        assert_eq!(resets.start(ResetCause::Watchdog), fault);
        assert_eq!(resets.start(ResetCause::Watchdog), repeated);
    }
}
