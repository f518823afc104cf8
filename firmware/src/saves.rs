//! Rate limit of saves (token bucket), so that the flash does not wear out.

/// Largest number of saves in a burst, and of saves given back an hour. At this rate the smallest
/// memory, 40 000 saves, lasts 27 days, and that of the STM32F405 7 months.
const MAX_SAVES_PER_HOUR: u8 = 60;
/// Time after which another save is allowed, s.
const SAVE_INTERVAL_S: u32 = 3600 / MAX_SAVES_PER_HOUR as u32;

/// Number of saves left. A faulty program at the desk must not wear out the flash.
#[derive(Clone, Copy, Debug)]
pub struct Saves {
    left: u8,
    /// Time since the start at which the last save was given back, s.
    since: u32,
}

impl Default for Saves {
    fn default() -> Self {
        Self {
            left: MAX_SAVES_PER_HOUR,
            since: 0,
        }
    }
}

impl Saves {
    /// Takes a save at `now` s since the start; returns whether it is allowed.
    pub fn take_save(&mut self, now: u32) -> bool {
        let back = now.saturating_sub(self.since) / SAVE_INTERVAL_S;
        self.since += back * SAVE_INTERVAL_S;
        self.left = u32::from(self.left)
            .saturating_add(back)
            .min(MAX_SAVES_PER_HOUR.into()) as u8;
        match self.left.checked_sub(1) {
            Some(left) => {
                self.left = left;
                true
            }
            None => false,
        }
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
        // A day without a save gives back no more than one burst.
        assert_eq!((0..100).filter(|_| saves.take_save(90_000)).count(), 60);
    }
}
