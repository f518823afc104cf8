//! Time as a board's cycles count it.

/// Cycles of a board since it started.
///
/// The board counts in 32 bits, which begin anew after 99 days at 500 Hz and 2.7 years at 50 Hz;
/// this count goes on from the first reading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Clock {
    last: Option<(u32, u64)>,
}

/// Most cycles by which an event may be ahead of the last telemetry.
const MAX_CYCLES_AHEAD: u32 = 100_000;

impl Clock {
    /// The cycles at the board's count `cycle`, which is now.
    pub fn now(&mut self, cycle: u32) -> u64 {
        let total = match self.last {
            None => cycle.into(),
            Some((last, total)) => total.saturating_add(cycle.wrapping_sub(last).into()),
        };
        self.last = Some((cycle, total));
        total
    }

    /// The cycles at the board's count `cycle` of an event, which lies in the past or a little
    /// ahead.
    pub fn then(&self, cycle: u32) -> u64 {
        let Some((last, total)) = self.last else {
            return cycle.into();
        };
        let ahead = cycle.wrapping_sub(last);
        if ahead <= MAX_CYCLES_AHEAD {
            return total.saturating_add(ahead.into());
        }
        // What was before the count began anew, unheard, keeps its own count.
        total
            .checked_sub(last.wrapping_sub(cycle).into())
            .unwrap_or(cycle.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_count_goes_on_where_the_boards_begins_anew() {
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
