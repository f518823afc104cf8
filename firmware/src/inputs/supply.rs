//! Supply supervision: decides whether the supply is good enough to write the flash.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// Time for which the supply must be good before the flash is programmed or erased, ms.
pub const SETTLING_TIME: u32 = 100;

/// Reports of the supply monitor.
#[derive(Debug, Default)]
pub struct Supply {
    fell: AtomicBool,
    /// Time since the start when the supply was last low, ms. A start counts as low.
    low_at: AtomicU32,
}

impl Supply {
    /// Builds a supply that was low at the start.
    pub const fn new() -> Self {
        Self {
            fell: AtomicBool::new(false),
            low_at: AtomicU32::new(0),
        }
    }

    /// Records that the supply fell or returned: it was low until now. For the monitor's interrupt.
    pub fn falls(&self) {
        self.fell.store(true, Ordering::Relaxed);
    }

    /// Whether the supply has fallen since the last call of [`Supply::take_is_low`].
    pub fn has_fallen(&self) -> bool {
        self.fell.load(Ordering::Relaxed)
    }

    /// Whether the supply is low (`low`), or has fallen since the last call, at `now` ms since the
    /// start. For the control of each cycle.
    pub fn take_is_low(&self, low: bool, now: u32) -> bool {
        let low = self.fell.swap(false, Ordering::Relaxed) || low;
        if low {
            self.low_at.store(now, Ordering::Relaxed);
        }
        low
    }

    /// Whether the supply was good for [`SETTLING_TIME`] up to `now` ms since the start; `low`: it
    /// is low now.
    pub fn is_settled(&self, low: bool, now: u32) -> bool {
        if low || self.has_fallen() {
            self.low_at.store(now, Ordering::Relaxed);
            return false;
        }
        now.wrapping_sub(self.low_at.load(Ordering::Relaxed)) >= SETTLING_TIME
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_supply_settles_100_ms_after_it_was_low() {
        let supply = Supply::new();
        assert!(!supply.is_settled(false, 99), "after the start");
        assert!(supply.is_settled(false, 100));
        supply.falls();
        assert!(!supply.is_settled(false, 1000));
        let holds = !supply.is_settled(false, 2000);
        assert!(holds, "the control has not seen it");
        assert!(supply.take_is_low(false, 2010));
        assert!(!supply.take_is_low(false, 2020));
        assert!(!supply.is_settled(false, 2109));
        assert!(supply.is_settled(false, 2110));
        assert!(!supply.is_settled(true, 3000));
        assert!(!supply.is_settled(false, 3099));
        assert!(supply.is_settled(false, 3100));
        assert!(supply.take_is_low(true, 4000) && !supply.is_settled(false, 4099));
    }
}
