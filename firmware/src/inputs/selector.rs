//! Three inputs that select a recipe, debounced: a selection counts once it was constant for 50 ms.

use core::sync::atomic::{AtomicU8, Ordering};

/// Time for which a selection must be constant, ms.
const STABLE_MS: u8 = 50;

/// The inputs; one interrupt samples them each millisecond.
pub struct Selector {
    last: AtomicU8,
    /// Time since the selection last changed, ms, at most [`STABLE_MS`].
    constant: AtomicU8,
    selected: AtomicU8,
}

impl Selector {
    /// Open inputs: no recipe.
    pub const fn open() -> Self {
        Self {
            last: AtomicU8::new(0),
            constant: AtomicU8::new(0),
            selected: AtomicU8::new(0),
        }
    }

    /// Samples the number at the inputs, each millisecond.
    pub fn sample(&self, number: u8) {
        if self.last.load(Ordering::Relaxed) != number {
            self.last.store(number, Ordering::Relaxed);
            self.constant.store(0, Ordering::Relaxed);
            return;
        }
        let constant = self.constant.load(Ordering::Relaxed) + 1;
        if constant < STABLE_MS {
            self.constant.store(constant, Ordering::Relaxed);
        } else {
            self.selected.store(number, Ordering::Relaxed);
        }
    }

    /// The last number that was constant; 0 before the first.
    pub fn selected(&self) -> u8 {
        self.selected.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(selector: &Selector, number: u8, times: u32) -> u8 {
        (0..times).for_each(|_| selector.sample(number));
        selector.selected()
    }

    #[test]
    fn a_selection_counts_after_50_ms_without_a_change() {
        let selector = Selector::open();
        assert_eq!(after(&selector, 5, 50), 0);
        assert_eq!(after(&selector, 5, 1), 5);
        // The switches of a number do not change simultaneously, and bounce.
        for number in [4, 6, 7, 6, 7] {
            assert_eq!(after(&selector, number, 49), 5);
        }
        assert_eq!(after(&selector, 7, 2), 7);
        assert_eq!(after(&selector, 0, 51), 0);
    }
}
