//! Enable input: debounce by consecutive equal samples, and a count of gaps in a sliding window.
//!
//! A gap is a sample in which the input was not high all the time.

use kband_control::SAMPLE_RATE;

/// State of the enable input between two samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Contact {
    /// Low all the time.
    Open,
    /// High all the time.
    Closed,
    /// It changed.
    #[default]
    Moved,
}

/// The enable input over a drive cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct EnableCycle {
    /// Whether it was high at any sample.
    pub given: bool,
    pub held_off: bool,
    pub chatters: bool,
}

/// Time without a gap before the drive may run, and limit of a contact's bounces, samples (20 ms).
const PRESS_SAMPLES: u16 = samples(20);
/// Time without a change after which the input is settled, samples: the slowest chatter's 100 ms.
const SETTLED_SAMPLES: u16 = samples(100);
/// Length of the window in which gaps are counted, samples (5 ms).
const GAP_WINDOW: u32 = samples(5) as u32;
/// Largest number of gaps in that window at which the drive stays on. Chatter that is low for at
/// least 10 % of its period causes 9 or more gaps in the first window after its first gap.
const MAX_GAPS: usize = 8;

/// Number of samples in a time in ms.
const fn samples(milliseconds: u32) -> u16 {
    (SAMPLE_RATE / 1000 * milliseconds) as u16
}

/// The enable input, at first in an unknown state: the drive is off until the input has settled low.
#[derive(Clone, Debug, Default)]
pub(crate) struct Debounce {
    on: bool,
    /// Whether the input was settled low before it rose, and bounced no longer than a contact.
    armed: bool,
    /// Whether the input has bounced longer than a contact does and has not settled yet.
    chatters: bool,
    /// Whether chatter began since the last call of [`Debounce::take_chatter`].
    began: bool,
    contact: Contact,
    /// Number of samples since the input last moved.
    steady: u16,
    /// Number of samples since the input was last settled or switched the drive off.
    unsettled: u16,
    /// Sample counter while the drive is on, from [`GAP_WINDOW`], and its values at the last gaps.
    now: u32,
    gaps: [u32; MAX_GAPS],
    oldest: u8,
}

impl Debounce {
    /// Processes a sample; returns whether the drive may run.
    #[inline]
    pub fn sample(&mut self, contact: Contact) -> bool {
        if self.on {
            self.now = self.now.wrapping_add(1);
            if contact != Contact::Closed {
                self.take_gap();
            }
        } else {
            self.wait(contact);
        }
        self.on
    }

    /// Whether the drive may run.
    #[inline]
    pub fn is_on(&self) -> bool {
        self.on
    }

    /// Whether the input began to chatter since the last call.
    pub fn take_chatter(&mut self) -> bool {
        core::mem::take(&mut self.began)
    }

    /// Counts a gap; switches the drive off if the window holds too many.
    #[cold]
    fn take_gap(&mut self) {
        let oldest = &mut self.gaps[usize::from(self.oldest) % MAX_GAPS];
        self.oldest = self.oldest.wrapping_add(1);
        if self.now.wrapping_sub(core::mem::replace(oldest, self.now)) < GAP_WINDOW {
            *self = Self {
                began: self.began,
                ..Self::default()
            };
        }
    }

    /// Waits for a press: low for 100 ms, bounces for 20 ms at most, then high for 20 ms.
    #[inline(never)]
    fn wait(&mut self, contact: Contact) {
        let moved = contact == Contact::Moved || contact != self.contact;
        self.contact = contact;
        self.steady = if moved {
            0
        } else {
            self.steady.saturating_add(1)
        };
        self.unsettled = self.unsettled.saturating_add(1);
        if self.steady >= SETTLED_SAMPLES {
            self.unsettled = 0;
            self.armed = contact == Contact::Open;
            self.chatters = false;
        } else if moved && self.unsettled > PRESS_SAMPLES {
            self.began |= !self.chatters;
            self.chatters = true;
            self.armed = false;
        }
        if self.armed && contact == Contact::Closed && self.steady >= PRESS_SAMPLES {
            self.on = true;
            self.now = GAP_WINDOW;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sample `n` of an input that is high for `duty` of each period, from `phase` in turns.
    fn chatter(frequency: f64, duty: f64, phase: f64, n: u32) -> Contact {
        let half = |n: u32| {
            let turns = phase + frequency * f64::from(n) / f64::from(SAMPLE_RATE);
            2 * turns as u64 + u64::from(turns.fract() >= duty)
        };
        match (half(n), half(n + 1)) {
            (before, after) if before != after => Contact::Moved,
            (half, _) if half % 2 == 0 => Contact::Closed,
            _ => Contact::Open,
        }
    }

    /// Frequencies from 10 Hz to 5 kHz, 2.5 % apart, with duties of 10 to 90 %.
    fn grid() -> impl Iterator<Item = (f64, f64)> {
        (0..=252).flat_map(|n| {
            let frequency = (10.0 * 1.025_f64.powi(n)).min(5000.0);
            (1..10).map(move |tenth| (frequency, 0.1 * f64::from(tenth)))
        })
    }

    /// State of the debounce after these contacts, each with its time in ms.
    fn after(contacts: &[(Contact, u32)]) -> Debounce {
        let mut input = Debounce::default();
        feed(&mut input, contacts);
        input
    }

    fn feed(input: &mut Debounce, contacts: &[(Contact, u32)]) -> bool {
        for &(contact, time) in contacts {
            for _ in 0..samples(time) {
                input.sample(contact);
            }
        }
        input.on
    }

    use Contact::{Closed, Moved, Open};

    #[test]
    fn a_press_switches_on_after_20_ms_without_a_gap() {
        let mut input = after(&[(Open, 101), (Closed, 20)]);
        assert!(!input.on);
        assert!(input.sample(Closed) && input.sample(Moved), "a gap");
        // It bounces for 15 ms, then for 25 ms in total.
        let mut bouncing = after(&[(Open, 101), (Moved, 15), (Closed, 20)]);
        assert!(bouncing.sample(Closed) && !bouncing.take_chatter());
        let mut longer = after(&[(Open, 101), (Moved, 25), (Closed, 1000)]);
        assert!(!longer.on && longer.take_chatter());
        assert!(feed(&mut longer, &[(Open, 101), (Closed, 21)]));
    }

    #[test]
    fn an_input_that_was_not_low_for_100_ms_starts_nothing() {
        assert!(!after(&[(Closed, 1000)]).on, "since power-on");
        let running = after(&[(Open, 101), (Closed, 21)]);
        for (low, on) in [(1, false), (99, false), (101, true)] {
            let mut input = running.clone();
            feed(&mut input, &[(Open, low)]);
            assert!(!input.on, "{low} ms");
            assert_eq!(feed(&mut input, &[(Closed, 1000)]), on, "{low} ms");
        }
    }

    #[test]
    fn a_withdrawal_switches_off_within_2_ms_and_is_no_chatter() {
        let mut input = after(&[(Open, 101), (Closed, 30), (Open, 2)]);
        assert!(!input.on);
        feed(&mut input, &[(Moved, 10), (Open, 1000), (Closed, 30)]);
        assert!(input.on && !input.take_chatter());
    }

    #[test]
    fn eight_gaps_in_5_ms_leave_the_drive_on() {
        let mut input = after(&[(Open, 101), (Closed, 30)]);
        for _ in 0..20 {
            assert!((0..8).all(|_| input.sample(Moved)));
            assert!((0..92).all(|_| input.sample(Closed)));
        }
        assert!((0..8).all(|_| input.sample(Moved)) && !input.sample(Moved));
    }

    #[test]
    fn chatter_of_10_hz_to_5_khz_switches_off_within_5_ms() {
        let running = after(&[(Open, 101), (Closed, 30)]);
        for (frequency, duty) in grid() {
            for step in 0..20 {
                // The first gap begins within the first sample.
                let phase = duty - frequency / f64::from(SAMPLE_RATE) * f64::from(step) / 20.0;
                let phase = if phase < 0.0 { phase + 1.0 } else { phase };
                let mut input = running.clone();
                let off = (0..200)
                    .find(|&n| !input.sample(chatter(frequency, duty, phase, n)))
                    .map(|n| n + 1);
                let holds = off.is_some_and(|n| n <= GAP_WINDOW);
                assert!(holds, "{frequency} Hz, {duty}, {step}: {off:?}");
            }
        }
    }

    #[test]
    fn chatter_never_switches_on_and_is_reported_once() {
        for (frequency, duty) in grid() {
            let mut input = after(&[(Open, 101), (Closed, 30)]);
            let mut chatter = (0..10_000).map(|n| chatter(frequency, duty, duty, n));
            while input.sample(chatter.next().unwrap()) {}
            let mut reported = 0;
            for contact in chatter {
                assert!(!input.sample(contact), "{frequency} Hz, {duty}");
                reported += u32::from(input.take_chatter());
            }
            assert_eq!(reported, 1, "{frequency} Hz, {duty}");
            // One episode ends; the next one is reported too.
            assert!(feed(&mut input, &[(Open, 101), (Closed, 30)]));
            feed(&mut input, &[(Open, 50), (Closed, 1)]);
            assert!(input.take_chatter());
        }
    }
}
