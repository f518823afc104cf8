//! Event-driven simulation of one part: the impact map at the track's amplitude at launch.

use super::drive::Swing;
use super::law::{Law, push_of};
use core::f64::consts::{PI, TAU};
use kband::arithmetic::Phase;
use kband::impact::{
    ContactTime, Friction, Hop, Impact, Kernel, Map, PartState, Release, Scatter, Tangential, Tone,
    Wave, WaveMap,
};
use kband_control::{Shape, UpperTone};

#[derive(Clone, Copy, Debug, PartialEq)]
enum Motion {
    Resting,
    /// In flight until a time in 2^-32 turns, with arrival speed in m/s, displacement in m and
    /// velocity in m/s along the track: after the impact, and before it under friction.
    Flying {
        until: u64,
        arrival: f64,
        displacement: f64,
        along: f64,
    },
    /// In a chatter below the sensor's resolution, until rest at a time.
    Chattering(u64),
}

/// An impact of a part on the track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Strike {
    /// Time in steps of 2^-32 turns of the drive.
    pub time: u64,
    /// Arrival speed relative to the track in m/s.
    pub speed: f64,
    /// Phase of the track in rad, 0..2 pi.
    pub phase: f64,
    /// Flight before the impact, in drive periods.
    pub flight: f32,
    /// Index of the part, from 0.
    pub part: u8,
    /// Whether the flight began from rest.
    pub rested: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    pub restitution: Scatter,
    motion: Motion,
    rested: bool,
    /// Start of the flight, or of the contact before it, in 2^-32 turns of the drive.
    began: u64,
    /// Velocity along the track relative to it in m/s (symbol phi times b w).
    along: f64,
    /// Change of velocity by the last impact in m/s: momentum for the track over the part's mass.
    pub pushed: f64,
    /// Displacement along the track so far in m, positive upwards.
    pub displacement: f64,
    /// Time from which the part lies on the track, in 2^-32 turns; `None` in flight.
    rest_start: Option<u64>,
}

/// Motion of the track for the simulation of a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track<'a> {
    /// Gravity normal to the track (symbol g cos alpha) in m/s^2.
    pub normal_gravity: f64,
    /// Angular frequency of the drive in rad/s.
    pub angular: f64,
    /// Law of the motion along the track; `None` if the displacement is not computed.
    pub law: Option<Law>,
    /// Shape of the motion; `None` for a sine.
    pub wave: Option<&'a Wave>,
    pub contact: ContactTime,
}

impl Track<'_> {
    /// k of this track at an amplitude in m.
    pub fn k(&self, amplitude: f64) -> f64 {
        self.normal_gravity / (amplitude * self.angular * self.angular)
    }
}

/// Cache of the track's wave; it is rebuilt after a noticeable change.
#[derive(Clone, Copy, Debug)]
pub struct WaveCache {
    shape: Shape,
    wave: Wave,
}

/// Change of an upper tone, over the first tone's amplitude, at which the wave is rebuilt. It is a
/// tenth of the phase scatter of a locked part at a restitution scatter of 0.001.
const TONE_TOLERANCE: f32 = 2e-4;
/// Amplitude over the first tone's below which an upper tone is rounding.
const MIN_TONE_RATIO: f32 = 1e-6;

static SINE: Wave = Wave::sine();

impl Default for WaveCache {
    fn default() -> Self {
        Self {
            shape: Shape::SINE,
            wave: SINE,
        }
    }
}

impl WaveCache {
    /// Wave of this shape; `None` for a sine.
    pub fn shape(&mut self, shape: Shape) -> Option<&Wave> {
        if shape.tones().iter().all(|tone| tone.ratio < MIN_TONE_RATIO) {
            return None;
        }
        let has_changed = |(now, was): (UpperTone, UpperTone)| {
            let phase_change = (now.phase - was.phase).abs();
            (now.ratio - was.ratio).abs() > TONE_TOLERANCE
                || phase_change * now.ratio > TONE_TOLERANCE
        };
        let pairs = shape.tones().into_iter().zip(self.shape.tones());
        if pairs.into_iter().any(has_changed) {
            let [second, third] = shape.tones().map(|tone| Tone {
                // Larger ratios occur only while the first tone starts.
                amplitude: f64::from(tone.ratio.min(0.5)),
                angle: f64::from(tone.phase),
            });
            self.wave = Wave::build(second, third).ok()?;
            self.shape = shape;
        }
        Some(&self.wave)
    }
}

impl Part {
    pub fn at_rest(restitution: Scatter) -> Self {
        Self {
            restitution,
            motion: Motion::Resting,
            rested: true,
            began: 0,
            along: 0.0,
            pushed: 0.0,
            displacement: 0.0,
            rest_start: Some(0),
        }
    }

    pub fn rest_at(&mut self, time: u64) {
        self.motion = Motion::Resting;
        (self.rested, self.along, self.rest_start) = (true, 0.0, Some(time));
    }

    /// Mean restitution, at least 0; a chatter is closed with it.
    fn mean(&self) -> f64 {
        self.restitution.mean().max(0.0)
    }

    /// Map of its flights at `k`; elastic for scattered restitution, which impacts draw.
    fn map(&self, k: f64) -> Option<Map> {
        let scatters = self.restitution.deviation() > 0.0;
        let restitution = if scatters { 1.0 } else { self.mean() };
        Map::build(k, restitution).ok()
    }

    /// Whether it rests on the track or is in a silent chatter.
    pub fn is_on_track(&self) -> bool {
        !matches!(self.motion, Motion::Flying { .. })
    }

    pub fn rests(&self) -> bool {
        self.motion == Motion::Resting
    }

    /// Whether it rests and slides, or did until its next slide.
    #[inline]
    pub fn may_slide(&self) -> bool {
        self.rest_start.is_some()
    }

    /// Time of its next event, in steps of 2^-32 turns of the drive; `None` at rest.
    #[inline]
    pub fn next(&self) -> Option<u64> {
        match self.motion {
            Motion::Resting => None,
            Motion::Flying { until, .. } | Motion::Chattering(until) => Some(until),
        }
    }

    /// Throws a part at rest where the acceleration exceeds gravity; `swing` is that at `time`.
    pub fn throw(&mut self, swing: Swing, track: &Track<'_>, time: u64) -> Option<()> {
        let amplitude = f64::from(swing.amplitude);
        let k = track.k(amplitude);
        let (flight, start) = match track.wave {
            Some(wave) => Flight::from_rest_on_tones(wave, k, swing.phase.radians(), time)?,
            None => {
                let map = self.map(k)?;
                let lift_off = map.lift_off()?;
                // The launch is at arcsin k. The throw is late by up to a sample; after a search
                // for lift-off it may also be early.
                let delay = wrap_angle(swing.phase.radians() - lift_off);
                let delay = if delay > PI { delay - TAU } else { delay };
                let start = time.saturating_add_signed((-delay / TAU * Phase::TURN) as i64);
                let Release { launch, impact } = Release::build(&map, lift_off, 0.0)?;
                (Flight::on_sine(&map, launch.phase, impact), start)
            }
        };
        match track.law {
            Some(Law::Friction(_)) => self.slide(flight.phase, amplitude, track, start),
            _ => self.along = 0.0,
        }
        self.rested = true;
        self.begin_flight(&flight, amplitude, track, start);
        Some(())
    }

    /// Processes the due event; its impact, if it is one. `swing` is the track's at the event.
    pub fn event(&mut self, swing: Swing, track: &Track<'_>) -> Option<Strike> {
        let Motion::Flying {
            until: time,
            arrival,
            displacement,
            along,
        } = self.motion
        else {
            self.motion = Motion::Resting;
            return None;
        };
        self.displacement += displacement;
        self.along = along;
        // At rest it lies from now on; a flight resets this.
        self.rest_start = Some(time);
        let phase = swing.phase.radians();
        let strike = Strike {
            time,
            speed: arrival,
            phase,
            flight: (time.saturating_sub(self.began) as f64 / Phase::TURN) as f32,
            part: 0,
            rested: self.rested,
        };
        self.rested = false;
        let amplitude = f64::from(swing.amplitude);
        let k = track.k(amplitude);
        let sine = track.wave.is_none();
        let map = if sine { self.map(k) } else { None };
        if sine && map.is_none() {
            self.motion = Motion::Resting;
            return Some(strike);
        }
        // Launch speed in the present units of the track.
        let restitution = self.restitution.draw();
        let launch_speed = restitution * arrival;
        self.pushed = arrival + launch_speed;
        let unit = amplitude * track.angular;
        let velocity = launch_speed / unit;
        let mut state = PartState { phase, velocity };
        let impact_time = time;
        let mut time = time;
        let (mut impulse, mut gains) = (self.pushed, [0.0; 2]);
        if !track.contact.is_instant() {
            state = track.contact.launch(restitution, state, k, track.wave);
            let radians = track.contact.radians();
            time += (radians / TAU * Phase::TURN) as u64;
            // The state after the contact includes its friction; a resting part lies from then on.
            self.rest_start = Some(time);
            let push = (track.law).map_or(0.0, |law| law.push(track.wave, k, state.phase));
            let pull = k - push_of(track.wave, state.phase);
            impulse = arrival + (state.velocity + radians * pull) * unit;
            let free = track.contact.gain_along(restitution);
            gains = [radians - free, free].map(|gain| gain * push * unit);
        }
        self.along = match track.law {
            Some(Law::Friction(it)) => it.velocity_after_impact(along, impulse, gains),
            _ => along + gains[1],
        };
        self.displacement += 0.5 * (along + self.along) * track.contact.radians() / track.angular;
        if state.velocity == 0.0 && !track.contact.is_instant() {
            self.motion = Motion::Chattering(time);
            return Some(strike);
        }
        let Some(map) = map else {
            self.bounce_on_tones(track, state, amplitude, time);
            self.began = impact_time;
            return Some(strike);
        };
        // A chatter is closed below 8e-6 (1 + k)^(5/3) (see `Map::time_to_rest`), so faster parts
        // skip the test. With scattered restitution it is closed at the mean.
        let is_chatter = velocity < 1e-5 * (1.0 + k) * (1.0 + k);
        let closed = is_chatter.then(|| Map::build(k, self.mean()).ok()?.time_to_rest(state));
        if let Some(chatter) = closed.flatten() {
            self.correct_chatter_friction(track, launch_speed);
            self.motion = Motion::Chattering(time + (chatter / TAU * Phase::TURN) as u64);
            return Some(strike);
        }
        let impact = map.impact(state);
        if impact.flight <= 0.0 {
            self.motion = Motion::Resting;
            return Some(strike);
        }
        let flight = Flight::on_sine(&map, state.phase, impact);
        self.begin_flight(&flight, amplitude, track, time);
        self.began = impact_time;
        Some(strike)
    }

    fn bounce_on_tones(&mut self, track: &Track<'_>, state: PartState, amplitude: f64, time: u64) {
        self.motion = Motion::Resting;
        // The elastic map returns the arrival speed.
        let map = (track.wave).map(|wave| WaveMap::on(*wave, track.k(amplitude), 1.0));
        let Some(Ok(map)) = map else {
            return;
        };
        match map.hop(self.mean(), state) {
            Hop::Rest(chatter) => {
                self.correct_chatter_friction(track, state.velocity * amplitude * track.angular);
                self.motion = Motion::Chattering(time + (chatter / TAU * Phase::TURN) as u64);
            }
            Hop::Impact(impact) if impact.flight <= 0.0 => {}
            Hop::Impact(impact) => {
                let flight = Flight::on_tones(&map, state.phase, impact);
                self.begin_flight(&flight, amplitude, track, time);
            }
        }
    }

    /// Corrects the velocity along the track for a chatter, whose friction is below a contact's.
    fn correct_chatter_friction(&mut self, track: &Track<'_>, launch_speed: f64) {
        if let Some(Law::Friction(settings)) = track.law {
            self.along += settings.chatter_velocity_excess(self.along, launch_speed);
        }
    }

    /// Slides a part at rest up to `time`, with the track's phase and amplitude at that time.
    pub fn slide(&mut self, phase: f64, amplitude: f64, track: &Track<'_>, time: u64) {
        let (Some(since), Some(Law::Friction(settings))) = (self.rest_start, track.law) else {
            return;
        };
        let Some(duration) = time.checked_sub(since).filter(|duration| *duration > 0) else {
            return;
        };
        self.rest_start = Some(time);
        // A track with k above 1000 moves too little to slide a part.
        let (wave, k) = (track.wave.unwrap_or(&SINE), track.k(amplitude));
        let Ok(friction) = Friction::on(wave, k, settings) else {
            self.along = 0.0;
            return;
        };
        let duration = duration as f64 / Phase::TURN * TAU;
        let unit = amplitude * track.angular;
        let slid = friction.move_in_contact(phase - duration, duration, self.along / unit);
        self.displacement += slid.distance * amplitude;
        self.along = slid.velocity * unit;
    }

    fn begin_flight(&mut self, flight: &Flight, amplitude: f64, track: &Track<'_>, start: u64) {
        self.began = start;
        self.rest_start = None;
        let unit = amplitude * track.angular;
        let (k, phase, impact) = (flight.k, flight.phase, &flight.impact);
        let launch = PartState::new(phase, 0.0);
        let velocity = self.along / unit;
        let wave = track.wave.unwrap_or(&SINE);
        let result = match track.law {
            None => None,
            Some(Law::Friction(settings)) => Friction::on(wave, k, settings)
                .ok()
                .map(|along| along.motion_before_impact(phase, impact.flight, velocity)),
            Some(Law::Restitution(settings)) => Tangential::on(wave, k, settings)
                .ok()
                .map(|along| along.move_in_flight(launch, impact, velocity)),
        };
        let (displacement, along) = result.unwrap_or_default();
        self.motion = Motion::Flying {
            until: start + (impact.flight / TAU * Phase::TURN) as u64,
            arrival: flight.arrival * unit,
            displacement: displacement * amplitude,
            along: along * unit,
        };
    }
}

/// A flight in units of the track's motion.
struct Flight {
    k: f64,
    /// Phase of the launch in rad.
    phase: f64,
    impact: Impact<PartState>,
    /// Arrival speed in `b w` (symbol s).
    arrival: f64,
}

impl Flight {
    fn on_sine(map: &Map, phase: f64, impact: Impact<PartState>) -> Self {
        let (k, half) = (map.k(), 0.5 * impact.flight);
        let arrival = if map.restitution() > 1e-6 {
            impact.next.velocity / map.restitution()
        } else {
            // At restitution 0 the speed is that of a launch from rest.
            (k * impact.flight - 2.0 * libm::sin(phase + half) * libm::sin(half)).max(0.0)
        };
        Self {
            k,
            phase,
            impact,
            arrival,
        }
    }

    /// The flight of a part at rest at a phase (rad) and a time, and its start.
    fn from_rest_on_tones(wave: &Wave, k: f64, phase: f64, time: u64) -> Option<(Self, u64)> {
        /// Largest phase in rad by which the throw may be late: a sample at 500 Hz.
        const MAX_THROW_DELAY: f64 = 0.2;
        let map = WaveMap::on(*wave, k, 1.0).ok()?;
        let (wait, phase) = map.throw(wrap_angle(phase - MAX_THROW_DELAY))?;
        // It may also be early by this, if the amplitude changed since the search.
        if wait > 2.0 * MAX_THROW_DELAY {
            return None;
        }
        let ticks = ((wait - MAX_THROW_DELAY) / TAU * Phase::TURN) as i64;
        let Release { launch, impact } = map.release(phase)?;
        let flight = Self::on_tones(&map, launch.phase, impact);
        Some((flight, time.saturating_add_signed(ticks)))
    }

    /// Elastic flight on several tones: its launch velocity after the impact is the arrival speed.
    fn on_tones(map: &WaveMap, phase: f64, impact: Impact<PartState>) -> Self {
        Self {
            k: map.k(),
            phase,
            impact,
            arrival: impact.next.velocity,
        }
    }
}

/// `angle` in 0..2 pi.
pub(crate) fn wrap_angle(angle: f64) -> f64 {
    let wrapped = angle - TAU * libm::floor(angle / TAU);
    if wrapped < TAU { wrapped } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kband::impact::{FrictionSettings, Orbit};
    use kband::transport::{Effort, measure};

    /// Samples of a drive cycle in these runs.
    const SAMPLES: u64 = 400;

    /// Arrival speed at restitution 0 against that at 1e-5, from the same launch.
    #[test]
    fn a_dead_part_arrives_as_fast_as_a_nearly_dead_one() {
        for (k, phase, velocity) in [(0.5, 0.7, 0.6), (0.3, 1.2, 2.0), (0.8, 4.0, 1.0)] {
            let arrival = |restitution| {
                let map = Map::build(k, restitution).unwrap();
                let impact = map.impact(Map::state(phase, velocity).unwrap());
                Flight::on_sine(&map, phase, impact).arrival
            };
            // The launch adds its velocity to the speed from rest.
            let difference = arrival(1e-5) + velocity - arrival(0.0);
            assert!(difference.abs() < 1e-9, "{k}: {difference}");
        }
    }

    /// Displacement in b per cycle of a part from rest, over 600 cycles at constant amplitude.
    fn displacement_per_cycle(k: f64, law: Law, restitution: f64, contact: ContactTime) -> f64 {
        let (normal_gravity, angular) = (9.81, 314.0);
        let track = Track {
            normal_gravity,
            angular,
            law: Some(law),
            wave: None,
            contact,
        };
        let amplitude = normal_gravity / (k * angular * angular);
        let swing = |time: u64| Swing {
            amplitude: amplitude as f32,
            phase: Phase::from_bits(time as u32),
            shape: Shape::SINE,
        };
        let mut part = Part::at_rest(Scatter::build(restitution, 0.0, 1).unwrap());
        let mut begun = 0.0;
        for sample in 1..=800 * SAMPLES {
            let now = (sample << 32) / SAMPLES;
            if sample % SAMPLES == 0 {
                part.slide(swing(now).phase.radians(), amplitude, &track, now);
            }
            if part.next().is_none() && libm::sin(swing(now).phase.radians()) > k {
                part.throw(swing(now), &track, now);
            }
            while let Some(next) = part.next().filter(|next| *next <= now) {
                part.event(swing(next), &track);
            }
            if sample == 200 * SAMPLES {
                begun = part.displacement;
            }
        }
        (part.displacement - begun) / amplitude / 600.0
    }

    #[test]
    fn a_part_with_friction_goes_as_far_as_its_orbit() {
        let restitution = 0.2;
        for (throw, mu) in [(0.9, 0.3), (1.2, 0.3), (2.0, 0.1), (2.3, 0.3)] {
            let k = 1.0 / throw;
            let settings = FrictionSettings {
                sticking: mu,
                sliding: mu,
                amplitude_ratio: 1.5,
                phase_lead: 0.2,
                incline_tangent: 0.0524,
            };
            let along = Friction::build(k, settings).unwrap();
            let map = Map::build(k, restitution).unwrap();
            let effort = Effort {
                settle: 1000,
                impacts: 3000,
            };
            for contact in [0.0, 0.12].map(|c| ContactTime::build(c).unwrap()) {
                let orbit = Orbit::from_rest(&map).with_contact(contact);
                let surveyed = measure(orbit, along, effort, &mut ()).conveyed;
                let expected = surveyed.time_mean().unwrap() * TAU;
                let actual =
                    displacement_per_cycle(k, Law::Friction(settings), restitution, contact);
                // Errors: the amplitude has f32 precision, a throw is timed to a sample.
                let error = (actual / expected - 1.0).abs();
                assert!(error < 2e-3, "{throw} {contact:?}: {actual} {expected}");
            }
        }
    }
}
