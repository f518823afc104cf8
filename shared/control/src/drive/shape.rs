//! Shape of the track's motion: upper tones over the first (docs/theory-real-parts.md#t10.3).

use crate::angle::phase_of;
use core::f32::consts::TAU;
use kband::arithmetic::{sine_cosine_single, square_root_single};
use kband::feeder::{OutOfRange, accept};
use kband::regime::gear;
use num_complex::Complex32 as Complex;
use serde::{Deserialize, Serialize};

/// Number of upper tones: the second and the third.
pub const UPPER: usize = 2;

/// Upper tone of the track's motion: `e sin(n tau + th)` over the first's amplitude, tau its phase.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct UpperTone {
    /// Amplitude over that of the first tone (symbol e), 0..0.5; 0 means none.
    pub ratio: f32,
    /// Phase angle (symbol th) in rad, -2 pi..2 pi.
    pub phase: f32,
}

impl UpperTone {
    /// No tone.
    pub const NONE: Self = Self::new(0.0, 0.0);

    /// A tone of this ratio and phase angle.
    pub const fn new(ratio: f32, phase: f32) -> Self {
        Self { ratio, phase }
    }

    /// `e (cos th + i sin th)`.
    pub(crate) fn phasor(&self) -> Complex {
        let (sine, cosine) = sine_cosine_single(phase_of(self.phase));
        Complex::new(cosine, sine) * self.ratio
    }

    fn from_phasor(phasor: Complex) -> Self {
        if phasor == Complex::default() {
            return Self::NONE;
        }
        let ratio = square_root_single(phasor.norm_sqr());
        Self::new(ratio, libm::atan2f(phasor.im, phasor.re))
    }
}

/// The shape of the track's motion, `S = sin tau + e sin(2 tau + th) + e3 sin(3 tau + th3)`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Shape {
    /// The second tone.
    pub second: UpperTone,
    /// The third tone; it requires a second.
    pub third: UpperTone,
}

impl Shape {
    /// A sine.
    pub const SINE: Self = Self::of_two(UpperTone::NONE);

    /// A shape of three tones.
    pub const fn new(second: UpperTone, third: UpperTone) -> Self {
        Self { second, third }
    }

    /// A shape of two tones.
    pub const fn of_two(second: UpperTone) -> Self {
        Self::new(second, UpperTone::NONE)
    }

    /// The shape of amplitudes over the first tone's and phase angles in rad.
    pub fn from_tones([second, third]: gear::Tones) -> Self {
        let tone = |[ratio, phase]: [f32; 2]| UpperTone { ratio, phase };
        Self::new(tone(second), tone(third))
    }

    /// The upper tones, lowest first.
    pub fn tones(&self) -> [UpperTone; UPPER] {
        [self.second, self.third]
    }

    /// Amplitudes over the first tone's and phase angles in rad.
    pub fn numbers(&self) -> gear::Tones {
        self.tones().map(|tone| [tone.ratio, tone.phase])
    }

    /// `e cos th` and `e sin th` of each tone; 0 for an absent one.
    pub(crate) fn cartesian_tones(&self) -> [[f32; 2]; UPPER] {
        self.tones().map(|tone| {
            if tone.ratio == 0.0 {
                return [0.0; 2];
            }
            let phasor = tone.phasor();
            [phasor.re, phasor.im]
        })
    }

    /// Whether the shape has no upper tone.
    pub fn is_sine(&self) -> bool {
        self.tones().iter().all(|tone| tone.ratio == 0.0)
    }

    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        let a_turn = "-6.2832..6.2832 rad, which is one turn to either side";
        for (of_ratio, of_phase, tone) in [
            ("second tone, ratio", "second tone, phase", self.second),
            ("third tone, ratio", "third tone, phase", self.third),
        ] {
            let (ratio, phase) = (f64::from(tone.ratio), f64::from(tone.phase));
            let accepts = (0.0..=0.5).contains(&tone.ratio);
            accept(of_ratio, ratio, accepts, "0..0.5 of the first")?;
            accept(of_phase, phase, (-TAU..=TAU).contains(&tone.phase), a_turn)?;
        }
        let (third, accepted) = (self.third.ratio, "0 without a second tone");
        let accepts = third == 0.0 || self.second.ratio > 0.0;
        accept("third tone, ratio", f64::from(third), accepts, accepted).map(|_| ())
    }

    /// Largest displacement of the track over b, and largest acceleration over b w^2.
    pub fn peaks(&self) -> [f32; 2] {
        gear::peaks(self.numbers())
    }
}

/// Demodulated motion of a cycle, as phasors of the displacement in m: `x = Im(first e^(i phi)) +
/// Im(upper[0] e^(2 i phi)) + Im(upper[1] e^(3 i phi))`, phi the output's phase.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrackMotion {
    pub first: Complex,
    pub upper: [Complex; UPPER],
}

impl TrackMotion {
    /// The upper tones over the first, as `e (cos th + i sin th)`; 0 at rest.
    pub fn phasors(&self) -> [Complex; UPPER] {
        let size = self.first.norm_sqr();
        // Below 0.1 nm the powers underflow to 0.
        if size < 1e-20 {
            return [Complex::default(); UPPER];
        }
        // The phase of the nth tone is measured against the nth power of the first.
        let root = square_root_single(size);
        let (mut power, mut long) = (self.first, size);
        self.upper.map(|tone| {
            power *= self.first;
            long *= root;
            tone * power.conj() / long
        })
    }

    pub fn shape(&self) -> Shape {
        let [second, third] = self.phasors().map(UpperTone::from_phasor);
        Shape { second, third }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_out_of_range_are_refused_by_name() {
        let tone = UpperTone::new;
        let valid = tone(0.1, 2.4);
        for (second, third, parameter) in [
            (tone(0.6, 0.0), UpperTone::NONE, "second tone, ratio"),
            (tone(0.1, 6.3), UpperTone::NONE, "second tone, phase"),
            (tone(0.1, -6.3), UpperTone::NONE, "second tone, phase"),
            (tone(f32::NAN, 0.0), UpperTone::NONE, "second tone, ratio"),
            (valid, tone(-0.1, 0.0), "third tone, ratio"),
            (valid, tone(0.05, 300.0), "third tone, phase"),
            (UpperTone::NONE, tone(0.05, 1.0), "third tone, ratio"),
        ] {
            let refused = Shape { second, third }.check().unwrap_err();
            assert_eq!(refused.parameter, parameter);
        }
        let shape = Shape::new(valid, tone(0.05, 5.3));
        assert!(shape.check().is_ok() && !shape.is_sine() && Shape::SINE.is_sine());
    }
}
