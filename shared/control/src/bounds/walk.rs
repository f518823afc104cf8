//! Random walk through the accepted settings, the input of property-based tests of the limits.

use super::Settings;
use kband::arithmetic::Noise;

/// A walk through the accepted settings: each step draws some keys and keeps the accepted values.
pub struct Walk {
    pub noise: Noise,
    settings: Settings,
}

impl Walk {
    pub fn new(seed: u64) -> Self {
        Self {
            noise: Noise::new(seed),
            settings: Settings::default(),
        }
    }

    /// A number from `low` to 1, uniform on a logarithmic scale.
    pub fn ratio(&mut self, low: f32) -> f32 {
        libm::powf(low, self.noise.uniform())
    }

    pub fn step(&mut self, keys: u32) -> Settings {
        for _ in 0..keys {
            let key = &Settings::KEYS[self.noise.bits() as usize % Settings::KEYS.len()];
            let share = match self.noise.bits() % 8 {
                0 => 0.0,
                1 => 1.0,
                2..5 => self.noise.uniform(),
                _ => self.ratio(1e-5),
            };
            let mut next = self.settings;
            let value = key.low + share * (key.high - key.low);
            if next.set(key.name, value).is_ok() && next.check().is_ok() {
                self.settings = next;
            }
        }
        self.settings
    }
}
