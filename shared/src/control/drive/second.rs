//! The second tone of the track's motion: an output at twice the drive's frequency, held in amplitude and phase.

use core::f32::consts::TAU;

use num_complex::Complex32 as Complex;

use super::answer::Answer;
use super::scale::Scale;
use crate::arithmetic::{sine_cosine_single, square_root_single};
use crate::control::angle::phase_of;
use crate::control::settings::Settings;
use crate::feeder::{OutOfRange, accept};
use crate::regime::gear;

/// Cycles from a command to the middle of the first cycle that shows it: one in which it is computed, one that is
/// driven, half of averaging.
const DEAD_TIME: f32 = 2.5;
/// Time constant of the loop over its dead time and the second tone's envelope: an integral loop four times slower
/// than both has a gain margin above four at any detuning, for the loop's gain where the envelope turns is at most
/// the envelope's time constant over that of the loop.
const SLOWNESS: f32 = 4.0;
/// How far the track's answer may be from the one told, as a factor and in rad, before the user is told: springs age
/// and drives warm up by a third.
const NOTED: (f32, f32) = (1.5, 0.35);
/// How far, before the second tone is given up: what the loop's margins bear.
const BORNE: (f32, f32) = (3.0, 1.05);
/// Acceleration over the hard limit at which the second tone is given up at once, as the first tone's fault.
const EXCESS: f32 = 1.15;
/// Least share of the wanted second tone: where less is made, it counts as held back. The noise of an amplitude at its hard
/// limit takes off less than the rest.
const LEAST: f32 = 0.95;
/// Cycles of that before it counts as a limit, as of the output's own.
const SHORT: u16 = 25;

/// A second tone of the track's motion `S = sin tau + e sin(2 tau + th)`, tau the track's phase.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SecondTone {
    /// Amplitude over that of the first tone (symbol e), 0..0.5; 0: one tone.
    pub ratio: f32,
    /// Phase angle (symbol th) in rad, -2 pi..2 pi.
    pub phase: f32,
}

impl SecondTone {
    /// No second tone.
    pub const NONE: Self = Self {
        ratio: 0.0,
        phase: 0.0,
    };

    /// Refused where a number is out of range.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        let within = |parameter, value: f32, accepts, accepted| {
            accept(parameter, f64::from(value), accepts, accepted).map(|_| ())
        };
        let (ratio, phase) = (self.ratio, self.phase);
        within(
            "second tone, ratio",
            ratio,
            (0.0..=0.5).contains(&ratio),
            "0..0.5 of the first",
        )?;
        within(
            "second tone, phase",
            phase,
            (-TAU..=TAU).contains(&phase),
            "-6.2832..6.2832 rad, which is one turn to either side",
        )
    }

    /// `e (cos th + i sin th)`.
    fn phasor(&self) -> Complex {
        let (sine, cosine) = sine_cosine_single(phase_of(self.phase));
        Complex::new(cosine, sine) * self.ratio
    }

    /// Largest displacement of the track over b, and largest acceleration over b w^2.
    #[must_use]
    pub fn peaks(&self) -> [f32; 2] {
        gear::peaks([self.ratio, self.phase])
    }
}

/// What the two demodulators found in a cycle, as phasors of the displacement in m: `x = Im(first e^(i phi)) +
/// Im(second e^(2 i phi))` with the output's phase phi.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// The first tone.
    pub first: Complex,
    /// The second tone.
    pub second: Complex,
}

impl Motion {
    /// The second tone over the first, as `e (cos th + i sin th)`; 0 at rest.
    fn shape(&self) -> Complex {
        let square = self.first * self.first;
        let size = self.first.norm_sqr();
        if size <= 0.0 {
            return Complex::default();
        }
        self.second * square.conj() / (size * square_root_single(size))
    }

    /// The second tone as it was measured.
    pub fn tone(&self) -> SecondTone {
        let shape = self.shape();
        SecondTone {
            ratio: size_of(shape),
            phase: libm::atan2f(shape.im, shape.re),
        }
    }
}

/// What a cycle asks of the second tone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Asked {
    /// What the demodulators found.
    pub motion: Motion,
    /// The second tone wanted.
    pub wanted: SecondTone,
    /// Amplitude b in m that the first tone goes to.
    pub reference: f32,
    /// Square of the angular frequency of the first tone in 1/s^2.
    pub square: f32,
    /// Output that the first tone leaves, as a share of full output.
    pub room: f32,
    /// Amplitude of the first tone in m that tells its phase.
    pub least: f32,
}

/// Largest second tone (symbol e) that the output leaves room for at a k, where the settings' drive makes the first
/// tone too; 0..0.5.
///
/// ```
/// use kband::control::{Settings, affordable_second_tone};
/// let mut settings = Settings::default();
/// // A mode at twice the frequency makes half of what the resonance does.
/// assert_eq!(affordable_second_tone(&settings, 0.35), 0.5);
/// // One resonance alone: the force grows like 3 Q e.
/// settings.second_gain = 0.0;
/// let e = affordable_second_tone(&settings, 0.35);
/// assert!((0.030..0.032).contains(&e), "{e}");
/// ```
#[must_use]
pub fn affordable_second_tone(settings: &Settings, k: f32) -> f32 {
    let scale = Scale::at(settings, settings.frequency);
    let amplitude = scale.amplitude(k);
    let room = settings.output_maximum - amplitude / scale.strength;
    let most = room * size_of(Answer::at(settings).second) / amplitude;
    // No amplitude at all (k infinite) leaves nothing to measure a second tone against: none.
    if most.is_nan() {
        0.0
    } else {
        most.clamp(0.0, 0.5)
    }
}

/// The loop that holds the second tone.
///
/// What is learnt is one complex number, the track's answer over the one told: the output is the wanted motion
/// through the answer as learnt, so that a change of amplitude brings its second tone along, and the loop only
/// corrects the answer. That is an integral loop, whose plant is the envelope of the second tone alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondLoop {
    /// Largest ratio that the drive affords; 0: there is no second tone.
    most: f32,
    /// Output for a metre of the second tone, as told.
    inverse: Complex,
    /// Share of the error that a cycle takes over.
    learning: f32,
    /// Change of the ratio a cycle: of the first start, of a later one, and downwards.
    pace: [f32; 3],
    acceleration_limit: f32,
    amplitude_limit: f32,
    /// What was learnt: the answer as told over the one that is.
    correction: Complex,
    /// The second tone that the loop makes now, as `e (cos th + i sin th)`.
    shape: Complex,
    /// The one that it goes to, the tone it was made of, and its [peaks](SecondTone::peaks).
    goal: Complex,
    tone: SecondTone,
    peaks: [f32; 2],
    /// Wanted motion of the last cycles, newest first.
    wanted: [Complex; 3],
    output: Complex,
    /// Cycles in which the answer was learnt.
    learnt: u16,
    /// Cycles in which less was made than is wanted, and whether the output was short in the last one.
    cut_for: u16,
    short: bool,
    /// Share of the wanted second tone that the hard limits leave.
    share: f32,
    noted: bool,
    given_up: bool,
}

impl SecondLoop {
    /// The loop for these settings, at rest. Refused where the drive cannot make the second tone even on a track that
    /// only just throws parts (k = 1).
    pub fn build(settings: &Settings) -> Result<Self, OutOfRange> {
        let affords = affordable_second_tone(settings, 1.0);
        accept(
            "second_tone",
            f64::from(settings.second_tone),
            settings.second_tone <= affords,
            "0..what output_maximum leaves for it at k = 1 by second_gain",
        )?;
        let answer = Answer::at(settings).second;
        // The envelope of the second tone is taken for no slower than a mode as sharp as the drive's own.
        let envelope = settings.quality / TAU;
        let slow = SLOWNESS * (DEAD_TIME + envelope);
        let most = settings.second_tone;
        let cycles = |seconds: f32| (seconds * settings.frequency).max(1.0);
        Ok(Self {
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
            acceleration_limit: settings.acceleration_limit,
            amplitude_limit: settings.amplitude_limit * 1e-3,
            correction: Complex::new(1.0, 0.0),
            shape: Complex::default(),
            goal: Complex::default(),
            tone: SecondTone::NONE,
            peaks: [1.0; 2],
            wanted: [Complex::default(); 3],
            output: Complex::default(),
            learnt: 0,
            cut_for: 0,
            short: false,
            share: 1.0,
            noted: false,
            given_up: false,
        })
    }

    /// Whether the drive affords a second tone at all.
    #[inline]
    pub fn allowed(&self) -> bool {
        self.most > 0.0
    }

    /// Silence, with what was learnt of the track's answer kept.
    pub fn rest(&mut self) {
        self.shape = Complex::default();
        self.wanted = [Complex::default(); 3];
        self.output = Complex::default();
        self.cut_for = 0;
        self.short = false;
        self.share = 1.0;
    }

    /// Silence, and a new try with the answer as told.
    pub fn restart(&mut self) {
        self.rest();
        self.correction = Complex::new(1.0, 0.0);
        self.learnt = 0;
        self.noted = false;
        self.given_up = false;
    }

    /// The output's second tone along the sine and the cosine of its doubled phase, as shares of full output.
    pub fn output(&self) -> [f32; 2] {
        [self.output.re, self.output.im]
    }

    /// Whether less is made of the second tone than is wanted: for want of output, under a hard limit, or given up.
    pub fn held_back(&self) -> bool {
        self.given_up || self.cut_for > SHORT
    }

    /// Whether it has reached its goal.
    pub fn arrived(&self) -> bool {
        self.given_up || size_of(self.goal - self.shape) < 1e-3
    }

    /// A cycle on; whether the track's answer was found to be none as told, which is said once.
    pub fn cycle(&mut self, asked: &Asked) -> bool {
        if asked.wanted != self.tone {
            self.tone = asked.wanted;
            self.peaks = self.tone.peaks();
        }
        let first = size_of(asked.motion.first);
        self.limit(asked, first);
        let Asked { motion, .. } = *asked;
        let news = self.learn(&motion);
        self.watch(asked, first);
        let step = self.goal - self.shape;
        let pace = match (self.goal.norm_sqr() > self.shape.norm_sqr(), self.learnt) {
            (false, _) => self.pace[2],
            (true, learnt) if f32::from(learnt) * self.learning < 3.0 => self.pace[0],
            (true, _) => self.pace[1],
        };
        let long = size_of(step);
        self.shape = if long > pace {
            self.shape + step * (pace / long)
        } else {
            self.goal
        };
        // An amplitude too small to tell the first tone's phase gives none to hold the second tone to.
        let wanted = if first > asked.least {
            self.shape * motion.first * motion.first / first
        } else {
            Complex::default()
        };
        self.wanted = [wanted, self.wanted[0], self.wanted[1]];
        let raw = self.correction * self.inverse * wanted;
        let size = size_of(raw);
        self.short = size > asked.room;
        let made = if self.short {
            self.share * asked.room.max(0.0) / size
        } else {
            self.share
        };
        self.cut_for = if made < LEAST {
            self.cut_for.saturating_add(1)
        } else {
            0
        };
        self.output = if self.short {
            raw * (asked.room.max(0.0) / size)
        } else {
            raw
        };
        news
    }

    /// Where the second tone goes: what is wanted, less where the hard limits leave less. max |S| and max |S''| are
    /// convex in e and 1 without a second tone: a chord bounds them.
    fn limit(&mut self, asked: &Asked, first: f32) {
        let wanted = asked.wanted.ratio.min(self.most);
        let amplitude = first.max(asked.reference);
        let mut share = 1.0_f32;
        let limits = [self.amplitude_limit, self.acceleration_limit / asked.square];
        for (peak, limit) in self.peaks.into_iter().zip(limits) {
            let (room, needed) = (limit / amplitude - 1.0, peak - 1.0);
            if needed > 0.0 && needed > room {
                share = share.min((room / needed).max(0.0));
            }
        }
        self.share = if wanted > 0.0 { share } else { 1.0 };
        self.goal = if self.given_up || wanted <= 0.0 {
            Complex::default()
        } else {
            self.tone.phasor() * (share * wanted / asked.wanted.ratio)
        };
    }

    /// Learns the track's answer from the cycle that ended; whether it was found to be none as told.
    fn learn(&mut self, motion: &Motion) -> bool {
        let [_, driven, _] = self.wanted;
        // A full second tone tells most of the answer; a smaller one counts by its square.
        let full = self.goal.norm_sqr() * motion.first.norm_sqr();
        let size = driven.norm_sqr();
        if self.short || self.given_up || full <= 0.0 || 16.0 * size < full {
            return false;
        }
        let error = (driven - motion.second) * driven.conj() / full.max(size);
        self.correction += error * self.learning;
        self.learnt = self.learnt.saturating_add(1);
        let beyond = |(factor, angle): (f32, f32)| {
            let size = size_of(self.correction);
            let turned = libm::atan2f(self.correction.im, self.correction.re);
            size > factor || size * factor < 1.0 || turned.abs() > angle
        };
        self.given_up = beyond(BORNE);
        let news = beyond(NOTED) && !self.noted;
        self.noted |= news;
        news
    }

    /// Gives the second tone up where the track is accelerated beyond the hard limit with it.
    fn watch(&mut self, asked: &Asked, first: f32) {
        let ratio = size_of(asked.motion.shape());
        if ratio <= 0.0 || self.tone.ratio <= 0.0 || self.shape == Complex::default() {
            return;
        }
        let peak = 1.0 + (self.peaks[1] - 1.0) * ratio / self.tone.ratio;
        let alone = first * asked.square;
        if alone * peak > EXCESS * self.acceleration_limit && alone <= self.acceleration_limit {
            self.given_up = true;
            self.rest();
        }
    }
}

fn size_of(z: Complex) -> f32 {
    square_root_single(z.norm_sqr())
}

#[cfg(test)]
mod tests {
    use num_complex::Complex64;

    use super::*;

    /// Gain margin, phase margin in degrees and least distance to -1 of the loop, on a track whose mode has its frequency
    /// at twice the drive's times `1 + off`.
    fn margins(quality: f32, off: f64) -> [f64; 3] {
        let settings = Settings {
            second_tone: 0.2,
            quality,
            ..Settings::default()
        };
        let learning = f64::from(SecondLoop::build(&settings).unwrap().learning);
        let turn = |angle: f64| Complex64::new(angle.cos(), angle.sin());
        // Decay and turn of the envelope in a cycle of the drive, as it turns by pi (1 + off) 2 / Q and 4 pi off.
        let decay = 2.0 * core::f64::consts::PI * (1.0 + off) / f64::from(quality);
        let pole = turn(4.0 * core::f64::consts::PI * off) * (-decay).exp();
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
        let mut least = [f64::INFINITY; 3];
        for quality in [3.0, 5.0, 8.0, 15.0, 25.0, 50.0, 100.0, 200.0] {
            for n in -40..=40 {
                let found = margins(quality, 0.005 * f64::from(n));
                for (least, found) in least.iter_mut().zip(found) {
                    *least = least.min(found);
                }
            }
        }
        std::println!("{least:?}");
        let [gain, phase, distance] = least;
        // A gain told wrong by a factor of 2 and a phase by 30 degrees leave a factor of 2 and 30 degrees.
        assert!(gain > 4.0 && phase > 60.0 && distance > 0.7, "{least:?}");
    }

    #[test]
    fn a_chord_bounds_the_peaks_and_a_tone_is_what_was_measured() {
        for n in 0..48 {
            let told = SecondTone {
                ratio: 0.01 * (n % 25) as f32 + 0.01,
                phase: 0.13 * n as f32 - 3.1,
            };
            let whole = told.peaks();
            let half = SecondTone {
                ratio: 0.5 * told.ratio,
                ..told
            };
            for (half, whole) in half.peaks().into_iter().zip(whole) {
                assert!(half <= 0.5 * (1.0 + whole) + 5e-3, "{told:?}");
            }
            let lead = 0.7 * n as f32;
            let first = Complex::new(libm::cosf(lead), libm::sinf(lead)) * 2.3e-4;
            let angle = told.phase + 2.0 * lead;
            let second = Complex::new(libm::cosf(angle), libm::sinf(angle)) * (2.3e-4 * told.ratio);
            let seen = Motion { first, second }.tone();
            assert!((seen.ratio - told.ratio).abs() < 1e-6);
            assert!((seen.phase - told.phase).abs() < 1e-4, "{seen:?} {told:?}");
        }
    }

    #[test]
    fn a_second_tone_that_the_drive_cannot_make_is_refused() {
        let mut settings = Settings {
            second_tone: 0.15,
            ..Settings::default()
        };
        assert!(SecondLoop::build(&settings).is_ok());
        // One resonance alone: 0.11 at k = 1.
        settings.second_gain = 0.0;
        assert_eq!(
            SecondLoop::build(&settings).unwrap_err().parameter,
            "second_tone"
        );
        settings.second_tone = 0.11;
        assert!(SecondLoop::build(&settings).is_ok());
        for (tone, parameter) in [
            (
                SecondTone {
                    ratio: 0.6,
                    phase: 0.0,
                },
                "second tone, ratio",
            ),
            (
                SecondTone {
                    ratio: 0.1,
                    phase: 135.0,
                },
                "second tone, phase",
            ),
            (
                SecondTone {
                    ratio: f32::NAN,
                    phase: 0.0,
                },
                "second tone, ratio",
            ),
        ] {
            assert_eq!(tone.check().unwrap_err().parameter, parameter);
        }
    }
}
