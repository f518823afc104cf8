//! The second and third harmonic of a track in f32.

use crate::arithmetic::fixed::Fixed;
use crate::arithmetic::node::SINE_COSINE_SINGLE;
use crate::arithmetic::trigonometry::cosine_fine;
use crate::arithmetic::{Phase, sine_cosine_single};
use crate::feeder::OutOfRange;
use crate::impact::anchor::flight::Motion;
use crate::impact::wave::{Tone, accept_tones};

/// One harmonic, `e sin(n t + th)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Harmonic {
    /// e.
    amplitude: Fixed<32, u32>,
    /// th.
    angle: Phase,
    /// `e`, `e cos th` and `e sin th`.
    pub size: f32,
    mixed: [f32; 2],
}

impl Harmonic {
    /// A tone, with its angle rounded to a step of a phase.
    fn new(tone: Tone) -> Self {
        if tone.amplitude == 0.0 {
            return Self::default();
        }
        let phase = Phase::from_radians(tone.angle);
        let size = tone.amplitude as f32;
        let (sine, cosine) = sine_cosine_single(phase);
        Self {
            amplitude: Fixed::<32, u32>::nearest(tone.amplitude),
            angle: phase,
            size,
            mixed: [size * cosine, size * sine],
        }
    }

    /// `e sin` and `e cos` of the tone's angle, at a node of n times the phase.
    #[inline(always)]
    fn at_node(&self, [sine, cosine]: [f32; 2]) -> [f32; 2] {
        let [a, b] = self.mixed;
        [a * sine + b * cosine, a * cosine - b * sine]
    }

    /// The same at a phase `n t`.
    #[inline(always)]
    fn at(&self, phase: u32) -> [f32; 2] {
        let (sine, cosine) = sine_cosine_single(self.with_angle(phase));
        [self.size * sine, self.size * cosine]
    }

    #[inline(always)]
    fn with_angle(&self, phase: u32) -> Phase {
        Phase::from_bits(phase.wrapping_add(self.angle.bits()))
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Harmonics {
    pub second: Harmonic,
    pub third: Harmonic,
    pub is_of_three: bool,
}

/// Displacement and velocity of each tone over its frequency.
#[derive(Clone, Copy, Debug)]
pub(super) struct Parts(pub [[f32; 2]; 3]);

impl Harmonics {
    /// The harmonics of a wave. Errors: `OutOfRange` with the tone out of range.
    pub fn build(second: Tone, third: Tone) -> Result<Self, OutOfRange> {
        accept_tones(second, third)?;
        Ok(Self {
            second: Harmonic::new(second),
            third: Harmonic::new(third),
            is_of_three: third.amplitude != 0.0,
        })
    }

    /// Bound of the n-th derivative of S.
    pub fn bound(&self, n: u32) -> f32 {
        let power = |base: u32| base.pow(n) as f32;
        1.0 + self.second.size * power(2) + self.third.size * power(3)
    }

    #[inline(always)]
    pub fn at_node(&self, node: i32) -> Motion {
        let at = |node: i32| SINE_COSINE_SINGLE[(node & 255) as usize];
        let second = self.second.at_node(at(node.wrapping_mul(2)));
        let two = Motion::of_two(at(node), second);
        if !self.is_of_three {
            return two;
        }
        two.with_third(self.third.at_node(at(node.wrapping_mul(3))))
    }

    /// The tones at a phase, each within e times 6e-8.
    #[inline(always)]
    pub fn at(&self, phase: u32) -> Parts {
        let (sine, cosine) = sine_cosine_single(Phase::from_bits(phase));
        let third = if self.is_of_three {
            self.third.at(phase.wrapping_mul(3))
        } else {
            [0.0; 2]
        };
        Parts([[sine, cosine], self.second.at(phase.wrapping_mul(2)), third])
    }

    /// The sum of the tones' sines, each times a weight, within 3e-9.
    #[inline(never)]
    pub fn sines(&self, phase: Phase, [second, third]: [i64; 2]) -> Fixed<35, i64> {
        let sine = |phase: Phase| cosine_fine(phase - Phase::from_bits(1 << 30));
        let times = |harmonic: &Harmonic, n: u32| {
            let sine = sine(harmonic.with_angle(phase.bits().wrapping_mul(n)));
            let product = sine.to::<31>().0 * i64::from(harmonic.amplitude.0);
            Fixed::<63, i64>(product).to::<35>().0
        };
        let mut sum = sine(phase).to::<35>().0 + second * times(&self.second, 2);
        if self.is_of_three {
            sum += third * times(&self.third, 3);
        }
        Fixed(sum)
    }
}

impl Parts {
    /// The sum of the sines, each times a weight.
    #[inline(always)]
    pub fn sines(&self, second: f32, third: f32) -> f32 {
        let [[s, _], [s2, _], [s3, _]] = self.0;
        s + second * s2 + third * s3
    }

    /// The sum of the cosines.
    #[inline(always)]
    pub fn cosines(&self, second: f32, third: f32) -> f32 {
        let [[_, c], [_, c2], [_, c3]] = self.0;
        c + second * c2 + third * c3
    }
}
