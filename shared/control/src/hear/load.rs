//! Estimates the mass of the parts on the track from the power balance of the drive.
//!
//! A part of mass m in gear gives the track the momentum of its weight over each flight, at phase t
//! of the track. At the drive's frequency that is a force of `2 m g cos(alpha)` with the impacts'
//! phase. It adds `2 (m/M) k <cos t>` to the track's loss `1/Q`. In gear of order r `<cos t>` is
//! `pi r k (1 - R)/(1 + R)`, also after doublings (docs/theory-real-parts.md#t10.5). The empty
//! track gives the tare. All means forget exponentially.

use super::blanking::{impulse_weight, last_cycle_gain};
use crate::{SAMPLE_RATE, Settings, phase_of};
use core::f32::consts::{PI, TAU};
use kband::arithmetic::{sine_cosine, sine_cosine_single, square_root_single};
use kband::impact::ContactTime;
use num_complex::Complex32 as Complex;
use serde::{Deserialize, Serialize};

/// Gain of the mean mass per drive cycle: one cycle scatters by a third, the mean of 64 by 4 %.
const MASS_GAIN: f32 = 1.0 / 64.0;
/// Number of drive cycles before a mass is reported.
const MIN_CYCLES: f32 = 64.0;
/// Gain of the tare per drive cycle.
const TARE_GAIN: f32 = 1.0 / 32.0;
/// Drive cycles without an impact after which the track counts as empty.
const EMPTY_CYCLES: f32 = 16.0;
/// Gain of the means of blanked share and concentration per drive cycle.
const PHASE_GAIN: f32 = 0.1;
/// Minimum share of time in gear for weighing: parts out of gear absorb a different power.
const MIN_IN_GEAR_SHARE: f32 = 0.7;

/// Estimated load of the track.
///
/// Largest errors over twenty random feeders: 3.4 % in the flow and 3.0 % in the mass. Their Q is
/// 10 to 50, their parts are 2 to 20 % of the track's mass (docs/theory-real-parts.md#t10.5).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Load {
    /// Mass of the parts in g (symbol m).
    pub mass: f32,
    /// Their conveying speed in mm/s, positive upwards.
    pub speed: f32,
    /// Flow in g/s: mass times speed over the track's length; 0 without a configured length.
    pub flow: f32,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct LoadMeasurement {
    /// Demodulated motion between the impacts, in m: along sine and cosine of the output's phase.
    pub motion: Complex,
    /// Output of that cycle along sine and cosine of its phase, as a share of full output.
    pub output: Complex,
    /// Share of the cycle that the demodulator blanked.
    pub blanked: f32,
    /// Square of the drive's angular frequency in 1/s^2 (symbol w^2).
    pub square: f32,
    /// In Hz.
    pub frequency: f32,
    /// Gravity normal to the track in m/s^2.
    pub normal_gravity: f32,
    /// Share of the parts' time in gear, 0..=1.
    pub in_gear: f32,
    /// Concentration of the track's phases at the impacts, 0..1.
    pub concentration: f32,
    /// Order of that gear (symbol r).
    pub order: u8,
    /// Estimated restitution of the parts; `None`: the configured lot's.
    pub restitution: Option<f32>,
    /// Mean cosine of the phases of the impacts, if one part alone strikes.
    pub cosine: Option<f32>,
    /// Whether the track moves sinusoidally: a second tone consumes additional power.
    pub sine: bool,
    pub has_impact: bool,
    pub settled: bool,
}

/// Estimator of the load from the power in excess of the empty track's.
#[derive(Clone, Copy, Debug, Default)]
pub struct LoadMeter {
    /// Mass of the track in g, its length in mm.
    track: f32,
    length: f32,
    /// Natural angular frequency in rad/s, static displacement at full output in m, and 1/Q.
    natural: f32,
    force: f32,
    loss: f32,
    restitution: f32,
    /// Ratio of motion along the track to normal motion, times cosine and sine of the lead.
    along: [f32; 2],
    /// Loss of conveying speed on the incline, over the fall per flight.
    incline_loss: f32,
    /// Tangent of the incline, tangential restitution, and duration of an impact.
    incline: f32,
    tangential: f32,
    contact: ContactTime,
    /// Ratio of estimated to configured drive force, on the empty track.
    tare: f32,
    /// Correction of the squared ratio of resonance to drive frequency, on the empty track.
    detuning: f32,
    silent_cycles: f32,
    amplitude: f32,
    /// Mean share of a cycle that the demodulator blanks.
    blanked: f32,
    /// `e^(-i phase)` of the output at the impacts of parts in gear, and their mean concentration.
    impact_phasor: Complex,
    concentration: f32,
    /// Mean relative deficit of the motion against the acceleration, in phase.
    deficit: f32,
    last_motion: Complex,
    /// Mean mass over the track's, and the number of cycles averaged.
    mass_ratio: f32,
    cycles: f32,
    /// Estimated load; `None` before 64 cycles in gear.
    pub load: Option<Load>,
}

impl LoadMeter {
    /// Estimator for these settings; `None` without a configured mass of the track.
    pub fn build(settings: &Settings) -> Option<Self> {
        if settings.track_mass <= 0.0 {
            return None;
        }
        let (sine, cosine) = sine_cosine_single(phase_of(settings.phase_lead * (PI / 180.0)));
        let mut meter = Self {
            track: settings.track_mass * 1e3,
            length: settings.track_length,
            natural: TAU * settings.resonance,
            force: settings.gain * 1e-3 / settings.quality,
            loss: 1.0 / settings.quality,
            along: [cosine, sine].map(|part| part * settings.amplitude_ratio),
            tare: 1.0,
            silent_cycles: f32::INFINITY,
            ..Self::default()
        };
        meter.set_lot(settings);
        Some(meter)
    }

    pub fn set_lot(&mut self, settings: &Settings) {
        self.tangential = settings.tangential_restitution;
        let (sine, cosine) = sine_cosine(f64::from(settings.incline * (PI / 180.0)));
        self.incline = (sine / cosine) as f32;
        self.contact = settings.contact_time();
        self.restitution = 0.5 * (settings.restitution_low + settings.restitution_high);
        self.incline_loss = self.incline * (1.0 + self.tangential) / (1.0 - self.tangential);
        self.forget();
    }

    /// Clears the mass, after a change of setpoint or target.
    pub fn forget(&mut self) {
        (self.mass_ratio, self.cycles, self.load) = (0.0, 0.0, None);
    }

    /// Mean of `e^(-i phase)` of the output at the impacts of parts in gear.
    pub fn impact_phase(&self) -> Complex {
        self.impact_phasor * self.concentration
    }

    /// Whether the track counts as empty: no impact for 16 cycles.
    pub fn is_silent(&self) -> bool {
        self.silent_cycles > EMPTY_CYCLES
    }

    /// Updates the estimate with one cycle. Returns the track's motion with the impacts' impulse, in
    /// m. The demodulator blanks impacts, so the acceleration between them lacks that impulse.
    pub fn cycle(&mut self, measured: &LoadMeasurement) -> Complex {
        let order = f32::from(measured.order.max(1));
        let restitution = measured.restitution.unwrap_or(self.restitution);
        let loss_factor = (1.0 - restitution) / (1.0 + restitution);
        // Amplitude b at k = 1.
        let unit = measured.normal_gravity / measured.square;
        let raw_amplitude = square_root_single(measured.motion.norm_sqr());
        let last_motion = core::mem::replace(&mut self.last_motion, measured.motion);
        let silent = self.silent_cycles + 1.0;
        self.silent_cycles = if measured.has_impact { 0.0 } else { silent };
        if raw_amplitude < 1e-3 * unit {
            self.amplitude = raw_amplitude;
            return measured.motion;
        }
        // Zero-order hold: half a sample of delay.
        let (sine, cosine) =
            sine_cosine_single(phase_of(PI * measured.frequency / SAMPLE_RATE as f32));
        let natural = self.natural * self.natural / measured.square;
        let requested = measured.output * Complex::new(cosine, -sine) * (natural * self.force);
        let forced = requested * self.tare;
        let loss = square_root_single(natural) * self.loss;
        let empty = Complex::new(natural - 1.0 + self.detuning, loss);
        if self.is_silent() {
            (self.amplitude, self.load) = (raw_amplitude, None);
            (self.blanked, self.concentration, self.deficit) = (0.0, 0.0, 0.0);
            // Without detected impacts, a track that throws parts is empty.
            if measured.settled && raw_amplitude > unit {
                let output_ratio = requested / measured.motion;
                self.tare += (loss / output_ratio.im.max(0.1 * loss) - self.tare) * TARE_GAIN;
                self.detuning += ((output_ratio * self.tare).re - empty.re) * TARE_GAIN;
            }
            return measured.motion;
        }
        // Phase of the impacts, from the motion before correction.
        self.blanked += (measured.blanked - self.blanked) * PHASE_GAIN;
        if measured.concentration > 0.0 {
            self.concentration += (measured.concentration - self.concentration) * PHASE_GAIN;
        }
        let cosine_at =
            |k: f32| (measured.cosine).unwrap_or_else(|| (PI * order * k * loss_factor).min(1.0));
        let cosine = cosine_at(unit / raw_amplitude);
        let sine = square_root_single((1.0 - cosine * cosine).max(0.0));
        self.impact_phasor = measured.motion * (1.0 / raw_amplitude) * Complex::new(cosine, -sine);
        let between = measured.motion
            - last_cycle_gain(self.impact_phasor, measured.blanked)
                * (last_motion - measured.motion).conj();
        // Without motion between the impacts the quotient is undefined.
        if between.norm_sqr() < 1e-6 * raw_amplitude * raw_amplitude {
            self.amplitude = raw_amplitude;
            return measured.motion;
        }
        let weight = impulse_weight(self.blanked);
        let mut correction = (between + forced * weight) / ((empty * weight + 1.0) * between);
        // Resting parts add to the track's mass; the acceleration already contains their force.
        self.deficit += (1.0 - correction.re - self.deficit) * PHASE_GAIN;
        correction.re += self.deficit.max(0.0);
        let corrected = between * correction;
        let amplitude = square_root_single(corrected.norm_sqr());
        let k = unit / amplitude;
        let cosine = cosine_at(k);
        // Power that a growing amplitude stores.
        let stored_power = (amplitude - self.amplitude) / (PI * amplitude);
        self.amplitude = amplitude;
        let parts_power = (forced / corrected - empty).im - stored_power;
        let share = parts_power / (2.0 * k * cosine.max(0.1));
        if !measured.settled || !measured.sine || measured.in_gear < MIN_IN_GEAR_SHARE {
            self.forget();
            return corrected;
        }
        self.cycles += 1.0;
        self.mass_ratio += (share - self.mass_ratio) * MASS_GAIN.max(1.0 / self.cycles);
        if self.cycles >= MIN_CYCLES {
            let rebound = [restitution, loss_factor];
            self.load = Some(self.estimate_load(measured, k, cosine, rebound));
        }
        corrected
    }

    /// Conveying speed over `b w` added by the duration of impacts, to first order
    /// (docs/theory-real-parts.md#t10.6). Terms: the impulse along the track, and the lock's phase.
    fn speed_gained_in_contact(&self, k: f32, [sine, cosine]: [f32; 2], restitution: f32) -> f32 {
        let c = self.contact.radians() as f32;
        let r = f64::from(restitution);
        let [normal, along] = [self.contact.gain(r), self.contact.gain_along(r)];
        let ([normal, along], tangential) = ([normal as f32, along as f32], self.tangential);
        let [in_phase, quadrature] = self.along;
        // Acceleration of the track along itself, and gravity along it, over b w^2.
        let track_acceleration = in_phase * sine + quadrature * cosine;
        let gravity = k * self.incline;
        let phase_shift =
            (c * restitution + normal) * sine + k * (c * (1.0 - restitution) - normal);
        (along - c * tangential) / (1.0 - tangential) * (track_acceleration - gravity)
            + 0.5 * c * gravity
            - track_acceleration / sine.max(0.1) * phase_shift / (1.0 + restitution)
    }

    fn estimate_load(
        &self,
        measured: &LoadMeasurement,
        k: f32,
        cosine: f32,
        [restitution, loss_factor]: [f32; 2],
    ) -> Load {
        let order = f32::from(measured.order.max(1));
        let mass = self.track * self.mass_ratio;
        // b w cos t, the mean velocity of the track at an impact, is pi r (g/w) (1 - R)/(1 + R).
        let fall_speed = measured.normal_gravity * order / (2.0 * measured.frequency);
        let sine = square_root_single((1.0 - cosine * cosine).max(0.0));
        let velocity = TAU * measured.frequency * measured.normal_gravity / (k * measured.square);
        // A single heavy part leaves at the track's velocity after the jump.
        let jump = 2.0 * self.mass_ratio * restitution / (1.0 + restitution);
        let jump = measured.cosine.map_or(0.0, |_| jump);
        let [in_phase, quadrature] = self.along;
        let speed = in_phase * fall_speed * (loss_factor - jump)
            - quadrature * velocity * sine
            - self.incline_loss * fall_speed;
        let contact_speed = self.speed_gained_in_contact(k, [sine, cosine], restitution);
        let speed = (speed + contact_speed * velocity) * 1e3;
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
    use crate::testing::with;
    use kband::impact::TangentialSettings;
    use kband::regime::Lock;
    use kband::transport::locked;

    /// Cycle of a track at k with a locked load of a twentieth of its mass, in closed form.
    fn measured(settings: &Settings, k: f32) -> LoadMeasurement {
        let square = (TAU * 50.0) * (TAU * 50.0);
        let normal_gravity = settings.gravity * libm::cosf(settings.incline * (PI / 180.0));
        let amplitude = normal_gravity / (k * square);
        let r = 0.5 * (settings.restitution_low + settings.restitution_high);
        let loss_factor = (1.0 - r) / (1.0 + r);
        let cosine = PI * k * loss_factor;
        let sine = libm::sqrtf(1.0 - cosine * cosine);
        // (w0^2 - w^2 + i w w0/Q) x = w0^2 F u - 2 (m/M) g i e^(-i t0) x/b, at the resonance.
        let impulse = Complex::new(sine, cosine) * (-0.1 * k);
        let response = Complex::new(0.0, 1.0 / settings.quality) - impulse;
        let force = settings.gain * 1e-3 / settings.quality;
        let output = libm::sqrtf(response.norm_sqr()) * amplitude / force;
        let hold_delay = Complex::new(libm::cosf(PI / 400.0), -libm::sinf(PI / 400.0));
        let motion = hold_delay * (output * force) * response.inv();
        // The acceleration between the impacts lacks their impulse: -a/w^2 = x + C/w^2.
        LoadMeasurement {
            motion: motion * (Complex::new(1.0, 0.0) + impulse),
            output: Complex::new(output, 0.0),
            square,
            frequency: 50.0,
            normal_gravity,
            in_gear: 1.0,
            concentration: 1.0,
            order: 1,
            sine: true,
            has_impact: true,
            settled: true,
            ..LoadMeasurement::default()
        }
    }

    /// At a contact of 2 % of the cycle `<cos t>` over the force, hence the mass, changes by 0.6 %.
    #[test]
    fn speed_with_contact_is_that_of_the_lock() {
        for (k, r, phase_lead) in [(0.43, 0.2, 0.0), (0.56, 0.35, 0.0), (0.56, 0.35, 20.0)] {
            for (contact, tangential) in [(0.2, 0.0), (0.2, 0.3), (0.4, 0.0)] {
                let settings = Settings {
                    contact,
                    phase_lead,
                    restitution_low: r,
                    restitution_high: r,
                    tangential_restitution: tangential,
                    track_mass: 10.0,
                    ..Settings::default()
                };
                let speed = |settings: &Settings| {
                    let mut meter = LoadMeter::build(settings).unwrap();
                    let measured = measured(settings, k);
                    for _ in 0..400 {
                        meter.cycle(&measured);
                    }
                    meter.load.unwrap().speed
                };
                let instant = with(settings, |it| it.contact = 0.0);
                let contact_speed = speed(&settings) - speed(&instant);
                let track = settings.track().unwrap();
                let along = TangentialSettings::on(&track, f64::from(tangential));
                let unit = 1e3 * track.velocity_unit(track.amplitude(f64::from(k)));
                let exact = |contact| {
                    let lock = Lock::with_contact(f64::from(k), f64::from(r), 1, contact);
                    locked::velocity(&lock.unwrap().unwrap(), f64::from(k), &along) * unit
                };
                let expected = exact(settings.contact_time()) - exact(ContactTime::INSTANT);
                let unit = exact(ContactTime::INSTANT);
                assert!((f64::from(speed(&instant)) / unit - 1.0).abs() < 1e-3);
                let relative_error = (f64::from(contact_speed) - expected) / unit;
                let holds = relative_error.abs() < 0.006 && expected < -0.5;
                assert!(holds, "{k} {contact}: {contact_speed} {expected}");
            }
        }
    }
}
