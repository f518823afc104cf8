//! Helpers of the tests: the seed of random draws, an exchange, and a changed value.

use crate::exchange::Exchange;
use std::boxed::Box;

/// Seed of random draws: `KBAND_SEED`, else a fixed one.
pub fn seed(fixed: u64) -> u64 {
    std::env::var("KBAND_SEED").map_or(fixed, |text| text.parse().expect("a whole number"))
}

pub fn exchange() -> &'static Exchange {
    Box::leak(Box::new(Exchange::empty()))
}

/// `value`, changed.
pub fn with<T>(mut value: T, change: impl FnOnce(&mut T)) -> T {
    change(&mut value);
    value
}
