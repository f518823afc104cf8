//! Rate limit of saves (token bucket), so that the flash does not wear out.

/// Largest number of saves in a burst, and of saves given back an hour. At this rate the smallest
/// memory, 140 000 saves, lasts 97 days, and that of the STM32F405 19 years.
const AN_HOUR: u8 = 60;
/// Time after which another save is allowed, s.
const APART: u32 = 3600 / AN_HOUR as u32;

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
            left: AN_HOUR,
            since: 0,
        }
    }
}

impl Saves {
    /// Takes a save at `now` s since the start; returns whether it is allowed.
    pub fn one_more(&mut self, now: u32) -> bool {
        let back = now.saturating_sub(self.since) / APART;
        self.since += back * APART;
        self.left = u32::from(self.left)
            .saturating_add(back)
            .min(AN_HOUR.into()) as u8;
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
        assert_eq!((0..100).filter(|_| saves.one_more(5)).count(), 60);
        assert_eq!((6..3606).filter(|now| saves.one_more(*now)).count(), 60);
        // A day without a save gives back no more than one burst.
        assert_eq!((0..100).filter(|_| saves.one_more(90_000)).count(), 60);
    }
}
