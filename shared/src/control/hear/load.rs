//! The mass of the parts on the track, weighed by what they take of the drive's power.
//!
//! A part of mass m in gear gives the track the momentum of its weight over each flight, at the phase t of the track. At the drive's
//! frequency that is a force of `2 m g cos(alpha)` with the phase of the impacts, which adds `2 (m/M) k <cos t>` to the track's loss `1/Q`, and
//! `<cos t> = pi r k (1 - R)/(1 + R)` in gear of order r, whatever the doublings (docs/theory-real-parts.md#t10.5).

use core::f32::consts::{PI, TAU};

use num_complex::Complex32 as Complex;

use super::blanked::{outweighed, repeated};
use crate::arithmetic::{sine_cosine_single, square_root_single};
use crate::control::angle::{SAMPLE_RATE, phase_of};
use crate::control::settings::Settings;

/// Weight of a cycle in the power taken that weighs: what the parts take scatters from cycle to cycle by a third of its mean, and by 4 %
/// over 64 cycles.
const SLOW: f32 = 1.0 / 64.0;
/// Cycles before a mass is told.
const BEFORE: f32 = 64.0;
/// Weight of a cycle in what the empty track takes.
const TARE: f32 = 1.0 / 32.0;
/// Cycles without an impact before it is taken for empty.
const EMPTIED: f32 = 16.0;
/// Weight of a cycle in the share that is blanked, and in how far the impacts agree.
const GATHERED: f32 = 0.1;
/// Share of their time in gear from which on the parts are weighed: what is out of gear takes another power.
const IN_GEAR: f32 = 0.7;

/// What is on the track.
///
/// Over twenty random feeders (Q 10 to 50, 2 to 20 % of the track's mass, sample by sample) the flow errs by 3.4 % at most and
/// the mass by 3.0 % (docs/theory-real-parts.md#t10.5).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    /// Mass of the parts in g (symbol m).
    pub mass: f32,
    /// Their conveying speed in mm/s, positive upwards.
    pub speed: f32,
    /// What leaves the track in g/s: mass times speed over the track's length; 0 where that is not told.
    pub flow: f32,
}

/// What a cycle tells the meter.
#[derive(Clone, Copy, Debug)]
pub struct Weighed {
    /// Motion between the impacts, as the demodulator has it, in m: along sine and cosine of the output's phase.
    pub motion: Complex,
    /// Output of that cycle along sine and cosine of its phase, as a share of full output.
    pub output: Complex,
    /// Share of the cycle that the demodulator blanked.
    pub blanked: f32,
    /// Square of the drive's angular frequency in 1/s^2 (symbol w^2).
    pub square: f32,
    /// Frequency in Hz.
    pub frequency: f32,
    /// Gravity normal to the track in m/s^2.
    pub normal_gravity: f32,
    /// Share of the parts' time in gear, 0..=1.
    pub in_gear: f32,
    /// Concentration of the track's phases at the impacts, 0..1.
    pub concentration: f32,
    /// Order of that gear (symbol r).
    pub order: u8,
    /// Restitution of the parts as heard; `None`: the lot's as told.
    pub restitution: Option<f32>,
    /// Mean cosine of the phases of the impacts, where one part alone strikes.
    pub cosine: Option<f32>,
    /// Whether the track moves as a sine: a second tone takes power of its own.
    pub sine: bool,
    /// Whether an impact was heard in the cycle.
    pub heard: bool,
    /// Whether the amplitude stands at its setpoint.
    pub stands: bool,
}

/// The scale: what of the drive's power the empty track does not take.
#[derive(Clone, Copy, Debug)]
pub struct LoadMeter {
    /// Mass of the track in g, its length in mm.
    track: f32,
    length: f32,
    /// Natural angular frequency in rad/s, displacement for full output at rest in m, 1/Q.
    natural: f32,
    force: f32,
    loss: f32,
    /// Restitution of the lot's middle.
    restitution: f32,
    /// Along the track over normal to it, as cosine and sine of the lead; what a flight's fall takes back of it.
    along: [f32; 2],
    back: f32,
    /// The force as the empty track shows it over the one told, and by how much the square of its resonance over the drive's is another.
    tare: f32,
    detuned: f32,
    /// Cycles without an impact.
    silent: f32,
    amplitude: f32,
    /// Share of a cycle that the demodulator blanks in the mean.
    blanked: f32,
    /// `e^(-i phase)` of the output at the impacts of parts in gear, and how far they agree.
    at: Complex,
    concentration: f32,
    /// By how much less the spring has of the motion than the acceleration, in the mean.
    less: f32,
    /// The last motion, as the demodulator had it.
    before: Complex,
    /// Mass over the track's, and cycles of it.
    slow: f32,
    cycles: f32,
    load: Option<Load>,
}

impl LoadMeter {
    /// The scale of a drive; `None` where the mass of its track is not told.
    pub fn build(settings: &Settings) -> Option<Self> {
        if settings.track_mass <= 0.0 {
            return None;
        }
        let (sine, cosine) = sine_cosine_single(phase_of(settings.phase_lead * (PI / 180.0)));
        let kept = settings.tangential_restitution;
        let incline = settings.incline * (PI / 180.0);
        Some(Self {
            track: settings.track_mass * 1e3,
            length: settings.track_length,
            natural: TAU * settings.resonance,
            force: settings.gain * 1e-3 / settings.quality,
            loss: 1.0 / settings.quality,
            restitution: 0.5 * (settings.restitution_low + settings.restitution_high),
            along: [cosine, sine].map(|part| part * settings.amplitude_ratio),
            back: libm::tanf(incline) * (1.0 + kept) / (1.0 - kept),
            tare: 1.0,
            detuned: 0.0,
            silent: f32::INFINITY,
            amplitude: 0.0,
            blanked: 0.0,
            at: Complex::new(0.0, 0.0),
            concentration: 0.0,
            less: 0.0,
            before: Complex::new(0.0, 0.0),
            slow: 0.0,
            cycles: 0.0,
            load: None,
        })
    }

    /// Forgets the parts: the setpoint or the target is another one.
    pub fn forget(&mut self) {
        (self.slow, self.cycles, self.load) = (0.0, 0.0, None);
    }

    /// Where parts in gear strike: the mean of `e^(-i phase)` of the output.
    #[must_use]
    pub fn struck(&self) -> Complex {
        self.at * self.concentration
    }

    /// Whether no part is heard.
    #[must_use]
    pub fn silent(&self) -> bool {
        self.silent > EMPTIED
    }

    /// What is on the track; `None` where the parts are not in gear, or not for long.
    #[must_use]
    pub fn load(&self) -> Option<Load> {
        self.load
    }

    /// Takes a cycle; the track's motion with what the impacts push of it, in m.
    ///
    /// Between the impacts the acceleration lacks what these give, as the demodulator blanks them. The motion is that by which the spring,
    /// the loss and the drive bring about the acceleration that is left, whatever the parts do.
    pub fn cycle(&mut self, seen: &Weighed) -> Complex {
        let Weighed {
            motion,
            output,
            square,
            frequency,
            normal_gravity,
            in_gear,
            order,
            ..
        } = *seen;
        let turns = f32::from(order.max(1));
        let restitution = seen.restitution.unwrap_or(self.restitution);
        let slip = (1.0 - restitution) / (1.0 + restitution);
        // What would be b at k = 1.
        let unit = normal_gravity / square;
        let bare = square_root_single(motion.norm_sqr());
        let before = core::mem::replace(&mut self.before, motion);
        self.silent = if seen.heard { 0.0 } else { self.silent + 1.0 };
        if bare < 1e-3 * unit {
            self.amplitude = bare;
            return motion;
        }
        // The output is held between samples, half of one late.
        let (sine, cosine) = sine_cosine_single(phase_of(PI * frequency / SAMPLE_RATE as f32));
        let natural = self.natural * self.natural / square;
        let told = output * Complex::new(cosine, -sine) * (natural * self.force);
        let forced = told * self.tare;
        let loss = square_root_single(natural) * self.loss;
        let empty = Complex::new(natural - 1.0 + self.detuned, loss);
        if self.silent() {
            (self.amplitude, self.load) = (bare, None);
            (self.blanked, self.concentration, self.less) = (0.0, 0.0, 0.0);
            // What lies on a track that throws it is heard.
            if seen.stands && bare > unit {
                let shown = told / motion;
                self.tare += (loss / shown.im.max(0.1 * loss) - self.tare) * TARE;
                self.detuned += ((shown * self.tare).re - empty.re) * TARE;
            }
            return motion;
        }
        // Where the parts strike, by the motion before.
        self.blanked += (seen.blanked - self.blanked) * GATHERED;
        if seen.concentration > 0.0 {
            self.concentration += (seen.concentration - self.concentration) * GATHERED;
        }
        let cosine_at = |k: f32| (seen.cosine).unwrap_or_else(|| (PI * turns * k * slip).min(1.0));
        let cosine = cosine_at(unit / bare);
        let sine = square_root_single((1.0 - cosine * cosine).max(0.0));
        self.at = motion * (1.0 / bare) * Complex::new(cosine, -sine);
        let between = motion - repeated(self.at, seen.blanked) * (before - motion).conj();
        // Nothing is left between the impacts: there is nothing to divide by.
        if between.norm_sqr() < 1e-6 * bare * bare {
            self.amplitude = bare;
            return motion;
        }
        let weight = outweighed(self.blanked);
        let mut more = (between + forced * weight) / ((empty * weight + 1.0) * between);
        // What lies on the track is mass of it: its push is in the acceleration.
        self.less += (1.0 - more.re - self.less) * GATHERED;
        more.re += self.less.max(0.0);
        let found = between * more;
        let amplitude = square_root_single(found.norm_sqr());
        let k = unit / amplitude;
        let cosine = cosine_at(k);
        // What the swing itself takes up as it grows.
        let grown = (amplitude - self.amplitude) / (PI * amplitude);
        self.amplitude = amplitude;
        let taken = (forced / found - empty).im - grown;
        let share = taken / (2.0 * k * cosine.max(0.1));
        if !seen.stands || !seen.sine || in_gear < IN_GEAR {
            self.forget();
            return found;
        }
        self.cycles += 1.0;
        self.slow += (share - self.slow) * SLOW.max(1.0 / self.cycles);
        if self.cycles >= BEFORE {
            self.load = Some(self.told(seen, k, cosine, slip, restitution));
        }
        found
    }

    fn told(&self, seen: &Weighed, k: f32, cosine: f32, slip: f32, restitution: f32) -> Load {
        let turns = f32::from(seen.order.max(1));
        let mass = self.track * self.slow;
        // b w cos t, the mean velocity of the track at an impact, is pi r (g/w) (1 - R)/(1 + R).
        let fall = seen.normal_gravity * turns / (2.0 * seen.frequency);
        let sine = square_root_single((1.0 - cosine * cosine).max(0.0));
        let velocity = TAU * seen.frequency * seen.normal_gravity / (k * seen.square);
        // One heavy part leaves with the track after its jump.
        let jump = if seen.cosine.is_some() {
            2.0 * self.slow * restitution / (1.0 + restitution)
        } else {
            0.0
        };
        let [straight, across] = self.along;
        let speed = straight * fall * (slip - jump) - across * velocity * sine - self.back * fall;
        let speed = speed * 1e3;
        Load {
            mass,
            speed,
            flow: if self.length > 0.0 {
                mass * speed / self.length
            } else {
                0.0
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> Settings {
        Settings {
            track_mass: 10.0,
            track_length: 500.0,
            tangential_restitution: 0.0,
            ..Settings::default()
        }
    }

    /// A cycle of a track at k with a lock of so much of its mass, as drive and demodulator have it (closed form).
    fn seen(settings: &Settings, k: f32, share: f32) -> (Weighed, Complex) {
        let square = (TAU * 50.0) * (TAU * 50.0);
        let normal_gravity = settings.gravity * libm::cosf(settings.incline * (PI / 180.0));
        let amplitude = normal_gravity / (k * square);
        let slip = 0.8 / 1.2;
        let cosine = PI * k * slip;
        let sine = libm::sqrtf(1.0 - cosine * cosine);
        // (w0^2 - w^2 + i w w0/Q) x = w0^2 F u - 2 (m/M) g i e^(-i t0) x/b, at the resonance.
        let pushed = Complex::new(sine, cosine) * (-2.0 * share * k);
        let wanted = Complex::new(0.0, 1.0 / settings.quality) - pushed;
        let force = settings.gain * 1e-3 / settings.quality;
        let output = libm::sqrtf(wanted.norm_sqr()) * amplitude / force;
        let held = Complex::new(libm::cosf(PI / 400.0), -libm::sinf(PI / 400.0));
        let motion = held * (output * force) * wanted.inv();
        // What lies between the impacts lacks what they push: -a/w^2 = x + C/w^2.
        let between = motion * (Complex::new(1.0, 0.0) + pushed);
        let seen = Weighed {
            motion: between,
            output: Complex::new(output, 0.0),
            blanked: 0.0,
            square,
            frequency: 50.0,
            normal_gravity,
            in_gear: 1.0,
            concentration: 1.0,
            order: 1,
            restitution: None,
            cosine: None,
            sine: true,
            heard: true,
            stands: true,
        };
        (seen, motion)
    }

    #[test]
    fn a_lock_s_closed_form_is_weighed_to_half_a_percent() {
        for quality in [10.0, 25.0, 50.0] {
            for share in [0.02, 0.05, 0.1, 0.2] {
                let settings = Settings {
                    quality,
                    gain: 5.0,
                    ..settings()
                };
                let mut meter = LoadMeter::build(&settings).unwrap();
                let (seen, motion) = seen(&settings, 0.4, share);
                let mut found = seen.motion;
                for cycle in 0..400 {
                    found = meter.cycle(&seen);
                    assert_eq!(meter.load().is_some(), cycle >= 63);
                }
                let load = meter.load().unwrap();
                let expected = share * 1e4;
                assert!(
                    (load.mass / expected - 1.0).abs() < 5e-3,
                    "{quality} {share} {load:?}"
                );
                assert!((found - motion).norm_sqr() < 1e-6 * motion.norm_sqr());
                // pi (g/w) { eta (1-R)/(1+R) - T }.
                let speed = PI * seen.normal_gravity / (TAU * 50.0) * (1.5 * 0.8 / 1.2 - 0.052_408);
                assert!(
                    (load.speed * 1e-3 / speed - 1.0).abs() < 1e-4,
                    "{load:?} {speed}"
                );
                assert!((load.flow - load.mass * load.speed / 500.0).abs() < 1e-3);
            }
        }
    }

    /// A gain told wrong by a tenth is found out on the empty track; parts out of gear are not weighed.
    #[test]
    fn the_empty_track_is_the_tare_and_what_is_out_of_gear_is_not_weighed() {
        let settings = settings();
        let mut meter = LoadMeter::build(&settings).unwrap();
        let (mut empty, _) = seen(&settings, 0.4, 0.0);
        (empty.heard, empty.in_gear) = (false, 0.0);
        empty.output *= 1.1;
        for _ in 0..400 {
            meter.cycle(&empty);
        }
        let (mut loaded, _) = seen(&settings, 0.4, 0.05);
        loaded.output *= 1.1;
        for _ in 0..400 {
            meter.cycle(&loaded);
        }
        let mass = meter.load().unwrap().mass;
        assert!((mass / 500.0 - 1.0).abs() < 0.01, "{mass}");
        loaded.in_gear = 0.6;
        meter.cycle(&loaded);
        assert_eq!(meter.load(), None);
        assert!(LoadMeter::build(&Settings::default()).is_none());
    }
}
