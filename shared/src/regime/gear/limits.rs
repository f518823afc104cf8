//! What a drive affords of a second tone.

use super::rider::Second;
use crate::arithmetic::{Phase, sine_cosine_single};

/// The lowest k that each of a drive's limits allows with one tone, and what a second tone takes of its output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearLimits {
    /// k of one tone at the hard limit of displacement; 0: no limit.
    pub displacement: f32,
    /// k of one tone at the hard limit of acceleration; 0: no limit.
    pub acceleration: f32,
    /// k of one tone at the largest output; 0: no limit.
    pub output: f32,
    /// Output that a second tone of e = 1 takes, over that of the first.
    pub overtone: f32,
}

impl GearLimits {
    /// A drive that affords everything.
    #[cfg(test)]
    pub const NONE: Self = Self {
        displacement: 0.0,
        acceleration: 0.0,
        output: 0.0,
        overtone: 0.0,
    };

    /// Whether the drive affords a second tone at a k.
    #[must_use]
    pub fn afford(&self, k: f32, second: Second) -> bool {
        k >= self.least(second)
    }

    /// The least k at which the drive affords a second tone.
    #[must_use]
    pub fn least(&self, second: Second) -> f32 {
        let [displacement, acceleration] = peaks(second);
        (self.displacement * displacement)
            .max(self.acceleration * acceleration)
            .max(self.output * (1.0 + self.overtone * second[0]))
    }
}

/// Largest displacement of a track over b, and largest acceleration over b w^2: max |S| and max |S''|, from 64 places of
/// the turn, with what may lie between them.
#[must_use]
pub fn peaks([ratio, angle]: Second) -> [f32; 2] {
    const PLACES: u32 = 64;
    let angle = Phase::from_radians(f64::from(angle));
    let (mut displacement, mut acceleration) = (0.0_f32, 0.0_f32);
    for n in 0..PLACES {
        let (sine, _) = sine_cosine_single(Phase::from_bits(n << 26));
        let (second, _) = sine_cosine_single(Phase::from_bits(n << 27) + angle);
        displacement = displacement.max((sine + ratio * second).abs());
        acceleration = acceleration.max((sine + 4.0 * ratio * second).abs());
    }
    // Half a step from the nearest place, squared, times half the largest second derivative.
    let half = core::f32::consts::PI / PLACES as f32;
    let between = 0.5 * half * half;
    [
        displacement + between * (1.0 + 4.0 * ratio),
        acceleration + between * (1.0 + 16.0 * ratio),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peaks_are_those_of_a_fine_grid_and_no_less() {
        for (ratio, angle) in [(0.0, 0.0), (0.15, 2.356), (0.25, 2.6), (0.5, -1.0)] {
            let [displacement, acceleration] = peaks([ratio, angle]).map(f64::from);
            let (e, th) = (f64::from(ratio), f64::from(angle));
            let (mut most, mut hardest) = (0.0_f64, 0.0_f64);
            for n in 0..20_000 {
                let t = f64::from(n) * core::f64::consts::TAU / 20_000.0;
                let (first, second) = (libm::sin(t), e * libm::sin(2.0 * t + th));
                most = most.max((first + second).abs());
                hardest = hardest.max((first + 4.0 * second).abs());
            }
            assert!(
                (most - 1e-6..most + 0.01).contains(&displacement),
                "{ratio} {angle}"
            );
            assert!(
                (hardest - 1e-6..hardest + 0.012).contains(&acceleration),
                "{ratio} {angle}"
            );
        }
    }

    #[test]
    fn a_tone_is_afforded_up_to_each_limit() {
        let second = [0.15, 2.356];
        let [displacement, acceleration] = peaks(second);
        for (limits, k) in [
            (
                GearLimits {
                    displacement: 0.3,
                    ..GearLimits::NONE
                },
                0.3 * displacement,
            ),
            (
                GearLimits {
                    acceleration: 0.2,
                    ..GearLimits::NONE
                },
                0.2 * acceleration,
            ),
            (
                GearLimits {
                    output: 0.2,
                    overtone: 4.0,
                    ..GearLimits::NONE
                },
                0.2 * 1.6,
            ),
        ] {
            assert!(limits.afford(k * 1.001, second) && !limits.afford(k * 0.999, second));
        }
        assert!(GearLimits::NONE.afford(0.01, [0.5, 0.0]));
    }
}
