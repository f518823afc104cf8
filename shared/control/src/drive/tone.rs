//! Amplitude and phase control of one upper tone of the track's motion. Method: an integral loop on
//! a phasor, as in adaptive feedforward cancellation of harmonics (Bodson, Sacks and Khosla 1994).

use super::amplitude::DEAD_TIME_CYCLES;
use super::envelope::absolute;
use super::shape::UpperTone;
use crate::settings::Settings;
use core::f32::consts::PI;
use num_complex::Complex32 as Complex;

/// Time constant of the loop over dead time plus envelope: gain margin above 4 at any detuning.
const LOOP_TIME_CONSTANT_RATIO: f32 = 4.0;
/// Deviation of the track's response that is reported, as a factor and in rad.
const REPORTED_DEVIATION: (f32, f32) = (1.5, 0.35);
/// Deviation, as a factor and in rad, at which the tone is switched off: the limit of the margins.
const MAX_DEVIATION: (f32, f32) = (3.0, 1.05);

/// The loop that holds one tone, by an estimate of the track's response over the configured one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToneLoop {
    /// Frequency of the tone over the drive's.
    harmonic: u8,
    /// Largest ratio that the settings allow; 0 means no such tone.
    max_ratio: f32,
    /// Output for a metre of the tone, by the configured response.
    inverse: Complex,
    /// Share of the error that a cycle corrects.
    loop_gain: f32,
    /// Change of the ratio per cycle: in the first start, in a later one, and downwards.
    rates: [f32; 3],
    /// Estimate: the configured response over the true one.
    correction: Complex,
    /// Present tone of the loop as `e (cos th + i sin th)`, and its goal.
    shape: Complex,
    goal: Complex,
    /// Requested motion of the last cycles, newest first, in m.
    requested: [Complex; 3],
    estimated_cycles: u16,
    reported: bool,
    pub disabled: bool,
}

/// Time constant of the loop of a tone, cycles.
fn loop_time_constant(settings: &Settings, harmonic: u8) -> f32 {
    let envelope = settings.quality / (f32::from(harmonic) * PI);
    LOOP_TIME_CONSTANT_RATIO * (DEAD_TIME_CYCLES + envelope)
}

impl ToneLoop {
    /// The loop at `harmonic` times the drive's frequency; `response`: motion at full output, in m.
    pub fn new(settings: &Settings, harmonic: u8, max_ratio: f32, response: Complex) -> Self {
        let mut tone = Self {
            harmonic,
            max_ratio,
            inverse: if max_ratio > 0.0 {
                response.inv()
            } else {
                Complex::default()
            },
            loop_gain: 1.0 / loop_time_constant(settings, harmonic),
            correction: Complex::new(1.0, 0.0),
            ..Self::default()
        };
        tone.set_rates(settings);
        tone
    }

    pub fn set_rates(&mut self, settings: &Settings) {
        let time_constant = loop_time_constant(settings, self.harmonic);
        let cycles = |seconds: f32| (seconds * settings.frequency).max(1.0);
        self.rates = [
            self.max_ratio / (3.0 * time_constant).max(cycles(settings.soft_start)),
            self.max_ratio / cycles(settings.soft_start),
            self.max_ratio / cycles(settings.soft_stop),
        ];
    }

    pub fn allowed(&self) -> bool {
        self.max_ratio > 0.0
    }

    /// Switches the tone off and keeps the estimate.
    pub fn rest(&mut self) {
        self.shape = Complex::default();
        self.requested = [Complex::default(); 3];
    }

    /// Switches the tone off and restarts from the configured response.
    pub fn restart(&mut self) {
        self.rest();
        self.correction = Complex::new(1.0, 0.0);
        self.estimated_cycles = 0;
        self.reported = false;
        self.disabled = false;
    }

    pub fn is_settled(&self) -> bool {
        self.disabled || absolute(self.goal - self.shape) < 1e-3
    }

    pub fn is_silent(&self) -> bool {
        self.shape == Complex::default()
    }

    pub fn limit_ratio(&self, ratio: f32) -> f32 {
        ratio.min(self.max_ratio)
    }

    /// Sets the goal: the requested tone times the share that the hard limits allow.
    pub fn set_goal(&mut self, tone: &UpperTone, share: f32) {
        let requested = self.limit_ratio(tone.ratio);
        self.goal = if self.disabled || requested <= 0.0 {
            Complex::default()
        } else {
            tone.phasor() * (share * requested / tone.ratio)
        };
    }

    /// Estimates the track's response from the motion of the first tone and of this one in the last
    /// cycle, in m. Whether it deviates from the configured one, reported once.
    pub fn estimate_response(&mut self, first: Complex, measured: Complex) -> bool {
        let [_, driven, _] = self.requested;
        // A full tone has the most information; the weight is the square of the amplitude.
        let full = self.goal.norm_sqr() * first.norm_sqr();
        let square = driven.norm_sqr();
        if self.disabled || full <= 0.0 || 16.0 * square < full {
            return false;
        }
        let error = (driven - measured) * driven.conj() / full.max(square);
        self.correction += error * self.loop_gain;
        self.estimated_cycles = self.estimated_cycles.saturating_add(1);
        let exceeds = |(factor, angle): (f32, f32)| {
            let size = absolute(self.correction);
            let turned = libm::atan2f(self.correction.im, self.correction.re);
            size > factor || size * factor < 1.0 || turned.abs() > angle
        };
        self.disabled = exceeds(MAX_DEVIATION);
        let is_new = exceeds(REPORTED_DEVIATION) && !self.reported;
        self.reported |= is_new;
        is_new
    }

    /// Advances one cycle towards the goal. The output is along the sine and i times the cosine of
    /// the tone's phase, over full output. `first_amplitude`: the first tone's amplitude in m.
    pub fn advance(&mut self, first: Complex, first_amplitude: Option<f32>) -> Complex {
        let step = self.goal - self.shape;
        let grows = self.goal.norm_sqr() > self.shape.norm_sqr();
        let is_early = f32::from(self.estimated_cycles) * self.loop_gain < 3.0;
        let rate = match (grows, is_early) {
            (false, _) => self.rates[2],
            (true, true) => self.rates[0],
            (true, false) => self.rates[1],
        };
        let distance_to_goal = absolute(step);
        self.shape = if distance_to_goal > rate {
            self.shape + step * (rate / distance_to_goal)
        } else {
            self.goal
        };
        // The nth power of the first tone's phasor, with its own size.
        let requested = first_amplitude.map_or(Complex::default(), |size| {
            (1..self.harmonic).fold(self.shape * first, |power, _| power * first / size)
        });
        self.requested = [requested, self.requested[0], self.requested[1]];
        self.correction * self.inverse * requested
    }
}

#[cfg(test)]
mod tests {
    use super::super::margins::LoopMargins;
    use super::*;
    use crate::testing::with;
    use num_complex::Complex64;

    /// Margins of the loop, with the mode at the tone's frequency times `1 + detuning`.
    fn margins(harmonic: u8, quality: f32, detuning: f64) -> LoopMargins {
        let settings = with(Settings::default(), |it| it.quality = quality);
        let response = Complex::new(0.0, -5e-4);
        let loop_gain = f64::from(ToneLoop::new(&settings, harmonic, 0.2, response).loop_gain);
        let turn = |angle: f64| Complex64::new(angle.cos(), angle.sin());
        // Decay and turn of the envelope per drive cycle: n pi (1 + off) / Q and 2 n pi off.
        let half = core::f64::consts::PI * f64::from(harmonic);
        let decay = half * (1.0 + detuning) / f64::from(quality);
        let pole = turn(2.0 * half * detuning) * (-decay).exp();
        let open = |turned: Complex64| {
            let delay = turned.conj();
            // Two cycles of dead time, the mean of a cycle's ends, the envelope, the sum.
            loop_gain * delay * delay * (delay + 1.0) * 0.5 * (Complex64::new(1.0, 0.0) - pole)
                / ((Complex64::new(1.0, 0.0) - pole * delay) * (Complex64::new(1.0, 0.0) - delay))
        };
        LoopMargins::from_open_loop(open, pole)
            .min(LoopMargins::from_open_loop(|z| open(z.conj()), pole))
    }

    /// In drive cycles the loop is the same at every frequency, 5 to 500 Hz.
    #[test]
    fn the_loop_has_margins_at_every_quality_and_detuning() {
        for harmonic in [2, 3] {
            let mut minimum = LoopMargins::LARGEST;
            for quality in [3.0, 5.0, 8.0, 15.0, 25.0, 50.0, 100.0, 200.0] {
                for n in -40..=40 {
                    minimum = minimum.min(margins(harmonic, quality, 0.005 * f64::from(n)));
                }
            }
            // A gain wrong by a factor of 2 and a phase wrong by 30 degrees leave as much again.
            assert!(minimum.gain > 4.0 && minimum.phase > 60.0, "{minimum:?}");
            assert!(minimum.distance > 0.7, "{minimum:?}");
        }
    }
}
