//! One tone of the track's motion above the first: an output at a multiple of the drive's frequency, held in amplitude
//! and phase.

use core::f32::consts::PI;

use num_complex::Complex32 as Complex;

use super::envelope::size;
use super::shape::UpperTone;
use crate::control::settings::Settings;

/// Cycles from a command to the middle of the first cycle that shows it: one in which it is computed, one that is
/// driven, half of averaging.
const DEAD_TIME: f32 = 2.5;
/// Time constant of the loop over its dead time and the tone's envelope: an integral loop four times slower
/// than both has a gain margin above four at any detuning, for the loop's gain where the envelope turns is at most
/// the envelope's time constant over that of the loop.
const SLOWNESS: f32 = 4.0;
/// How far the track's answer may be from the one told, as a factor and in rad, before the user is told: springs age
/// and drives warm up by a third.
const NOTED: (f32, f32) = (1.5, 0.35);
/// How far, before the tone is given up: what the loop's margins bear.
const BORNE: (f32, f32) = (3.0, 1.05);

/// The loop that holds one tone.
///
/// What is learnt is one complex number, the track's answer over the one told: the output is the wanted motion
/// through the answer as learnt, so that a change of amplitude brings its tone along, and the loop only
/// corrects the answer. That is an integral loop, whose plant is the envelope of this tone alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToneLoop {
    /// Which tone: its frequency over the drive's.
    harmonic: u8,
    /// Largest ratio that the drive affords; 0: there is no such tone.
    most: f32,
    /// Output for a metre of the tone, as told.
    inverse: Complex,
    /// Share of the error that a cycle takes over.
    learning: f32,
    /// Change of the ratio a cycle: of the first start, of a later one, and downwards.
    pace: [f32; 3],
    /// What was learnt: the answer as told over the one that is.
    correction: Complex,
    /// The tone that the loop makes now, as `e (cos th + i sin th)`, and the one that it goes to.
    shape: Complex,
    goal: Complex,
    /// Wanted motion of the last cycles, newest first.
    wanted: [Complex; 3],
    /// Cycles in which the answer was learnt.
    learnt: u16,
    noted: bool,
    given_up: bool,
}

impl ToneLoop {
    /// The loop of the tone at a multiple of the drive's frequency, at rest; `answer` is what full output of it moves the track
    /// by, in m, as told.
    pub fn new(settings: &Settings, harmonic: u8, most: f32, answer: Complex) -> Self {
        // The envelope of the tone is taken for no slower than a mode as sharp as the drive's own.
        let envelope = settings.quality / (f32::from(harmonic) * PI);
        let slow = SLOWNESS * (DEAD_TIME + envelope);
        let cycles = |seconds: f32| (seconds * settings.frequency).max(1.0);
        Self {
            harmonic,
            most,
            inverse: if most > 0.0 {
                answer.inv()
            } else {
                Complex::default()
            },
            learning: 1.0 / slow,
            pace: [
                most / (3.0 * slow).max(cycles(settings.soft_start)),
                most / cycles(settings.soft_start),
                most / cycles(settings.soft_stop),
            ],
            correction: Complex::new(1.0, 0.0),
            shape: Complex::default(),
            goal: Complex::default(),
            wanted: [Complex::default(); 3],
            learnt: 0,
            noted: false,
            given_up: false,
        }
    }

    /// Whether the drive affords it at all.
    #[inline]
    pub fn allowed(&self) -> bool {
        self.most > 0.0
    }

    /// Silence, with what was learnt of the track's answer kept.
    pub fn rest(&mut self) {
        self.shape = Complex::default();
        self.wanted = [Complex::default(); 3];
    }

    /// Silence, and a new try with the answer as told.
    pub fn restart(&mut self) {
        self.rest();
        self.correction = Complex::new(1.0, 0.0);
        self.learnt = 0;
        self.noted = false;
        self.given_up = false;
    }

    /// Makes it no more, until it is started anew.
    pub fn give_up(&mut self) {
        self.given_up = true;
    }

    /// Whether it was given up.
    pub fn is_given_up(&self) -> bool {
        self.given_up
    }

    /// Whether it has reached its goal.
    pub fn arrived(&self) -> bool {
        self.given_up || size(self.goal - self.shape) < 1e-3
    }

    /// Whether none of it is made.
    pub fn is_silent(&self) -> bool {
        self.shape == Complex::default()
    }

    /// As much of a ratio as the drive affords.
    pub fn within(&self, ratio: f32) -> f32 {
        ratio.min(self.most)
    }

    /// Sets where it goes: what is wanted, of which the hard limits leave a share.
    pub fn aim(&mut self, tone: &UpperTone, share: f32) {
        let wanted = self.within(tone.ratio);
        self.goal = if self.given_up || wanted <= 0.0 {
            Complex::default()
        } else {
            tone.phasor() * (share * wanted / tone.ratio)
        };
    }

    /// Learns the track's answer from the motion of the first tone and of this one in the cycle that ended; whether it was found
    /// to be none as told, which is said once.
    pub fn learn(&mut self, first: Complex, seen: Complex) -> bool {
        let [_, driven, _] = self.wanted;
        // A full tone tells most of the answer; a smaller one counts by its square.
        let full = self.goal.norm_sqr() * first.norm_sqr();
        let square = driven.norm_sqr();
        if self.given_up || full <= 0.0 || 16.0 * square < full {
            return false;
        }
        let error = (driven - seen) * driven.conj() / full.max(square);
        self.correction += error * self.learning;
        self.learnt = self.learnt.saturating_add(1);
        let beyond = |(factor, angle): (f32, f32)| {
            let size = size(self.correction);
            let turned = libm::atan2f(self.correction.im, self.correction.re);
            size > factor || size * factor < 1.0 || turned.abs() > angle
        };
        self.given_up = beyond(BORNE);
        let news = beyond(NOTED) && !self.noted;
        self.noted |= news;
        news
    }

    /// A cycle on towards the goal; the output that it takes, along the sine and i times the cosine of its multiple of the
    /// phase, as shares of full output.
    ///
    /// `long` is the size of the first tone's motion; `None` where that is too small to tell the phase to hold a tone to.
    pub fn advance(&mut self, first: Complex, long: Option<f32>) -> Complex {
        let step = self.goal - self.shape;
        let pace = match (self.goal.norm_sqr() > self.shape.norm_sqr(), self.learnt) {
            (false, _) => self.pace[2],
            (true, learnt) if f32::from(learnt) * self.learning < 3.0 => self.pace[0],
            (true, _) => self.pace[1],
        };
        let way = size(step);
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

    use super::*;

    /// Gain margin, phase margin in degrees and least distance to -1 of the loop, on a track whose mode has its frequency
    /// at the tone's times `1 + off`.
    fn margins(harmonic: u8, quality: f32, off: f64) -> [f64; 3] {
        let settings = Settings {
            quality,
            ..Settings::default()
        };
        let answer = Complex::new(0.0, -5e-4);
        let learning = f64::from(ToneLoop::new(&settings, harmonic, 0.2, answer).learning);
        let turn = |angle: f64| Complex64::new(angle.cos(), angle.sin());
        // Decay and turn of the envelope in a cycle of the drive, as the nth tone's turns by n pi (1 + off) / Q and 2 n pi off.
        let half = core::f64::consts::PI * f64::from(harmonic);
        let decay = half * (1.0 + off) / f64::from(quality);
        let pole = turn(2.0 * half * off) * (-decay).exp();
        let open = |angle: f64| {
            let late = turn(-angle);
            // Two cycles of dead time, the mean of a cycle's ends, the envelope, the sum.
            learning * late * late * (late + 1.0) * 0.5 * (Complex64::new(1.0, 0.0) - pole)
                / ((Complex64::new(1.0, 0.0) - pole * late) * (Complex64::new(1.0, 0.0) - late))
        };
        let (mut gain, mut phase, mut distance) = (f64::INFINITY, 180.0_f64, f64::INFINITY);
        for way in [1.0, -1.0] {
            let mut before = open(way * 1e-5);
            for n in 1..6000 {
                let angle = 1e-5 * (core::f64::consts::PI / 1e-5).powf(f64::from(n) / 6000.0);
                let now = open(way * angle);
                if (now.im < 0.0) != (before.im < 0.0) && now.re < 0.0 {
                    gain = gain.min(-1.0 / now.re);
                }
                if (now.norm_sqr() < 1.0) != (before.norm_sqr() < 1.0) {
                    phase = phase.min(180.0 - now.im.atan2(now.re).to_degrees().abs());
                }
                distance = distance.min((now + 1.0).norm_sqr().sqrt());
                before = now;
            }
        }
        [gain, phase, distance]
    }

    /// In cycles of the drive the loop is the same at every frequency, 5 to 500 Hz.
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
            // A gain told wrong by a factor of 2 and a phase by 30 degrees leave a factor of 2 and 30 degrees.
            assert!(gain > 4.0 && phase > 60.0 && distance > 0.7, "{least:?}");
        }
    }
}
