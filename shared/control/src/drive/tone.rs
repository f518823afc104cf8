//! Control of one upper tone of the track's motion in amplitude and phase: an integral loop on a
//! phasor, as in adaptive feedforward cancellation of harmonics (Bodson, Sacks and Khosla 1994).

use core::f32::consts::PI;

use num_complex::Complex32 as Complex;

use super::envelope::absolute;
use super::shape::UpperTone;
use crate::settings::Settings;

/// Dead time in cycles: computing 1, driving 1, averaging 0.5.
const DEAD_TIME: f32 = 2.5;
/// Time constant of the loop over dead time plus envelope: gain margin above 4 at any detuning.
const LOOP_TIME_CONSTANT_RATIO: f32 = 4.0;
/// Deviation of the track's response that is reported, as a factor and in rad.
const REPORTED_DEVIATION: (f32, f32) = (1.5, 0.35);
/// Deviation, as a factor and in rad, at which the tone is given up: the limit of the margins.
const MAX_DEVIATION: (f32, f32) = (3.0, 1.05);

/// The loop that holds one tone. It estimates the track's response over the configured one; the
/// output is the wanted motion through it, so a change of amplitude moves its tone along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToneLoop {
    /// Frequency of the tone over the drive's.
    harmonic: u8,
    /// Largest ratio that the settings allow; 0 means no such tone.
    most: f32,
    /// Output for a metre of the tone, by the configured response.
    inverse: Complex,
    /// Share of the error that a cycle corrects.
    learning: f32,
    /// Change of the ratio per cycle: in the first start, in a later one, and downwards.
    pace: [f32; 3],
    /// Estimate: the configured response over the true one.
    correction: Complex,
    /// Present tone of the loop as `e (cos th + i sin th)`, and its goal.
    shape: Complex,
    goal: Complex,
    /// Wanted motion of the last cycles, newest first, in m.
    wanted: [Complex; 3],
    estimated_cycles: u16,
    reported: bool,
    pub given_up: bool,
}

/// Time constant of the loop of a tone, cycles.
fn slowness(settings: &Settings, harmonic: u8) -> f32 {
    let envelope = settings.quality / (f32::from(harmonic) * PI);
    LOOP_TIME_CONSTANT_RATIO * (DEAD_TIME + envelope)
}

impl ToneLoop {
    /// The loop at `harmonic` times the drive's frequency; `answer`: motion at full output, in m.
    pub fn new(settings: &Settings, harmonic: u8, most: f32, answer: Complex) -> Self {
        let slow = slowness(settings, harmonic);
        let mut tone = Self {
            harmonic,
            most,
            inverse: if most > 0.0 {
                answer.inv()
            } else {
                Complex::default()
            },
            learning: 1.0 / slow,
            pace: [0.0; 3],
            correction: Complex::new(1.0, 0.0),
            shape: Complex::default(),
            goal: Complex::default(),
            wanted: [Complex::default(); 3],
            estimated_cycles: 0,
            reported: false,
            given_up: false,
        };
        tone.set_pace(settings);
        tone
    }

    /// Takes the times of these settings.
    pub fn set_pace(&mut self, settings: &Settings) {
        let slow = slowness(settings, self.harmonic);
        let cycles = |seconds: f32| (seconds * settings.frequency).max(1.0);
        self.pace = [
            self.most / (3.0 * slow).max(cycles(settings.soft_start)),
            self.most / cycles(settings.soft_start),
            self.most / cycles(settings.soft_stop),
        ];
    }

    /// Whether the settings allow the tone.
    #[inline]
    pub fn allowed(&self) -> bool {
        self.most > 0.0
    }

    /// Switches the tone off and keeps the estimate.
    pub fn rest(&mut self) {
        self.shape = Complex::default();
        self.wanted = [Complex::default(); 3];
    }

    /// Switches the tone off and restarts from the configured response.
    pub fn restart(&mut self) {
        self.rest();
        self.correction = Complex::new(1.0, 0.0);
        self.estimated_cycles = 0;
        self.reported = false;
        self.given_up = false;
    }

    pub fn give_up(&mut self) {
        self.given_up = true;
    }

    pub fn arrived(&self) -> bool {
        self.given_up || absolute(self.goal - self.shape) < 1e-3
    }

    pub fn is_silent(&self) -> bool {
        self.shape == Complex::default()
    }

    /// A ratio, limited to the allowed one.
    pub fn within(&self, ratio: f32) -> f32 {
        ratio.min(self.most)
    }

    /// Sets the goal: the wanted tone times the share that the hard limits leave.
    pub fn aim(&mut self, tone: &UpperTone, share: f32) {
        let wanted = self.within(tone.ratio);
        self.goal = if self.given_up || wanted <= 0.0 {
            Complex::default()
        } else {
            tone.phasor() * (share * wanted / tone.ratio)
        };
    }

    /// Estimates the track's response from the motion of the first tone and of this one in the last
    /// cycle, in m. Whether it deviates from the configured one, reported once.
    pub fn estimate_response(&mut self, first: Complex, seen: Complex) -> bool {
        let [_, driven, _] = self.wanted;
        // A full tone has the most information; the weight is the square of the amplitude.
        let full = self.goal.norm_sqr() * first.norm_sqr();
        let square = driven.norm_sqr();
        if self.given_up || full <= 0.0 || 16.0 * square < full {
            return false;
        }
        let error = (driven - seen) * driven.conj() / full.max(square);
        self.correction += error * self.learning;
        self.estimated_cycles = self.estimated_cycles.saturating_add(1);
        let beyond = |(factor, angle): (f32, f32)| {
            let size = absolute(self.correction);
            let turned = libm::atan2f(self.correction.im, self.correction.re);
            size > factor || size * factor < 1.0 || turned.abs() > angle
        };
        self.given_up = beyond(MAX_DEVIATION);
        let news = beyond(REPORTED_DEVIATION) && !self.reported;
        self.reported |= news;
        news
    }

    /// Advances one cycle towards the goal. The output is along the sine and i times the cosine of
    /// the tone's phase, over full output. `long`: the first tone's amplitude in m.
    pub fn advance(&mut self, first: Complex, long: Option<f32>) -> Complex {
        let step = self.goal - self.shape;
        let pace = match (
            self.goal.norm_sqr() > self.shape.norm_sqr(),
            self.estimated_cycles,
        ) {
            (false, _) => self.pace[2],
            (true, learnt) if f32::from(learnt) * self.learning < 3.0 => self.pace[0],
            (true, _) => self.pace[1],
        };
        let way = absolute(step);
        self.shape = if way > pace {
            self.shape + step * (pace / way)
        } else {
            self.goal
        };
        let wanted = match long {
            Some(long) => {
                // The nth power of the first tone's phasor, with its own size.
                let mut wanted = self.shape * first;
                for _ in 1..self.harmonic {
                    wanted = wanted * first / long;
                }
                wanted
            }
            None => Complex::default(),
        };
        self.wanted = [wanted, self.wanted[0], self.wanted[1]];
        self.correction * self.inverse * wanted
    }
}

#[cfg(test)]
mod tests {
    use num_complex::Complex64;

    use super::super::margins::LoopMargins;
    use super::*;
    use crate::testing::with;

    /// Gain margin, phase margin in degrees and least distance to -1 of the loop. The mode's
    /// frequency is that of the tone times `1 + off`.
    fn margins(harmonic: u8, quality: f32, off: f64) -> [f64; 3] {
        let settings = with(Settings::default(), |it| it.quality = quality);
        let answer = Complex::new(0.0, -5e-4);
        let learning = f64::from(ToneLoop::new(&settings, harmonic, 0.2, answer).learning);
        let turn = |angle: f64| Complex64::new(angle.cos(), angle.sin());
        // Decay and turn of the envelope per drive cycle: n pi (1 + off) / Q and 2 n pi off.
        let half = core::f64::consts::PI * f64::from(harmonic);
        let decay = half * (1.0 + off) / f64::from(quality);
        let pole = turn(2.0 * half * off) * (-decay).exp();
        let open = |turned: Complex64| {
            let late = turned.conj();
            // Two cycles of dead time, the mean of a cycle's ends, the envelope, the sum.
            learning * late * late * (late + 1.0) * 0.5 * (Complex64::new(1.0, 0.0) - pole)
                / ((Complex64::new(1.0, 0.0) - pole * late) * (Complex64::new(1.0, 0.0) - late))
        };
        let [ahead, back] = [true, false].map(|ahead| {
            let turned = |z: Complex64| if ahead { z } else { z.conj() };
            LoopMargins::around(|z| open(turned(z)), pole)
        });
        [
            ahead.gain.min(back.gain),
            ahead.phase.min(back.phase),
            ahead.distance.min(back.distance),
        ]
    }

    /// In drive cycles the loop is the same at every frequency, 5 to 500 Hz.
    #[test]
    fn the_loop_has_margins_at_every_quality_and_detuning() {
        for harmonic in [2, 3] {
            let mut least = [f64::INFINITY; 3];
            for quality in [3.0, 5.0, 8.0, 15.0, 25.0, 50.0, 100.0, 200.0] {
                for n in -40..=40 {
                    let found = margins(harmonic, quality, 0.005 * f64::from(n));
                    for (least, found) in least.iter_mut().zip(found) {
                        *least = least.min(found);
                    }
                }
            }
            std::println!("{harmonic}: {least:?}");
            let [gain, phase, distance] = least;
            // A gain wrong by a factor of 2 and a phase wrong by 30 degrees leave a factor of 2 and
            // 30 degrees.
            assert!(gain > 4.0 && phase > 60.0 && distance > 0.7, "{least:?}");
        }
    }
}
