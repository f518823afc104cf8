//! Times at which the parts in the hopper fall onto the track.

use super::scene::{PARTS, Scene};
use kband::arithmetic::Phase;

/// Arrival time of each part on the track, in 2^-32 turns of the drive; `u64::MAX` in the hopper.
#[derive(Clone, Debug)]
pub struct Hopper {
    arrives: [u64; PARTS],
    /// Index range of the waiting parts.
    first: usize,
    end: usize,
}

impl Hopper {
    pub fn new(scene: &Scene) -> Self {
        let end = scene.parts.len();
        let first = end.saturating_sub(usize::from(scene.waiting));
        let mut arrives = [0; PARTS];
        for arrival in arrives.iter_mut().take(end).skip(first) {
            *arrival = u64::MAX;
        }
        Self {
            arrives,
            first,
            end,
        }
    }

    /// Puts the first `count` parts on the track from `now` on; `arrive` gets each added one.
    pub fn place(&mut self, now: u64, count: u8, mut arrive: impl FnMut(usize)) {
        let count = usize::from(count).min(self.end);
        for (part, arrival) in self.arrives.iter_mut().enumerate().take(self.end) {
            if part >= count {
                *arrival = u64::MAX;
            } else if *arrival > now {
                *arrival = now;
                arrive(part);
            }
        }
        self.first = self.first.max(count);
    }

    /// Drops the waiting parts evenly within this number of turns of the drive, from `now` on.
    pub fn dump(&mut self, now: u64, turns: f64) {
        let count = self.end.saturating_sub(self.first).max(1) as f64;
        let waiting = self.arrives.iter_mut().take(self.end).skip(self.first);
        for (n, arrival) in waiting.enumerate() {
            *arrival = now + ((n as f64 + 1.0) / count * turns * Phase::TURN) as u64;
        }
        self.first = self.end;
    }

    #[inline]
    pub fn arrives(&self, part: usize) -> u64 {
        self.arrives.get(part).copied().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_parts_stay_and_missing_ones_arrive() {
        let mut hopper = Hopper::new(&Scene {
            parts: [0.2; 5].into_iter().collect(),
            waiting: 2,
            ..Scene::default()
        });
        let mut place = |now, count| {
            let mut arrived = std::vec::Vec::new();
            hopper.place(now, count, |part| arrived.push(part));
            let count = (0..5).filter(|part| hopper.arrives(*part) <= now).count();
            (count, arrived)
        };
        assert_eq!(place(10, 1), (1, std::vec![]));
        assert_eq!(place(20, 2), (2, std::vec![1]));
        assert_eq!(place(30, 4), (4, std::vec![2, 3]));
        assert_eq!(place(40, 0), (0, std::vec![]));
        // One part still waits, and falls only once.
        hopper.dump(50, 1.0);
        hopper.dump(60, 1.0);
        let arrivals = [0, 1, 2, 3, 4].map(|part| hopper.arrives(part));
        assert_eq!(arrivals[..4], [u64::MAX; 4]);
        assert_eq!(arrivals[4], 50 + (1 << 32));
    }
}
