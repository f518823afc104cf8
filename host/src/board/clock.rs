//! Time of a board: its 32-bit cycle counter, extended to 64 bits.

/// Cycles of a board since its start.
///
/// The board's counter of 32 bits wraps after 99 days at 500 Hz and after 2.7 years at 50 Hz. This
/// count continues over the wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Clock {
    last: Option<(u32, u64)>,
}

/// Largest number of cycles by which an event may be ahead of the last telemetry.
const MAX_CYCLES_AHEAD: u32 = 100_000;

impl Clock {
    /// The extended count of the present cycle, which the board counts as `cycle`.
    pub fn now(&mut self, cycle: u32) -> u64 {
        let total = match self.last {
            None => cycle.into(),
            Some((last, total)) => total.saturating_add(cycle.wrapping_sub(last).into()),
        };
        self.last = Some((cycle, total));
        total
    }

    /// The extended count of an event's cycle, in the past or a little ahead.
    pub fn then(&self, cycle: u32) -> u64 {
        let Some((last, total)) = self.last else {
            return cycle.into();
        };
        let ahead = cycle.wrapping_sub(last);
        if ahead <= MAX_CYCLES_AHEAD {
            return total.saturating_add(ahead.into());
        }
        // An event before the first reading, with a wrap between, keeps the board's count.
        total
            .checked_sub(last.wrapping_sub(cycle).into())
            .unwrap_or(cycle.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_count_continues_when_the_boards_counter_wraps() {
        let mut clock = Clock::default();
        assert_eq!(clock.then(7), 7);
        let whole = 1 << 32;
        for (cycle, total) in [
            (3_000_000_000, 3_000_000_000),
            (u32::MAX, whole - 1),
            (5, whole + 5),
            (3_000_000_000, whole + 3_000_000_000),
            (4, 2 * whole + 4),
        ] {
            assert_eq!(clock.now(cycle), total);
            assert_eq!(clock.then(cycle), total);
            assert_eq!(clock.then(cycle.wrapping_add(30)), total + 30);
            assert_eq!(
                clock.then(cycle.wrapping_sub(2_900_000_000)),
                total - 2_900_000_000
            );
        }
        let mut clock = Clock::default();
        clock.now(5);
        assert_eq!(clock.then(u32::MAX), u64::from(u32::MAX));
    }
}
