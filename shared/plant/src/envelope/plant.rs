//! Envelope plant: the simulated feeder in steps of a drive cycle.
//!
//! The track's complex amplitude follows its exact recurrence, and the parts follow the impact map.
//! Demodulator and onset detector are evaluated in closed form.

use super::load::TrackLoad;
use super::onset::{Background, DetectedOnset, OnsetModel, SampledImpact};
use super::recurrence::{Recurrence, turn};
use super::track_motion::TrackMotion;
use super::upper::UpperEnvelope;
use crate::model::crowd::{MAX_STRIKES, all_at_rest, change_restitution, mean};
use crate::model::hopper::Hopper;
use crate::model::law::Law;
use crate::model::part::{Part, Strike, Track, WaveCache};
use crate::model::scene::{Change, PARTS, Scene};
use crate::model::timeline::Timeline;
use core::f64::consts::TAU;
use heapless::Vec;
use kband::arithmetic::{Noise, Phase};
use kband::feeder::{OutOfRange, STANDARD_GRAVITY};
use kband::impact::ContactTime;
use kband_control::signal_path::{
    DetectedImpact, MAX_IMPACTS_PER_CYCLE, OnsetDetector, SECTORS_PER_CYCLE, impulse_weight,
    last_cycle_gain,
};
use kband_control::{Command, Cycle, SAMPLE_RATE, phase_step};
use num_complex::{Complex32, Complex64 as Complex};
use readings::{Readings, Sense};

mod readings;

/// Largest number of events of one part in one cycle; later events move to the next cycle.
const EVENTS_PER_CYCLE: usize = 200;
/// Largest number of detected impacts that wait for the cycle of their sample.
const MAX_PENDING_IMPACTS: usize = 2 * MAX_IMPACTS_PER_CYCLE;

/// The simulated feeder in steps of a drive cycle.
///
/// [`EnvelopePlant::cycle`] returns the signal path's result. Drive and demodulator are exact.
/// Noise is drawn once for each quantity. A saturated cycle is computed sample by sample.
#[derive(Clone, Debug)]
pub struct EnvelopePlant {
    pub(super) timeline: Timeline,
    drive: Recurrence,
    /// Upper tones and modes above the resonance, if the drive has any, and the resulting wave.
    upper: Option<UpperEnvelope>,
    waves: WaveCache,
    /// Number of upper tones that the settings enable.
    tones: usize,
    /// Amplitude of the measured current in A at full output; 0 without a current sensor.
    full_current: f32,
    contact: ContactTime,
    sense: Sense,
    readings: Readings,
    onset: OnsetModel,
    parts: Vec<Part, PARTS>,
    load: Option<TrackLoad>,
    hopper: Hopper,
    /// Gravity normal to the track in m/s^2.
    normal_gravity: f64,
    noise: Noise,
    /// Time up to which the parts are simulated, in 2^-32 turns: the last sample before the cycle.
    time: i64,
    /// Samples before this cycle.
    sample: u64,
    /// Turns of the mains per sample.
    mains: f64,
    law: Law,
    /// Whether the displacement along the track is computed.
    pub(super) watched: bool,
    /// Impacts of the last cycle in order of time.
    pub(super) strikes: Vec<Strike, MAX_STRIKES>,
    /// Detected impacts of cycles that have not ended, in order of time.
    pending_impacts: Vec<DetectedOnset, MAX_PENDING_IMPACTS>,
    /// Demodulated acceleration of the last cycle under a load, along sine and cosine of the phase.
    demodulated: Complex,
    /// The detector's running median, which follows the noise within some cycles.
    median: f64,
}

impl EnvelopePlant {
    pub(crate) fn build(scene: &Scene) -> Result<Self, OutOfRange> {
        scene.check()?;
        let settings = &scene.settings;
        settings.check()?;
        let track = settings.track()?;
        let full = f64::from((1_u32 << settings.converter_bits as u32) - 1);
        let volts = f64::from(settings.converter_reference) / (full + 1.0);
        let codes = f64::from(settings.sensitivity) / STANDARD_GRAVITY / volts;
        let sense = Sense {
            floor: 1.0 / codes,
            rest: scene.rest().into(),
            zero: f64::from(settings.sensor_zero) / volts,
            full,
            ..Sense::default()
        };
        let tones = settings.upper_tones();
        let mut plant = Self {
            timeline: Timeline::new(scene),
            drive: Recurrence::new(&scene.drive, phase_step(settings.frequency)),
            upper: UpperEnvelope::build(&scene.drive, settings.frequency.into(), tones),
            waves: WaveCache::default(),
            tones,
            full_current: if settings.current_sensitivity > 0.0 {
                scene.drive.gain / scene.drive.current_gain
            } else {
                0.0
            },
            contact: scene.contact_time()?,
            readings: Readings::new(&scene.effective_sensor(), &sense),
            sense,
            onset: OnsetModel::new(&scene.effective_sensor()),
            parts: all_at_rest(scene)?,
            load: scene.has_mass().then(|| TrackLoad::new(scene)),
            hopper: Hopper::new(scene),
            normal_gravity: track.normal_gravity(),
            noise: Noise::new(scene.seed),
            time: -i64::from(phase_step(settings.frequency)),
            sample: 0,
            mains: f64::from(scene.drive.mains) / f64::from(SAMPLE_RATE),
            law: scene.law(&track),
            watched: true,
            strikes: Vec::new(),
            pending_impacts: Vec::new(),
            demodulated: Complex::ZERO,
            median: 1.0 / codes,
        };
        plant.sense();
        Ok(plant)
    }

    fn sense(&mut self) {
        let factor = f64::from(self.timeline.sensor.sensitivity);
        let noise = f64::from(self.timeline.sensor.noise);
        let sense = self.sense;
        let middle = sense.zero + sense.rest * factor / sense.floor;
        let white = libm::sqrt(noise * noise + sense.floor * sense.floor / 12.0);
        self.sense = Sense {
            factor,
            noise,
            white,
            residual: self.onset.residual(white) * factor,
            headroom: middle.min(sense.full - middle) * sense.floor / factor.max(1e-9),
            ..self.sense
        };
    }

    /// Simulates a drive cycle; `next` is the command of the next one, for averaging and blanking.
    pub(crate) fn cycle(&mut self, command: &Command, next: &Command) -> Cycle {
        let (output, step) = (f64::from(command.amplitude), command.step);
        self.strikes.clear();
        let middle = self.sample as f64 + 0.5 * f64::from(self.drive.samples());
        let driven = self.output(output, command.lead.radians(), step, middle);
        let angular = f64::from(step) * (TAU * f64::from(SAMPLE_RATE) / Phase::TURN);
        let load = self.load.as_mut();
        let pushed = load.map_or(Complex::ZERO, |load| load.begin(angular));
        let pushed = pushed * self.drive.per_acceleration();
        self.drive.begin(driven + pushed, step);
        if let Some(upper) = &mut self.upper {
            let gain = f64::from(self.timeline.gain);
            let tone = |[sine, cosine]: [f32; 2]| Complex::new(sine.into(), cosine.into()) * gain;
            let overtones = command.overtones.map(tone);
            upper.begin(driven, overtones, step.max(1));
        }
        let samples = self.drive.samples();
        self.move_parts();
        if let Some(load) = &mut self.load {
            let pushed = load.settle() * self.drive.per_acceleration();
            self.drive.begin(driven + pushed, step);
        }
        let upper = self.upper.as_ref();
        let added = upper.map_or(0.0, UpperEnvelope::max_acceleration);
        let max_acceleration = self.drive.max_acceleration();
        // Upper bound of the summed ringing of this cycle's impacts.
        let speeds = self.strikes.iter().map(|strike| strike.speed);
        let ringing = f64::from(self.timeline.sensor.ringing) * speeds.sum::<f64>();
        let clipped =
            max_acceleration + added + ringing + 4.0 * self.sense.noise > self.sense.headroom;
        let mut cycle = Cycle {
            samples: samples as u16,
            current: self.full_current * libm::sqrt(driven.norm_sqr()) as f32,
            ..Cycle::default()
        };
        // An impact detected only in the next cycle has a phase of this one.
        let read = (clipped || self.readings.averages).then(|| self.read_each(&mut cycle));
        // Parts with mass seldom ring at once: without saturation the closed form applies.
        let cut = clipped && (self.load.is_none() || cycle.saturated > 0);
        let readings = read.filter(|_| cut);
        let ringing_sum = self.detect_impacts(max_acceleration);
        let swing = self.drive.steady_swing() * self.sense.factor;
        cycle.sectors = self.onset.sectors(samples, self.sense.residual, swing);
        let mut measured = self.drive.end();
        if let Some(upper) = &mut self.upper {
            let (first, above) = upper.end(samples);
            measured += first;
            if !self.timeline.lost {
                for (parts, measured) in cycle.upper.iter_mut().zip(above).take(self.tones) {
                    *parts = measured.map(|part| part as f32);
                }
            }
        }
        let unblanked_share = 1.0 - self.onset.blanking.share(samples);
        let mut measured = readings.unwrap_or(measured + ringing_sum / unblanked_share);
        self.blank(&mut measured, samples);
        self.read(&mut cycle, measured, max_acceleration + added, middle);
        self.report_impacts(&mut cycle, samples);
        self.readings.finish(next.average_from, step, &mut cycle);
        self.onset.blanking.disabled = next.whole;
        self.sample += u64::from(samples);
        self.onset.age_background(samples);
        cycle
    }

    /// Complex output with the bus ripple at the drive's frequency. `sin(wt) r sin(Wt)` contains
    /// `r/2 cos((W - w)t)`; the drive does not respond to the other sideband.
    fn output(&self, output: f64, lead: f64, step: u32, middle: f64) -> Complex {
        let output = output * f64::from(self.timeline.gain);
        let leads = lead != 0.0;
        let ahead = if leads { turn(lead) } else { Complex::ONE };
        if self.timeline.ripple <= 0.0 {
            return ahead * output;
        }
        let turns = f64::from(step) / Phase::TURN;
        let frequency_difference = (2.0 * self.mains - 2.0 * turns) * TAU;
        let samples = f64::from(self.drive.samples());
        let phase = f64::from(self.drive.phase) / Phase::TURN + 0.5 * samples * turns;
        let beat = TAU * (2.0 * self.mains * middle - 2.0 * phase);
        // cos(x + wt) = Im(i e^(i x) e^(i wt)).
        let ripple = turn(beat)
            * (0.5 * f64::from(self.timeline.ripple) * sinc(0.5 * frequency_difference * samples));
        (ahead + ahead.conj() * Complex::new(0.0, 1.0) * ripple) * output
    }

    /// Effect of blanking on the demodulated acceleration. Impacts that push the track are blanked
    /// together with the motion at that phase; the last cycle's motion replaces it.
    fn blank(&mut self, measured: &mut Complex, samples: u32) {
        let Some(load) = &self.load else {
            return;
        };
        let impact_force = load.impact_force();
        let share = self.onset.blanking.share(samples) as f32;
        let between = impact_force * f64::from(impulse_weight(share));
        let now = Complex::new(measured.im, measured.re) - between;
        // A push leads its velocity jump by a quarter turn.
        let ahead =
            impact_force * Complex::new(0.0, 1.0 / libm::sqrt(impact_force.norm_sqr()).max(1e-30));
        let at = Complex32::new(ahead.re as f32, ahead.im as f32);
        let repeated = last_cycle_gain(at, share);
        let repeated = Complex::new(f64::from(repeated.re), f64::from(repeated.im));
        let demodulated = now + repeated * (self.demodulated - now).conj();
        *measured = Complex::new(demodulated.im, demodulated.re);
        self.demodulated = demodulated;
    }

    fn move_parts(&mut self) {
        let (samples, step) = (self.drive.samples(), self.drive.tuning.step);
        let end = (self.time + i64::from(samples) * i64::from(step)).max(0) as u64;
        let motion = TrackMotion::new(&self.drive, self.upper.as_ref(), self.time);
        let (waves, normal_gravity) = (&mut self.waves, self.normal_gravity);
        let track = Track {
            normal_gravity,
            angular: f64::from(self.drive.tuning.step)
                * (TAU * f64::from(SAMPLE_RATE) / Phase::TURN),
            law: self.watched.then_some(self.law),
            wave: None,
            contact: self.contact,
        };
        let mut load = self.load.as_mut();
        for (index, part) in self.parts.iter_mut().enumerate() {
            let arrives = self.hopper.arrives(index);
            if arrives > end {
                continue;
            }
            let begun = self.time.max(0) as u64;
            let mut from = begun.max(arrives);
            let mut rest_start = part.is_on_track().then_some(from);
            let share = load.as_ref().map_or(0.0, |load| load.share(index));
            for _ in 0..EVENTS_PER_CYCLE {
                let Some(next) = part.next() else {
                    let Some((swing, time)) = motion.thrown(&track, waves, from, end) else {
                        break;
                    };
                    let wave = motion.wave(&swing, waves);
                    part.throw(swing, &Track { wave, ..track }, time);
                    if part.rests() {
                        break;
                    }
                    if let Some(load) = &mut load
                        && let Some(since) = rest_start.take()
                    {
                        load.add_rest(index, motion.rest(since, time), normal_gravity);
                    }
                    continue;
                };
                if next > end {
                    break;
                }
                from = next;
                let swing = motion.swing(next);
                let wave = motion.wave(&swing, waves);
                // The track recoils from a part with mass, which acts like more gravity.
                let jumping = Track {
                    wave,
                    normal_gravity: normal_gravity * (1.0 + share),
                    ..track
                };
                if let Some(strike) = part.event(swing, &jumping) {
                    if let Some(load) = &mut load {
                        load.strike(index, part.pushed, motion.output_phase(next));
                    }
                    if part.is_on_track() {
                        rest_start = Some(next);
                    }
                    // When the list is full, the loudest impacts are kept.
                    let part = index as u8;
                    if let Err(more) = self.strikes.push(Strike { part, ..strike }) {
                        let stored = self.strikes.iter_mut();
                        let quietest =
                            stored.min_by(|one, other| one.speed.total_cmp(&other.speed));
                        if let Some(quietest) = quietest.filter(|one| one.speed < more.speed) {
                            *quietest = more;
                        }
                    }
                }
            }
            if let (Some(load), Some(since)) = (&mut load, rest_start) {
                load.add_rest(index, motion.rest(since, end), normal_gravity);
            }
            // A flying part does not slide. With upper tones the wave is updated in any case.
            if let Some(Law::Friction(_)) = track.law
                && (part.may_slide() || self.upper.is_some())
            {
                let swing = motion.swing(end);
                let wave = motion.wave(&swing, waves);
                let (phase, amplitude) = (swing.phase.radians(), swing.amplitude.into());
                part.slide(phase, amplitude, &Track { wave, ..track }, end);
            }
        }
        if self.parts.len() > 1 {
            self.strikes.sort_unstable_by_key(|strike| strike.time);
        }
    }

    /// Detects this cycle's impacts and returns the demodulated part of their ringing.
    fn detect_impacts(&mut self, max_acceleration: f64) -> Complex {
        (self.onset).tune(f64::from(self.drive.tuning.step) * (TAU / Phase::TURN));
        let sense = self.sense;
        let leak = self.onset.tuning.leak * max_acceleration * sense.factor;
        let square = sense.residual * sense.residual + 0.5 * leak * leak;
        let level = libm::sqrt(square);
        let swinging = 0.5 * leak * leak / square.max(1e-30);
        // Largest relative change of a running median in a cycle.
        let max_change = 1.0 + f64::from(self.drive.samples()) * OnsetDetector::MEDIAN_STEP;
        let (low, high) = (self.median / max_change, self.median * max_change);
        let median = self.onset.median(level, swinging).clamp(low, high);
        self.median = median.max(sense.floor);
        let leaked = self.onset.leaked(self.drive.steady_swing() * sense.factor);
        let (samples, step) = (self.drive.samples(), self.drive.tuning.step);
        (self.onset).begin(self.sample, samples, self.drive.phase_at(0), step);
        let mut sum = Complex::ZERO;
        let mut index = 0;
        while let Some(&strike) = self.strikes.get(index) {
            // Simultaneous impacts ring as one.
            let simultaneous = self.strikes[index..].iter();
            let simultaneous = simultaneous.take_while(|other| other.time == strike.time);
            let (count, speed) = simultaneous.fold((0, 0.0), |(count, speed), other| {
                (count + 1, speed + other.speed)
            });
            index += count;
            // The state at a sample results from the output of the sample before.
            let samples = (strike.time as i64 - self.time) as f64 * self.drive.tuning.per_step;
            let down = samples as u32;
            let next_sample = down + u32::from(f64::from(down) < samples);
            let impact = SampledImpact {
                sample: self.sample + u64::from(next_sample),
                share: f64::from(next_sample) - samples,
                height: f64::from(self.timeline.sensor.ringing) * speed * sense.factor,
            };
            let at = self.drive.at(next_sample);
            let background = Background {
                median: self.median,
                rms: sense.residual,
                leak: leaked * at,
            };
            let (detected, ringing) = self.onset.impact(impact, background, &mut self.noise);
            sum += ringing * at;
            if let Some(detected) = detected {
                let at =
                    (self.pending_impacts).partition_point(|other| other.sample <= detected.sample);
                let _ = self.pending_impacts.insert(at, detected);
            }
        }
        if !self.strikes.is_empty() {
            sum *= 2.0 * f64::from(self.drive.tuning.step) / Phase::TURN / sense.factor.max(1e-9);
        }
        sum
    }

    /// Writes the demodulated values into the board's readings, with noise, hum and sensor faults.
    fn read(&mut self, cycle: &mut Cycle, measured: Complex, max_acceleration: f64, middle: f64) {
        cycle.noise = (self.median / OnsetDetector::QUARTILE) as f32;
        cycle.blanked = self.onset.blanking.share(u32::from(cycle.samples)) as f32;
        let factor = self.sense.factor;
        let signed_factor = if self.timeline.inverted {
            -factor
        } else {
            factor
        };
        cycle.mean = (self.sense.rest * signed_factor) as f32;
        if self.timeline.lost {
            cycle.sectors.energy = [0.0; SECTORS_PER_CYCLE];
            let code = (self.sense.zero + 0.5) as u16;
            (cycle.low, cycle.high) = (code, code);
            return;
        }
        let sense = self.sense;
        let samples = f64::from(cycle.samples);
        // Standard deviation of the mean of 2 n(t) e^(i phase) over the N unblanked samples.
        let unblanked_share = 1.0 - self.onset.blanking.share(u32::from(cycle.samples));
        let scatter = sense.white * libm::sqrt(2.0 / (samples * unblanked_share).max(1.0));
        let hum = self.hum(samples, middle);
        let in_phase = measured.re + hum.re + scatter * f64::from(self.noise.gauss());
        let quadrature = measured.im + hum.im + scatter * f64::from(self.noise.gauss());
        cycle.in_phase = (in_phase * signed_factor) as f32;
        cycle.quadrature = (quadrature * signed_factor) as f32;
        for part in cycle.upper.iter_mut().take(self.tones).flatten() {
            let measured = f64::from(*part) + scatter * f64::from(self.noise.gauss());
            *part = (measured * signed_factor) as f32;
        }
        if cycle.saturated == 0 {
            let code = |acceleration: f64| {
                let code =
                    sense.zero + (acceleration + sense.rest * signed_factor) / sense.floor + 0.5;
                code.clamp(0.0, sense.full) as u16
            };
            let reach = (max_acceleration + 3.0 * sense.noise) * factor;
            (cycle.low, cycle.high) = (code(-reach), code(reach));
        }
    }

    fn hum(&self, samples: f64, middle: f64) -> Complex {
        if self.timeline.sensor.hum <= 0.0 {
            return Complex::ZERO;
        }
        let drive = f64::from(self.drive.tuning.step) / Phase::TURN;
        // Phase at the middle of the cycle that ended, half a cycle back.
        let phase = f64::from(self.drive.phase) / Phase::TURN - 0.5 * samples * drive;
        let (mains, drive_at) = (TAU * self.mains * middle, TAU * phase);
        let half = 0.5 * TAU * samples;
        let difference_term = sinc(half * (self.mains - drive));
        let sum_term = sinc(half * (self.mains + drive));
        // Average of 2 sin(Wt) e^(i wt) = -i e^(i(W + w)t) + i e^(-i(W - w)t) over the cycle.
        let sum = turn(mains + drive_at) * Complex::new(0.0, -sum_term)
            + turn(drive_at - mains) * Complex::new(0.0, difference_term);
        sum * f64::from(self.timeline.sensor.hum)
    }

    /// Moves the impacts detected within the ended cycle of `samples` samples into its readings.
    fn report_impacts(&mut self, cycle: &mut Cycle, samples: u32) {
        let step = self.drive.tuning.step;
        // The drive's phase is already that of the next cycle.
        let began = self.drive.phase.wrapping_sub(step.wrapping_mul(samples));
        let end = self.sample + u64::from(samples);
        let mut last = self.sample;
        let pending = &self.pending_impacts;
        let due = pending.partition_point(|detected| detected.sample < end);
        for detected in &pending[..due] {
            if self.timeline.lost {
                break;
            }
            let n = (detected.sample.max(last) - self.sample) as u32;
            last = detected.sample.max(last);
            // The signal path stamps an impact with the phase of the sample before its detection.
            let phase = began.wrapping_add(n.wrapping_sub(1).wrapping_mul(step));
            let _ = cycle.impacts.push(DetectedImpact {
                phase: Phase::from_bits(phase),
                strength: detected.strength as f32,
            });
        }
        self.pending_impacts.drain(..due);
        self.time += i64::from(samples) * i64::from(step);
    }

    /// Normal amplitude of the track in m.
    pub fn amplitude(&self) -> f64 {
        let motion = TrackMotion::new(&self.drive, self.upper.as_ref(), self.time);
        f64::from(motion.swing(self.time.max(0) as u64).amplitude)
    }

    /// Mass of the parts on the track over that of the track.
    pub fn load(&self) -> f64 {
        let now = self.time.max(0) as u64;
        let on = |index: &usize| self.hopper.arrives(*index) <= now;
        let shares = (0..self.parts.len()).filter(on);
        (self.load.as_ref()).map_or(0.0, |load| shares.map(|part| load.share(part)).sum())
    }

    /// Time since the start in s.
    pub fn seconds(&self) -> f64 {
        self.sample as f64 / f64::from(SAMPLE_RATE)
    }

    /// Number of samples before the next cycle, and within it at the present step.
    pub fn samples(&self) -> [u64; 2] {
        [self.sample, u64::from(self.drive.samples())]
    }

    /// Mean displacement of the parts along the track in m, positive upwards; 0 without parts.
    pub fn displacement(&self) -> f64 {
        mean(self.parts.iter().map(|part| part.displacement))
    }

    pub(super) fn apply(&mut self, change: Change) {
        match self.timeline.take(change) {
            Some(Change::Restitution(_) | Change::Scatter(_)) => {
                let parts = self.parts.iter_mut();
                parts.for_each(|part| change_restitution(&mut part.restitution, change));
            }
            Some(Change::Dump(seconds)) => {
                let step = f64::from(self.drive.tuning.step);
                let turns = f64::from(seconds) * f64::from(SAMPLE_RATE) * step / Phase::TURN;
                self.hopper.dump(self.time.max(0) as u64, turns);
            }
            Some(Change::Parts(count)) => {
                let (now, parts) = (self.time.max(0) as u64, &mut self.parts);
                let arrive = |part: usize| parts[part].rest_at(now);
                self.hopper.place(now, count, arrive);
            }
            _ => {}
        }
        self.sense();
    }
}

fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-6 {
        1.0
    } else {
        libm::sin(x) / x
    }
}
