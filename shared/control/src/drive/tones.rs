//! The upper tones of the track's motion: one loop for each, within output and hard limits.

use super::envelope::absolute;
use super::scale::Scale;
use super::shape::{Shape, TrackMotion, UPPER, UpperTone};
use super::tone::ToneLoop;
use crate::angle::unit_phasor;
use crate::saturate::consecutive;
use crate::{SAMPLE_RATE, Settings};
use core::f32::consts::PI;
use kband::feeder::{OutOfRange, accept};
use num_complex::Complex32 as Complex;

/// Acceleration over the hard limit from which the upper tones fall to 0.
const MAX_ACCELERATION_RATIO: f32 = 1.04;
/// Smallest share of the requested tones that does not count as limited.
const MIN_TONE_SHARE: f32 = 0.95;
/// Cycles of a smaller share before a limit is reported, as for the output.
const CUT_CYCLES: u32 = 25;

/// The track's displacement in m at full output at twice and three times the drive's frequency,
/// against as many times the output's phase: `x = Im(response e^(i n phi))`.
pub fn upper_response(settings: &Settings) -> [Complex; UPPER] {
    let response = |gain: f32, lag: f32, frequency: f32| {
        if gain > 0.0 {
            unit_phasor(-lag * (PI / 180.0)) * (gain * 1e-3)
        } else {
            resonant(settings, frequency)
        }
    };
    let once = settings.frequency;
    [
        response(settings.second_gain, settings.second_lag, 2.0 * once),
        response(settings.third_gain, settings.third_lag, 3.0 * once),
    ]
}

/// Response of the drive's resonance at a frequency in Hz, in m, to an output with zero-order hold.
fn resonant(settings: &Settings, frequency: f32) -> Complex {
    let x = frequency / settings.resonance;
    let denominator = Complex::new(1.0 - x * x, x / settings.quality);
    let lag = PI * frequency / SAMPLE_RATE as f32;
    unit_phasor(-lag) * (settings.gain * 1e-3 / settings.quality) / denominator
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToneInputs {
    pub motion: TrackMotion,
    pub requested: Shape,
    /// Reference amplitude b of the first tone, in m.
    pub reference: f32,
    /// Square of the angular frequency of the first tone in 1/s^2.
    pub square: f32,
    /// Output that the first tone leaves, as a share of full output.
    pub headroom: f32,
    /// Smallest amplitude of the first tone with a usable phase, in m.
    pub min_amplitude: f32,
}

/// Largest second and third tone (symbols e and e3), 0..0.5, that the configured output allows at a
/// k, beside the first tone. The third is computed beside the configured second one.
///
/// ```
/// use kband_control::{Settings, affordable_tones};
/// let mut settings = Settings { second_tone: 0.15, ..Settings::default() };
/// // Modes at 2 and 3 times the frequency give a half and a quarter of the resonance's response.
/// assert_eq!(affordable_tones(&settings, 0.35), [0.5, 0.5]);
/// // One resonance alone: the force grows like 3 Q e, and like 8 Q e3.
/// settings.second_gain = 0.0;
/// settings.third_gain = 0.0;
/// settings.second_tone = 0.01;
/// let [second, third] = affordable_tones(&settings, 0.35);
/// assert!((0.030..0.032).contains(&second), "{second}");
/// assert!((0.007..0.009).contains(&third), "{third}");
/// ```
pub fn affordable_tones(settings: &Settings, k: f32) -> [f32; UPPER] {
    let scale = Scale::from_settings(settings);
    let amplitude = scale.amplitude(k);
    let mut headroom = settings.output_maximum - amplitude / scale.full_amplitude;
    let responses = upper_response(settings).map(absolute);
    let configured = [settings.second_tone, settings.third_tone];
    let mut affordable = [0.0; UPPER];
    for ((affordable, response), configured) in affordable.iter_mut().zip(responses).zip(configured)
    {
        let max_ratio = headroom * response / amplitude;
        // Without an amplitude (infinite k) a tone has no reference: none is affordable.
        *affordable = if max_ratio.is_nan() {
            0.0
        } else {
            max_ratio.clamp(0.0, 0.5)
        };
        headroom -= configured * amplitude / response;
    }
    affordable
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tones {
    loops: [ToneLoop; UPPER],
    acceleration_limit: f32,
    amplitude_limit: f32,
    /// Share of the hard limits that the reference uses, 0..1.
    reference_share: f32,
    /// The loops' goal, and its [peaks](Shape::peaks).
    shape: Shape,
    peaks: [f32; 2],
    output: [Complex; UPPER],
    /// Cycles in a row with too small tones, and whether the output was too small in the last one.
    limited_cycles: u32,
    short: bool,
    /// Share of the requested tones within the hard limits, 0..1.
    share: f32,
}

impl Tones {
    /// Builds the loops at rest. The error names a tone that the drive cannot make even at k = 1.
    pub fn build(settings: &Settings) -> Result<Self, OutOfRange> {
        let configured = [settings.second_tone, settings.third_tone];
        let names = ["second_tone", "third_tone"];
        let accepted = [
            "0..what output_maximum leaves for it at k = 1 by second_gain",
            "0..what output_maximum and second_tone leave for it at k = 1 by third_gain",
        ];
        let affordable = affordable_tones(settings, 1.0);
        for tone in 0..UPPER {
            let (value, accepts) = (configured[tone], configured[tone] <= affordable[tone]);
            accept(names[tone], f64::from(value), accepts, accepted[tone])?;
        }
        let [second, third] = upper_response(settings);
        Ok(Self {
            loops: [
                ToneLoop::new(settings, 2, settings.second_tone, second),
                ToneLoop::new(settings, 3, settings.third_tone, third),
            ],
            acceleration_limit: settings.acceleration_limit,
            amplitude_limit: settings.amplitude_limit * 1e-3,
            reference_share: settings.reference_share(),
            peaks: [1.0; 2],
            share: 1.0,
            ..Self::default()
        })
    }

    pub fn allowed(&self) -> bool {
        self.loops[0].allowed()
    }

    pub fn set_rates(&mut self, settings: &Settings) {
        for tone in &mut self.loops {
            tone.set_rates(settings);
        }
    }

    pub fn rest(&mut self) {
        self.loops.iter_mut().for_each(ToneLoop::rest);
        self.output = [Complex::default(); UPPER];
        self.limited_cycles = 0;
        self.short = false;
        self.share = 1.0;
    }

    pub fn restart(&mut self) {
        self.rest();
        self.loops.iter_mut().for_each(ToneLoop::restart);
    }

    /// Outputs along sine and cosine of the multiples of the output's phase, over full output.
    pub fn output(&self) -> [[f32; 2]; UPPER] {
        self.output.map(|output| [output.re, output.im])
    }

    /// Tones that are smaller than requested: those switched off, and the highest one of a cut.
    pub fn missing_tones(&self) -> [bool; UPPER] {
        let cut = self.limited_cycles > CUT_CYCLES;
        let [second, third] = &self.loops;
        let highest = self.shape.third.ratio > 0.0 && third.allowed();
        [
            second.disabled || cut && !highest,
            third.disabled || cut && highest,
        ]
    }

    pub fn is_settled(&self) -> bool {
        self.loops.iter().all(ToneLoop::is_settled)
    }

    /// Advances one cycle. Marks the tones that deviate from the configured response, once each.
    pub fn cycle(&mut self, inputs: &ToneInputs) -> [bool; UPPER] {
        if inputs.requested != self.shape {
            self.shape = inputs.requested;
            self.peaks = self.shape.peaks();
        }
        let TrackMotion { first, upper } = inputs.motion;
        let first_amplitude = absolute(first);
        self.share = self.available_share(inputs, first_amplitude);
        self.limit_peak(inputs, first_amplitude);
        let short = self.short;
        let mut deviations = [false; UPPER];
        let requested = self.shape.tones();
        for (((tone, requested), measured), deviations) in
            (self.loops.iter_mut().zip(requested).zip(upper)).zip(&mut deviations)
        {
            if tone.allowed() {
                tone.set_goal(&requested, self.share);
                *deviations = !short && tone.estimate_response(first, measured);
            }
        }
        // Below the smallest usable amplitude the first tone gives no phase reference.
        let reference = (first_amplitude > inputs.min_amplitude).then_some(first_amplitude);
        let mut all = 0.0;
        for (tone, output) in self.loops.iter_mut().zip(&mut self.output) {
            if tone.allowed() {
                *output = tone.advance(first, reference);
                all += absolute(*output);
            }
        }
        let headroom = inputs.headroom.max(0.0);
        self.short = all > headroom;
        let mut produced_share = self.share;
        if self.short {
            produced_share = self.share * headroom / all;
            for output in &mut self.output {
                *output *= headroom / all;
            }
        }
        let is_limited = produced_share < MIN_TONE_SHARE;
        self.limited_cycles = consecutive(self.limited_cycles, is_limited);
        deviations
    }

    /// Share of the requested tones within the hard limits; 1 without any tone. A chord bounds max
    /// |S| and max |S''|, which are convex in the tones.
    fn available_share(&self, inputs: &ToneInputs, first: f32) -> f32 {
        let requested = |(tone, shape): (&ToneLoop, UpperTone)| tone.limit_ratio(shape.ratio) > 0.0;
        if !self.loops.iter().zip(self.shape.tones()).any(requested) {
            return 1.0;
        }
        // Heavy parts may move the track into the reserve, the reference may not.
        let amplitude = first.max(inputs.reference / self.reference_share);
        let mut share = 1.0_f32;
        let limits = [
            self.amplitude_limit,
            self.acceleration_limit / inputs.square,
        ];
        for (peak, limit) in self.peaks.into_iter().zip(limits) {
            let (headroom, needed) = (limit / amplitude - 1.0, peak - 1.0);
            if needed > 0.0 && needed > headroom {
                share = share.min((headroom / needed).max(0.0));
            }
        }
        share
    }

    /// Lets the upper tones fall to 0 if they accelerate the track beyond the hard limit, at their
    /// angles now or at the requested ones. An abrupt end would make a mode ring.
    fn limit_peak(&mut self, inputs: &ToneInputs, first: f32) {
        let acceleration = first * inputs.square;
        let mut excess = 0.0_f32;
        let measured = inputs.motion.phasors().map(absolute);
        for ((tone, requested), measured) in
            (self.loops.iter().zip(self.shape.tones())).zip(measured)
        {
            if requested.ratio > 0.0 && !tone.is_silent() {
                excess = excess.max(measured / requested.ratio);
            }
        }
        if excess <= 0.0 || acceleration > self.acceleration_limit {
            return;
        }
        let max_peak = MAX_ACCELERATION_RATIO * self.acceleration_limit / acceleration;
        let [second, third] = measured;
        // The exact peak takes a search.
        let may_exceed = 1.0 + 4.0 * second + 9.0 * third > max_peak;
        if 1.0 + (self.peaks[1] - 1.0) * excess > max_peak
            || may_exceed && inputs.motion.shape().peaks()[1] > max_peak
        {
            (self.loops.iter_mut()).for_each(|tone| tone.disabled = tone.allowed());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;

    /// At its resonance the drive moves by its gain, a quarter turn and half a hold later.
    #[test]
    fn the_resonance_answers_with_the_gain_of_the_settings() {
        let settings = Settings::default();
        let response = resonant(&settings, settings.resonance);
        let lag = core::f32::consts::FRAC_PI_2 + PI * settings.resonance / SAMPLE_RATE as f32;
        let expected = Complex::new(libm::cosf(lag), -libm::sinf(lag)) * (settings.gain * 1e-3);
        assert!((response - expected).norm_sqr() < 1e-15);
    }

    /// A cycle at 50 Hz with a first and a second tone of the track in m; the output's tones.
    fn cycle(tones: &mut Tones, [first, second]: [Complex; 2], headroom: f32) -> [[f32; 2]; UPPER] {
        tones.cycle(&ToneInputs {
            motion: TrackMotion {
                first,
                upper: [second, Complex::default()],
            },
            requested: Shape::of_two(UpperTone::new(0.12, 2.6)),
            reference: 2e-4,
            square: 98_696.0,
            headroom,
            min_amplitude: 1e-6,
        });
        tones.output()
    }

    #[test]
    fn no_room_at_all_is_no_tone_and_no_nan() {
        let settings = with(Settings::default(), |it| it.second_tone = 0.15);
        let mut tones = Tones::build(&settings).unwrap();
        for headroom in [0.0, -6e-8, -0.1, f32::NEG_INFINITY] {
            for first in [Complex::default(), Complex::new(0.0, -2e-4)] {
                let output = cycle(&mut tones, [first, Complex::default()], headroom);
                assert_eq!(output, [[0.0; 2]; UPPER], "{headroom}");
            }
        }
    }

    #[test]
    fn tones_beyond_the_acceleration_limit_stay_off() {
        let settings = with(Settings::default(), |it| it.second_tone = 0.15);
        let mut tones = Tones::build(&settings).unwrap();
        let mut cycle = |second: f32| {
            let motion = [2e-4, second].map(|tone| Complex::new(tone, 0.0));
            let [sine, cosine] = cycle(&mut tones, motion, 0.9)[0];
            (sine.hypot(cosine), tones.missing_tones()[0])
        };
        let (risen, missing) = (0..8).map(|_| cycle(2.4e-5)).last().unwrap();
        assert!(risen > 0.0 && !missing);
        // A second tone of 0.4 mm at 100 Hz: 158 m/s^2, where the limit is 120.
        let (falling, missing) = cycle(4e-4);
        assert!(falling < risen && missing, "{falling} of {risen}");
        let last = (0..8).map(|_| cycle(2.4e-5)).last().unwrap();
        assert_eq!(last, (0.0, true));
    }

    fn refused(settings: &Settings) -> Option<&'static str> {
        (Tones::build(settings).err()).map(|refused| refused.parameter)
    }

    #[test]
    fn tones_that_the_drive_cannot_make_are_refused() {
        let mut settings = with(Settings::default(), |it| it.second_tone = 0.15);
        assert_eq!(refused(&settings), None);
        // One resonance alone: 0.11 at k = 1, and 8/3 less of a third tone.
        settings.second_gain = 0.0;
        assert_eq!(refused(&settings), Some("second_tone"));
        settings.second_tone = 0.11;
        assert_eq!(refused(&settings), None);
        settings = with(Settings::default(), |it| {
            (it.second_tone, it.third_tone) = (0.25, 0.06)
        });
        assert_eq!(refused(&settings), None);
        settings.third_gain = 0.0;
        assert_eq!(refused(&settings), Some("third_tone"));
        settings.third_tone = 0.03;
        assert_eq!(refused(&settings), None);
        settings.second_tone = 0.0;
        assert_eq!(settings.check().unwrap_err().parameter, "third_tone");
    }
}
