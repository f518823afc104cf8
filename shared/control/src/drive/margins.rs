//! Gain and phase margin of the amplitude loop on a given drive, from its Nyquist curve (Astrom and
//! Murray, Feedback Systems, 2008).
//!
//! Only the component of a change along the steady envelope matters: `P = (E(z) + E*(z)) / 2`. `E`
//! is the envelope with its pole, `E*` with the conjugate pole, both with dead time and cycle mean.

use super::amplitude::AmplitudeLoop;
use crate::settings::Settings;
use core::f64::consts::PI;
use kband::feeder::OutOfRange;
use num_complex::Complex64 as Complex;

/// Number of angles per cycle on the curve: spaced logarithmically, and around the envelope's pole.
const ANGLES: i32 = 1500;
/// Smallest angle of the curve, in rad per cycle.
const MIN_ANGLE: f64 = 1e-5;

/// Stability margins of a loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopMargins {
    /// Factor on the loop's gain at which it oscillates.
    pub gain: f64,
    /// Additional phase lag, in degrees, at which it oscillates; 180 with a gain below 1.
    pub phase: f64,
    /// Smallest distance of the open loop from -1: one over a disturbance's largest amplification.
    pub distance: f64,
}

/// The envelope's pole, and the mean over a cycle of the share that remains of it.
fn envelope(settings: &Settings) -> [Complex; 2] {
    let [frequency, resonance, quality] =
        [settings.frequency, settings.resonance, settings.quality].map(f64::from);
    let natural = resonance / frequency;
    let decay = -PI * natural / quality;
    let damped = libm::sqrt(1.0 - 0.25 / (quality * quality));
    let turn = if settings.tracking > 0.0 || natural == 1.0 {
        0.0
    } else {
        2.0 * PI * (natural * damped - 1.0)
    };
    let pole = unit_phasor(turn) * libm::exp(decay);
    [pole, (pole - 1.0) / Complex::new(decay, turn)]
}

/// Measured amplitude over output as a phasor, at `e^(i angle)` of the angle per cycle.
fn plant([pole, mean]: [Complex; 2], unit_phasor: Complex) -> Complex {
    let delay = unit_phasor.conj();
    let delayed_response = |pole: Complex, mean: Complex| {
        delay * delay * (mean * delay * (1.0 - pole) / (1.0 - pole * delay) + (1.0 - mean))
    };
    (delayed_response(pole, mean) + delayed_response(pole.conj(), mean.conj())) * 0.5
}

fn unit_phasor(angle: f64) -> Complex {
    Complex::new(libm::cos(angle), libm::sin(angle))
}

fn modulus(z: Complex) -> f64 {
    libm::sqrt(z.norm_sqr())
}

impl LoopMargins {
    /// Margins of an open loop that is 0.
    pub(super) const LARGEST: Self = Self {
        gain: f64::INFINITY,
        phase: 180.0,
        distance: 1.0,
    };

    /// The smaller margin of each kind, of two loops.
    #[cfg(test)]
    pub(super) fn min(self, other: Self) -> Self {
        Self {
            gain: self.gain.min(other.gain),
            phase: self.phase.min(other.phase),
            distance: self.distance.min(other.distance),
        }
    }

    /// Margins of the loop built for the settings `configured`, on the drive `actual`, whose `gain`
    /// and `resonance` may differ. The error names a setting out of range.
    ///
    /// At the resonance it is the PI loop at the configured gain. Off the resonance the only
    /// feedback is the gain estimate, an integral gain; the margins omit its model.
    pub fn from_settings(configured: &Settings, actual: &Settings) -> Result<Self, OutOfRange> {
        let control = AmplitudeLoop::build(configured)?;
        actual.check()?;
        let envelope = envelope(actual);
        let strength = |settings: &Settings| f64::from(settings.gain) * steady_response(settings);
        let gain_ratio = strength(actual) / strength(configured);
        let [proportional, integral, forgetting] = control.gains().map(f64::from);
        let open = |unit_phasor: Complex| {
            let sum = unit_phasor - 1.0;
            let control = if forgetting > 0.0 {
                forgetting / sum
            } else {
                gain_ratio * proportional * (1.0 + integral / sum)
            };
            control * plant(envelope, unit_phasor)
        };
        Ok(Self::from_open_loop(open, envelope[0]))
    }

    /// Margins of an open loop over the angle per cycle, sampled finely near the angle of a pole.
    pub(super) fn from_open_loop(open: impl Fn(Complex) -> Complex, pole: Complex) -> Self {
        let turn = libm::fabs(libm::atan2(pole.im, pole.re));
        // A decay within a few cycles is smooth enough for the even angles.
        let width = (-libm::log(modulus(pole))).min(0.2);
        let mut margins = Self::LARGEST;
        let mut scan = |angles: &mut dyn Iterator<Item = f64>| {
            let mut before: Option<Complex> = None;
            for angle in angles.filter(|angle| (MIN_ANGLE..=PI).contains(angle)) {
                let now = open(unit_phasor(angle));
                if let Some(before) = before {
                    // Crossings of the negative real axis and of the unit circle.
                    if (now.im < 0.0) != (before.im < 0.0) && now.re < 0.0 && before.re < 0.0 {
                        margins.gain = margins.gain.min(1.0 / modulus(now).max(modulus(before)));
                    }
                    if (now.norm_sqr() < 1.0) != (before.norm_sqr() < 1.0) {
                        let lag = libm::fabs(libm::atan2(now.im, now.re)) * (180.0 / PI);
                        margins.phase = margins.phase.min(180.0 - lag);
                    }
                }
                margins.distance = margins.distance.min(modulus(now + 1.0));
                before = Some(now);
            }
        };
        let step = libm::log(PI / MIN_ANGLE) / f64::from(ANGLES);
        scan(&mut (0..=ANGLES).map(|n| MIN_ANGLE * libm::exp(step * f64::from(n))));
        let near = 6.0 * width / f64::from(ANGLES);
        scan(&mut (-ANGLES..=ANGLES).map(|n| turn + near * f64::from(n)));
        margins
    }
}

/// Steady amplitude over the one at resonance.
fn steady_response(settings: &Settings) -> f64 {
    let [frequency, resonance, quality] =
        [settings.frequency, settings.resonance, settings.quality].map(f64::from);
    if settings.tracking > 0.0 {
        return 1.0;
    }
    let x = frequency / resonance;
    let (detuned, width) = (1.0 - x * x, x / quality);
    1.0 / (quality * libm::sqrt(detuned * detuned + width * width))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;

    const QUALITIES: [f32; 8] = [3.0, 5.0, 8.0, 15.0, 25.0, 50.0, 100.0, 200.0];

    fn drive(quality: f32, detuned: f32) -> Settings {
        let frequency = 50.0 * (1.0 + detuned);
        with(Settings::default(), |it| {
            (it.quality, it.frequency) = (quality, frequency)
        })
    }

    /// Detunings of 0 to 20 % to either side, dense near the resonance.
    fn detunings() -> impl Iterator<Item = f32> {
        let fine = (0..40).map(|n| 0.0002 * n as f32);
        let coarse = (0..49).map(|n| 0.008 + 0.004 * n as f32);
        (fine.chain(coarse)).flat_map(|detuning| [detuning, -detuning])
    }

    /// In drive cycles the loop is the same at every frequency, 5 to 500 Hz.
    #[test]
    fn the_loop_has_margins_at_every_quality_detuning_and_gain() {
        for (gain_ratio, gain, phase, distance) in [
            (1.0, 4.5, 65.0, 0.7),
            (0.5, 4.5, 65.0, 0.7),
            (2.0, 2.2, 44.0, 0.45),
        ] {
            let mut least = LoopMargins::LARGEST;
            for quality in QUALITIES {
                for detuning in detunings() {
                    let configured = drive(quality, detuning);
                    let actual = with(configured, |it| it.gain = configured.gain * gain_ratio);
                    least = least.min(LoopMargins::from_settings(&configured, &actual).unwrap());
                }
            }
            assert!(least.gain > gain && least.phase > phase, "{least:?}");
            assert!(least.distance > distance, "{least:?}");
        }
    }

    /// Any frequency on any resonance, and the smallest quality, within the settings' ranges.
    #[test]
    fn far_from_the_resonance_the_margins_stay() {
        let mut least = LoopMargins::LARGEST;
        for quality in [1.0, 1.5, 2.0, 10.0, 200.0] {
            for n in -60..=60 {
                let ratio = 10.0_f32.powf(n as f32 / 30.0);
                let settings = Settings {
                    quality,
                    frequency: (50.0 * ratio.sqrt()).clamp(5.0, 500.0),
                    resonance: (50.0 / ratio.sqrt()).clamp(5.0, 500.0),
                    safe_amplitude: 0.0,
                    ..Settings::default()
                };
                least = least.min(LoopMargins::from_settings(&settings, &settings).unwrap());
            }
        }
        let holds = least.gain > 3.9 && least.phase > 65.0;
        assert!(holds, "{least:?}");
    }
}
