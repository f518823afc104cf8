//! Helpers of the tests: the seed of property-based tests, a changed value, settings of a lot.

use crate::Settings;
use proptest::prelude::ProptestConfig;
use proptest::test_runner::RngSeed;

/// Configuration with the seed `KBAND_SEED`, else with a fixed one.
pub fn seeded() -> ProptestConfig {
    let seed = std::env::var("KBAND_SEED").map_or(1, |text| text.parse().expect("a whole number"));
    ProptestConfig {
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(seed),
        ..ProptestConfig::default()
    }
}

pub fn with<T>(mut value: T, change: impl FnOnce(&mut T)) -> T {
    change(&mut value);
    value
}

/// Default settings, for parts with restitutions of this interval.
pub fn lot(low: f32, high: f32) -> Settings {
    Settings {
        restitution_low: low,
        restitution_high: high,
        ..Settings::default()
    }
}
