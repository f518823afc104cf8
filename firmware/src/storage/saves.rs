//! Rate limit of saves (token bucket), so that the flash does not wear out.

/// Largest number of saves in a burst, and of saves restored per hour. At this rate the smallest
/// memory, 40 000 saves, lasts 27 days, and that of the STM32F405 7 months.
const MAX_SAVES_PER_HOUR: u32 = 60;
/// Time after which another save is allowed, s.
const SAVE_INTERVAL_S: u32 = 3600 / MAX_SAVES_PER_HOUR;

/// Number of saves that are not restored yet. A faulty program at the desk must not wear out the
/// flash.
#[derive(Clone, Copy, Debug, Default)]
pub struct Saves {
    used: u32,
    /// Time since the start of the last restored save, s.
    since: u32,
}

impl Saves {
    /// Takes a save at `now` s since the start; returns whether it is allowed.
    pub fn take_save(&mut self, now: u32) -> bool {
        let regained = now.saturating_sub(self.since) / SAVE_INTERVAL_S;
        self.since += regained * SAVE_INTERVAL_S;
        self.used = self.used.saturating_sub(regained);
        let allowed = self.used < MAX_SAVES_PER_HOUR;
        self.used += u32::from(allowed);
        allowed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixty_in_a_burst_and_one_a_minute_from_then_on() {
        let mut saves = Saves::default();
        assert_eq!((0..100).filter(|_| saves.take_save(5)).count(), 60);
        assert_eq!((6..3606).filter(|now| saves.take_save(*now)).count(), 60);
        // A day without a save restores no more than one burst.
        assert_eq!((0..100).filter(|_| saves.take_save(90_000)).count(), 60);
    }
}
