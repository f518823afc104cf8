//! The second tone of the track's motion: an output at twice the drive's frequency, held in amplitude and phase.

use core::f32::consts::TAU;

use num_complex::Complex32 as Complex;

use super::answer::Answer;
use crate::arithmetic::sine_cosine_single;
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
/// Cycles without enough output before it counts as a limit.
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
    pub fn check(&self) -> Result<(), OutOfRange> {
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
        self.second * square.conj() / (size * libm::sqrtf(size))
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
    /// Cycles in which the output was short.
    short: u16,
    cut: bool,
    noted: bool,
    given_up: bool,
}

impl SecondLoop {
    /// The loop for these settings, at rest.
    pub fn build(settings: &Settings) -> Self {
        let answer = Answer::at(settings).second;
        // The envelope of the second tone is taken for no slower than a mode as sharp as the drive's own.
        let envelope = settings.quality / TAU;
        let slow = SLOWNESS * (DEAD_TIME + envelope);
        let most = settings.second_tone;
        let cycles = |seconds: f32| (seconds * settings.frequency).max(1.0);
        Self {
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
            short: 0,
            cut: false,
            noted: false,
            given_up: false,
        }
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
        self.short = 0;
        self.cut = false;
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
        self.given_up || self.cut || self.short > SHORT
    }

    /// Whether it has come to where it goes.
    pub fn arrived(&self) -> bool {
        self.given_up || self.cut || size_of(self.goal - self.shape) < 1e-3
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
        // Below what tells the first tone's phase there is none to hold the second one to.
        let wanted = if first > asked.least {
            self.shape * motion.first * motion.first / first
        } else {
            Complex::default()
        };
        self.wanted = [wanted, self.wanted[0], self.wanted[1]];
        let raw = self.correction * self.inverse * wanted;
        let size = size_of(raw);
        let short = size > asked.room;
        self.short = if short {
            self.short.saturating_add(1)
        } else {
            0
        };
        self.output = if short {
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
        self.cut = share < 0.999 && wanted > 0.0;
        self.goal = if self.given_up || wanted <= 0.0 {
            Complex::default()
        } else {
            self.tone.phasor() * (share * wanted / asked.wanted.ratio)
        };
    }

    /// Learns the track's answer from the cycle that ended; whether it was found to be none as told.
    fn learn(&mut self, motion: &Motion) -> bool {
        let [_, driven, _] = self.wanted;
        // What a full second tone moves tells most; less counts by its square.
        let full = self.goal.norm_sqr() * motion.first.norm_sqr();
        let size = driven.norm_sqr();
        if self.short > 0 || self.given_up || full <= 0.0 || 16.0 * size < full {
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
    libm::sqrtf(z.norm_sqr())
}
