//! Limits of a drive on k when the track moves with several tones
//! (docs/theory-real-parts.md#t10.3).

use super::part::{Tones, UpperTones};
use crate::arithmetic::{Phase, sine_cosine_single};

/// Lowest k at each limit of the drive with one tone, and output per upper tone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearLimits {
    /// k of one tone at the hard limit of displacement; 0: no limit.
    pub displacement: f32,
    /// k of one tone at the hard limit of acceleration; 0: no limit.
    pub acceleration: f32,
    /// k of one tone at the largest output; 0: no limit.
    pub output: f32,
    /// Output per amplitude ratio e of the second and third tone, over the output of the first.
    pub overtones: [f32; 2],
}

impl GearLimits {
    /// A drive without limits.
    pub const NONE: Self = Self {
        displacement: 0.0,
        acceleration: 0.0,
        output: 0.0,
        overtones: [0.0; 2],
    };

    /// Lowest k at which all limits hold with these tones.
    pub fn min_k(&self, tones: Tones) -> f32 {
        let [displacement, acceleration] = peaks(tones);
        let [second, third] = self.overtones;
        let [[of_second, _], [of_third, _]] = tones;
        (self.displacement * displacement)
            .max(self.acceleration * acceleration)
            .max(self.output * (1.0 + second * of_second + third * of_third))
    }
}

/// Upper bounds of displacement over b and acceleration over b w^2: max |S| and max |S''|. They are
/// the largest of 64 samples plus the largest remainder between samples.
pub fn peaks(tones: Tones) -> [f32; 2] {
    const SAMPLES: u32 = 64;
    let upper = UpperTones::new(tones);
    let [ratio, third] = upper.ratios;
    let (mut displacement, mut acceleration) = (0.0_f32, 0.0_f32);
    for n in 0..SAMPLES {
        let phase = Phase::from_bits(n << 26);
        let (sine, _) = sine_cosine_single(phase);
        let (second, _) = upper.second(phase);
        let (mut height, mut push) = (sine + ratio * second, sine + 4.0 * ratio * second);
        if third > 0.0 {
            let (sine, _) = upper.third(phase);
            height += third * sine;
            push += 9.0 * third * sine;
        }
        displacement = displacement.max(height.abs());
        acceleration = acceleration.max(push.abs());
    }
    // Taylor's remainder about the peak: half the largest second derivative times the squared
    // distance of half a sample.
    let half = core::f32::consts::PI / SAMPLES as f32;
    let between = 0.5 * half * half;
    [
        displacement + between * (1.0 + 4.0 * ratio + 9.0 * third),
        acceleration + between * (1.0 + 16.0 * ratio + 81.0 * third),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peaks_bound_a_fine_grid() {
        for tones in [
            [[0.0; 2]; 2],
            [[0.15, 2.356], [0.0; 2]],
            [[0.25, 2.6], [0.0; 2]],
            [[0.5, -1.0], [0.0; 2]],
            [[0.274, 2.57], [0.058, 5.3]],
            [[0.2, 2.57], [0.1, 1.0]],
        ] {
            let [displacement, acceleration] = peaks(tones).map(f64::from);
            let [[e, th], [e3, th3]] = tones.map(|tone| tone.map(f64::from));
            let (mut max_displacement, mut max_acceleration) = (0.0_f64, 0.0_f64);
            for n in 0..20_000 {
                let t = f64::from(n) * core::f64::consts::TAU / 20_000.0;
                let (first, second) = (libm::sin(t), e * libm::sin(2.0 * t + th));
                let third = e3 * libm::sin(3.0 * t + th3);
                max_displacement = max_displacement.max((first + second + third).abs());
                max_acceleration = max_acceleration.max((first + 4.0 * second + 9.0 * third).abs());
            }
            let excess = displacement - max_displacement;
            assert!((-1e-6..0.01).contains(&excess), "{tones:?}");
            let excess = acceleration - max_acceleration;
            assert!((-1e-6..0.015).contains(&excess), "{tones:?}");
        }
    }

    #[test]
    fn tones_are_allowed_up_to_each_limit() {
        let tones = [[0.15, 2.356], [0.05, 5.3]];
        let [displacement, acceleration] = peaks(tones);
        for ([displacement, acceleration, output], k) in [
            ([0.3, 0.0, 0.0], 0.3 * displacement),
            ([0.0, 0.2, 0.0], 0.2 * acceleration),
            ([0.0, 0.0, 0.2], 0.2 * 2.1),
        ] {
            let limits = GearLimits {
                displacement,
                acceleration,
                output,
                overtones: [4.0, 10.0],
            };
            assert!((k * 0.999..=k * 1.001).contains(&limits.min_k(tones)));
        }
        assert!(GearLimits::NONE.min_k([[0.5, 0.0], [0.0; 2]]) <= 0.01);
    }
}
