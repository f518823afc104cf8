//! Waveform plant: drive, parts, accelerometer and disturbances, simulated sample by sample.

use super::massive::{Ground, MassivePart, Stroke};
use crate::model::Moment;
use crate::model::crowd::{MAX_STRIKES, all_at_rest, change_restitution, mean, restitutions};
use crate::model::drive::{Resonator, Ringing, Swing, ToneSeparator, UpperMode};
use crate::model::hopper::Hopper;
use crate::model::law::Law;
use crate::model::part::{Part, Strike, Track, WaveCache};
use crate::model::scene::{Change, PARTS, Scene};
use crate::model::timeline::Timeline;
use core::f64::consts::TAU;
use heapless::Vec;
use kband::arithmetic::{Noise, Phase, sine_cosine_single};
use kband::feeder::{OutOfRange, STANDARD_GRAVITY};
use kband_control::{AdcCode, Inputs, Report, SAMPLE_RATE, Shape, Target, UPPER, phase_step};

/// Largest number of events of one part in one sample; later events move to the next sample.
const EVENTS_PER_SAMPLE: usize = 16;

/// Sensitivity of the current sensor in V/A without a configured one, as on the emulated board.
const CURRENT_SENSITIVITY: f32 = 0.3;

/// The simulated feeder of a scene with its disturbances, for any controller.
///
/// Each sample is [`Bench::sample`], then [`Bench::hold`] with the drive's output. At the end of a
/// cycle the controller reads [`Bench::inputs`] and [`Bench::new_target`].
#[derive(Clone, Debug)]
pub struct Bench {
    timeline: Timeline,
    samples: u64,
    drive: Resonator,
    /// Static displacement at full output in m.
    force: f32,
    /// Modes above the resonance and their static displacements.
    modes: Vec<(Resonator, f32), UPPER>,
    /// Separation of the upper tones, if the drive has any.
    tone_filter: Option<ToneSeparator>,
    waves: WaveCache,
    ringing: Ringing,
    /// Acceleration in m/s^2 that the sensor's axis measures at rest.
    rest: f32,
    /// The parts, if none has mass.
    parts: Vec<Part, PARTS>,
    /// The parts, if any has mass.
    massive: Vec<MassivePart, PARTS>,
    /// Time in 2^-32 turns before which no part has an event, unless one at rest lifts off.
    next_event: u64,
    any_at_rest: bool,
    /// Acceleration by the weight of lying parts in m/s^2, deflection of the spring under all in m.
    pressed: f32,
    sagged: f64,
    hopper: Hopper,
    /// The track in its present motion, without its wave.
    track: Track<'static>,
    /// Gravity down the track in m/s^2, and its motion along itself over that normal to it, for
    /// each tone n: eta cos, eta sin of n gamma.
    down: f64,
    along: [[f64; 2]; 1 + UPPER],
    noise: Noise,
    output: f32,
    /// Time in steps of 2^-32 turns of the drive.
    time: u64,
    step: u32,
    codes_per_acceleration: f32,
    zero: f32,
    full: f32,
    /// Reading of the current sensor over its zero at full output, in steps.
    current_codes: f32,
    last_code: u16,
    /// Phase of the mains and its advance per sample.
    mains: Phase,
    mains_step: u32,
    law: Law,
    strikes: Vec<Strike, MAX_STRIKES>,
}

/// All modes of a drive, the resonance first.
fn all<'a>(
    drive: &'a Resonator,
    modes: &'a [(Resonator, f32)],
) -> impl Iterator<Item = &'a Resonator> + Clone {
    core::iter::once(drive).chain(modes.iter().map(|(mode, _)| mode))
}

impl Bench {
    /// The bench of a scene at time 0: parts at rest, drive off. It refuses a number out of range.
    pub fn build(scene: &Scene) -> Result<Self, OutOfRange> {
        scene.check()?;
        let settings = &scene.settings;
        settings.check()?;
        let track = settings.track()?;
        let full = ((1_u32 << settings.converter_bits as u32) - 1) as f32;
        let volts = settings.converter_reference / (full + 1.0);
        let drive = Resonator::from_mode(&UpperMode::resonance(&scene.drive));
        let modes = UpperMode::fit_configured(&scene.drive, f64::from(settings.frequency));
        let upper = settings.upper_tones();
        let current_sensitivity = Some(settings.current_sensitivity).filter(|it| *it > 0.0);
        let lead = track.phase_lead();
        // The impact map moves all parts, or none if any has mass.
        let has_mass = scene.has_mass();
        let mut plant = Self {
            timeline: Timeline::new(scene),
            samples: 0,
            tone_filter: (upper > 0).then(|| ToneSeparator::new(upper)),
            waves: WaveCache::default(),
            modes: (modes.iter())
                .map(|mode| (Resonator::from_mode(mode), mode.force as f32))
                .collect(),
            drive,
            force: scene.drive.gain * 1e-3 / scene.drive.quality,
            ringing: Ringing::from_sensor(&scene.sensor),
            rest: scene.rest(),
            parts: if has_mass {
                Vec::new()
            } else {
                all_at_rest(scene)?
            },
            massive: (restitutions(scene).enumerate())
                .filter(|_| has_mass)
                .map(|(n, drawn)| Ok(MassivePart::at_rest(drawn?, scene.mass_share(n))))
                .collect::<Result<_, _>>()?,
            next_event: 0,
            any_at_rest: false,
            pressed: 0.0,
            sagged: 0.0,
            hopper: Hopper::new(scene),
            track: Track {
                normal_gravity: track.normal_gravity(),
                angular: 0.0,
                law: Some(scene.law(&track)),
                wave: None,
                contact: scene.contact_time()?,
            },
            down: track.normal_gravity() * track.incline_tangent(),
            along: [lead, 2.0 * lead, 3.0 * lead].map(|lead| {
                [libm::cos(lead), libm::sin(lead)].map(|part| part * track.amplitude_ratio())
            }),
            noise: Noise::new(scene.seed),
            output: 0.0,
            time: 0,
            step: phase_step(settings.frequency),
            codes_per_acceleration: settings.sensitivity / STANDARD_GRAVITY as f32 / volts,
            zero: settings.sensor_zero / volts,
            full,
            current_codes: scene.drive.gain / scene.drive.current_gain
                * current_sensitivity.unwrap_or(CURRENT_SENSITIVITY)
                / volts,
            last_code: (settings.sensor_zero / volts) as u16,
            mains: Phase::ZERO,
            mains_step: phase_step(scene.drive.mains),
            law: scene.law(&track),
            strikes: Vec::new(),
        };
        for index in 0..plant.massive.len() {
            if plant.hopper.arrives(index) == 0 {
                let sag = plant.sag(index);
                plant.sagged += sag;
                plant.drive.push(-sag, 0.0);
            }
        }
        Ok(plant)
    }

    /// Deflection of the spring under a part, in m.
    fn sag(&self, index: usize) -> f64 {
        let share = self.massive.get(index).map_or(0.0, |part| part.share);
        self.drive.sag(share * self.track.normal_gravity)
    }

    /// Converter reading of the next sample, after the disturbances due before it.
    #[inline]
    pub fn sample(&mut self) -> AdcCode {
        while let Some(change) = self.timeline.due(self.samples) {
            self.apply(change);
        }
        self.samples += 1;
        let noise = self.timeline.sensor.noise * self.noise.gauss();
        if self.timeline.lost {
            return AdcCode(self.last_code);
        }
        let driven = self.timeline.gain * self.output;
        let mut acceleration =
            self.drive.acceleration(driven, self.force) + self.ringing.acceleration() + noise;
        if self.pressed != 0.0 {
            acceleration -= self.pressed;
        }
        for (mode, force) in &self.modes {
            acceleration += mode.acceleration(driven, *force);
        }
        if self.rest != 0.0 {
            acceleration += self.rest;
        }
        if self.timeline.sensor.hum > 0.0 {
            acceleration += self.timeline.sensor.hum * sine_cosine_single(self.mains).0;
        }
        let sign = if self.timeline.inverted { -1.0 } else { 1.0 };
        let signal = sign * acceleration * self.timeline.sensor.sensitivity;
        let code = self.zero + signal * self.codes_per_acceleration + 0.5;
        // `clamp` may panic with both numbers, which takes 15 KiB of the emulated image.
        self.last_code = code.max(0.0).min(self.full) as u16;
        AdcCode(self.last_code)
    }

    /// Reading of the current sensor at that sample; its zero is that of the accelerometer.
    pub fn current(&self) -> AdcCode {
        let code = self.zero + self.timeline.gain * self.output * self.current_codes + 0.5;
        AdcCode(code.max(0.0).min(self.full) as u16)
    }

    /// Holds an output (-1..1) until the next sample; `step` is the advance of the drive's phase.
    #[inline]
    pub fn hold(&mut self, output: f32, step: u32) {
        let mut output = output;
        if self.timeline.ripple > 0.0 {
            output *= 1.0 + self.timeline.ripple * sine_cosine_single(self.mains + self.mains).0;
        }
        self.mains += Phase::from_bits(self.mains_step);
        self.output = output;
        self.step = step;
        let now = self.time + u64::from(step);
        let before = self.motion();
        self.drive.step(self.timeline.gain * output);
        for (mode, _) in &mut self.modes {
            mode.step(self.timeline.gain * output);
        }
        if let Some(tone_filter) = &mut self.tone_filter {
            let (modes, phase) = (all(&self.drive, &self.modes), Phase::from_bits(now as u32));
            tone_filter.step(self.timeline.gain * output, phase, step, modes);
        }
        self.ringing.step();
        self.time = now;
        let [x, v] = self.motion();
        let angular = f64::from(step) * (TAU * f64::from(SAMPLE_RATE) / Phase::TURN);
        self.track.angular = angular;
        // Downward acceleration over gravity from the harmonic motion.
        let mut pushed = f64::from(x);
        if let Some(tone_filter) = &self.tone_filter {
            let [[second, _], [third, _]] = tone_filter.motions(all(&self.drive, &self.modes));
            pushed += 3.0 * f64::from(second) + 8.0 * f64::from(third);
        }
        let lifts_off = pushed * angular * angular > self.track.normal_gravity;
        if let Law::Friction(_) = self.law
            && now >> 32 != (now - u64::from(step)) >> 32
        {
            self.slide([x, v], now);
        }
        if !self.massive.is_empty() {
            self.push_back(before, now);
        }
        if now >= self.next_event || lifts_off && self.any_at_rest {
            self.move_parts([x, v], now, lifts_off);
        }
    }

    /// Simulates the events up to `now` of the parts that move by the impact map.
    fn move_parts(&mut self, motion: [f32; 2], now: u64, lifts_off: bool) {
        (self.next_event, self.any_at_rest) = (u64::MAX, false);
        for index in 0..self.parts.len() {
            let arrives = self.hopper.arrives(index);
            if arrives > now {
                self.next_event = self.next_event.min(arrives);
                continue;
            }
            let next = self.parts[index].next();
            if next.map_or(lifts_off, |next| next <= now) {
                self.settle(index, motion, now);
            }
            match self.parts[index].next() {
                Some(next) => self.next_event = self.next_event.min(next),
                None => self.any_at_rest = true,
            }
        }
    }

    /// Moves the sliding parts once a cycle, because the amplitude changes while they lie.
    fn slide(&mut self, motion: [f32; 2], now: u64) {
        let swing = self.swing(motion, self.track.angular as f32);
        let wave = self.waves.shape(swing.shape);
        let track = Track { wave, ..self.track };
        let (phase, amplitude) = (swing.phase.radians(), swing.amplitude.into());
        for part in &mut self.parts {
            part.slide(phase, amplitude, &track, now);
        }
    }

    /// Simulates a sample of the parts with mass, after the drive moved from `before` without them.
    fn push_back(&mut self, before: [f32; 2], now: u64) {
        // Without a phase lead the frequency of a tone does not matter along the track.
        let filter = (self.tone_filter.as_ref()).filter(|_| self.along[0][1] != 0.0);
        let upper = filter.map(|filter| filter.motions(all(&self.drive, &self.modes)));
        let ground = Ground {
            sample: 1.0 / f64::from(SAMPLE_RATE),
            gravity: [self.track.normal_gravity, self.down],
            angular: self.track.angular,
            along: self.along,
            upper: upper.map(|motions| motions.map(|motion| motion.map(f64::from))),
            level: -self.sagged,
            law: self.law,
        };
        let free = self.motion().map(f64::from);
        let mut stroke = Stroke {
            from: before.map(f64::from),
            to: free,
        };
        let earlier = now.saturating_sub(u64::from(self.step));
        let onto = |hopper: &Hopper, index: usize| hopper.arrives(index) <= now;
        let parts = self.massive.iter().enumerate();
        let resting_mass: f64 = parts
            .filter(|(index, part)| part.is_on_track() && onto(&self.hopper, *index))
            .map(|(_, part)| part.share)
            .sum();
        let acceleration_without_parts = stroke.acceleration(ground.sample);
        // Equation of motion with the lying mass: M a = F - m (g + a).
        let gravity = self.track.normal_gravity;
        let pressed = (gravity + acceleration_without_parts) / (1.0 + resting_mass);
        let lifts_off = pressed <= 0.0;
        self.pressed = 0.0;
        if !lifts_off {
            let push = -resting_mass * pressed;
            stroke.to[0] += 0.5 * push * ground.sample * ground.sample;
            stroke.to[1] += push * ground.sample;
            self.pressed = -push as f32;
        }
        let accelerated = stroke.acceleration(ground.sample);
        let [.., along] = ground.along([stroke.to[0], stroke.to[1], accelerated]);
        for index in 0..self.massive.len() {
            let arrives = self.hopper.arrives(index);
            if arrives > now {
                continue;
            }
            if arrives > earlier {
                // The part falls from the track's highest position.
                let [x, v] = stroke.to;
                let swing = self.swing([(x + self.sagged) as f32, v as f32], ground.angular as f32);
                let crest = f64::from(swing.amplitude) - self.sagged;
                self.massive[index].drop_from(crest.max(x), now);
                self.sagged += self.sag(index);
                continue;
            }
            let part = &mut self.massive[index];
            if part.is_on_track() {
                if lifts_off {
                    part.leave(&ground, stroke.to, now);
                } else {
                    part.rest_on(&ground, pressed, along);
                }
                continue;
            }
            let Some(blow) = part.fall(&ground, &mut stroke, [earlier, now]) else {
                continue;
            };
            let share = (1.0 - blow.at) as f32;
            let delay = (f64::from(share) * f64::from(self.step)) as u64;
            let [x, v] = blow.track;
            let swing = self.swing([(x + self.sagged) as f32, v as f32], ground.angular as f32);
            let time = now - delay;
            // Impacts beyond the capacity are dropped.
            let _ = self.strikes.push(Strike {
                time,
                speed: blow.speed,
                phase: swing.phase.radians(),
                flight: (time.saturating_sub(blow.began) as f64 / Phase::TURN) as f32,
                part: index as u8,
                rested: blow.rested,
            });
            (self.ringing).strike(self.timeline.sensor.ringing * blow.speed as f32, share);
        }
        (self.drive).push(stroke.to[0] - free[0], stroke.to[1] - free[1]);
    }

    fn settle(&mut self, index: usize, motion: [f32; 2], now: u64) {
        let swing = self.swing(motion, self.track.angular as f32);
        let wave = self.waves.shape(swing.shape);
        let track = Track { wave, ..self.track };
        let part = &mut self.parts[index];
        if part.next().is_none() {
            part.throw(swing, &track, now);
        }
        for _ in 0..EVENTS_PER_SAMPLE {
            let Some(next) = part.next().filter(|&next| next <= now) else {
                return;
            };
            let delay = now - next;
            let then = Swing {
                phase: swing.phase - Phase::from_bits(delay as u32),
                ..swing
            };
            if let Some(strike) = part.event(then, &track) {
                let _ = self.strikes.push(Strike {
                    part: index as u8,
                    ..strike
                });
                let share = (delay as f32 / self.step as f32).min(1.0);
                (self.ringing).strike(self.timeline.sensor.ringing * strike.speed as f32, share);
            }
        }
    }

    /// The first `count` parts are on the track from now on; the others are not.
    fn place_parts(&mut self, count: u8) {
        self.next_event = 0;
        for index in usize::from(count)..self.massive.len() {
            if self.hopper.arrives(index) <= self.time {
                self.sagged -= self.sag(index);
            }
        }
        // A part with mass falls onto the track within the next sample.
        let (now, parts) = (self.time + 1, &mut self.parts);
        let arrive = |index: usize| {
            if let Some(part) = parts.get_mut(index) {
                part.rest_at(now);
            }
        };
        self.hopper.place(now, count, arrive);
    }

    /// Mass of the parts on the track over that of the track.
    pub fn load(&self) -> f64 {
        let parts = self.massive.iter().enumerate();
        let load_mass = parts.filter(|(index, _)| self.hopper.arrives(*index) <= self.time);
        load_mass.map(|(_, part)| part.share).sum()
    }

    /// Displacement of the track in m and its velocity in m/s.
    pub fn motion(&self) -> [f32; 2] {
        (self.modes.iter()).fold(self.drive.motion(), |[x, v], (mode, _)| {
            let [dx, dv] = mode.motion();
            [x + dx, v + dv]
        })
    }

    /// Swing of the track with this motion at an angular frequency in rad/s.
    fn swing(&self, [x, v]: [f32; 2], angular: f32) -> Swing {
        let Some(tone_filter) = &self.tone_filter else {
            return Swing::through([x, v], angular);
        };
        let motions = tone_filter.motions(all(&self.drive, &self.modes));
        let first = (motions.iter()).fold([x, v], |[x, v], [dx, dv]| [x - dx, v - dv]);
        Swing::through(first, angular).with(motions, angular)
    }

    /// Amplitude b of the track's first tone in m, and the shape of the motion.
    pub fn tones(&self) -> (f32, Shape) {
        let angular = f64::from(self.step) * (TAU * f64::from(SAMPLE_RATE) / Phase::TURN);
        let swing = self.swing(self.motion(), angular as f32);
        (swing.amplitude, swing.shape)
    }

    /// Present inputs of the board.
    pub fn inputs(&self) -> Inputs {
        self.timeline.inputs
    }

    /// New target of the scene, returned once.
    pub fn new_target(&mut self) -> Option<Target> {
        self.timeline.new_target()
    }

    /// Whether the supply sagged in this cycle, returned once; controller and cycle must restart.
    pub fn sagged(&mut self) -> bool {
        self.timeline.sagged()
    }

    /// Time since the start in s.
    pub fn time(&self) -> f64 {
        self.samples as f64 / f64::from(SAMPLE_RATE)
    }

    /// The cycle that ended with this report.
    pub fn moment(&self, report: Report) -> Moment {
        Moment {
            time: self.time(),
            report,
            strikes: self.strikes().len() as u32,
            displacement: self.displacement(),
            load: self.load(),
        }
    }

    /// Impacts since [`Bench::forget_strikes`], at most 96.
    pub fn strikes(&self) -> &[Strike] {
        &self.strikes
    }

    /// Clears the stored impacts.
    pub fn forget_strikes(&mut self) {
        self.strikes.clear();
    }

    /// Mean displacement of the parts along the track in m, positive upwards; 0 without parts.
    pub fn displacement(&self) -> f64 {
        if self.massive.is_empty() {
            return mean(self.parts.iter().map(|part| part.displacement));
        }
        mean(self.massive.iter().map(|part| part.displacement))
    }

    /// Applies a change beside those of the scene.
    pub fn apply(&mut self, change: Change) {
        let Some(change) = self.timeline.take(change) else {
            return;
        };
        match change {
            Change::Restitution(_) | Change::Scatter(_) => {
                let parts = self.parts.iter_mut().map(|part| &mut part.restitution);
                let massive = self.massive.iter_mut().map(|part| &mut part.restitution);
                let all = parts.chain(massive);
                all.for_each(|restitution| change_restitution(restitution, change));
            }
            Change::Dump(seconds) => {
                let step = f64::from(self.step);
                let turns = f64::from(seconds) * f64::from(SAMPLE_RATE) * step / Phase::TURN;
                self.hopper.dump(self.time, turns);
                self.next_event = 0;
            }
            Change::Parts(count) => self.place_parts(count),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The converter rounds to the nearest code: over a range of currents the mean error is 0.
    #[test]
    fn a_current_is_read_without_bias() {
        const COUNT: u16 = 1000;
        let mut scene = Scene::default();
        scene.settings.current_sensitivity = 0.1;
        let mut bench = Bench::build(&scene).unwrap();
        let mut sum = 0.0;
        for n in 0..COUNT {
            let output = 0.5 * f32::from(n) / f32::from(COUNT);
            bench.hold(output, 1 << 24);
            let exact = bench.zero + output * bench.current_codes;
            sum += f32::from(bench.current().0) - exact;
        }
        let bias = sum / f32::from(COUNT);
        // The errors are spread over a code: three standard errors of their mean.
        assert!(bench.current_codes > 100.0 && bias.abs() < 0.03, "{bias}");
    }
}
