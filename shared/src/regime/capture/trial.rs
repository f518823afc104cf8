//! Event-driven simulation of one part from rest through a kick (docs/theory-capture.md#t7.4).
//!
//! The amplitude is quasi-static: constant during each flight.

use core::f32::consts::{PI, TAU};

use super::{DriveLag, Kick, KickEnvelope};
use crate::arithmetic::{Phase, arcsine_single, sine_cosine_single};
use crate::feeder::OutOfRange;
use crate::impact::{
    ContactTime, Kernel, LIFT_OFF_DELAY, Landing, PartState, Single, SingleState, speed_gain,
};
use crate::regime::{Lock, MAX_SERIES_CHATTER_VELOCITY, chatter_duration};

/// One part on one drive, for which a kick is tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trial {
    /// k at the target amplitude, with the error of the amplitude.
    pub k: f64,
    /// Restitution of the part.
    pub restitution: f64,
    /// Requested lock order.
    pub order: u32,
    /// Duration of an impact.
    pub contact: ContactTime,
}

/// Result of a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The part is on the locked orbit at the target amplitude.
    Locked,
    /// The part rests repeatedly, or is off the orbit 60 cycles after the kick.
    Missed,
}

/// Time after the kick in cycles after which a part that is not locked counts as missed.
const MAX_CYCLES_AFTER_KICK: f32 = 60.0;

/// Amplitude over target below which rests after the kick are counted.
const MAX_COUNTED_REST_AMPLITUDE: f32 = 1.02;

/// Distance to the locked orbit, in rad and `b w`, from which orbits converge to the lock.
const LOCK_CAPTURE_DISTANCE: f32 = 0.03;

/// Resolution of the amplitude over target, in steps per unit; each new step sets the map up again.
const AMPLITUDE_STEPS: f32 = 128.0;

/// Largest k of the map, at which a part rests for ever; the kernels accept none above.
const MAX_K: f32 = 4.0;

/// Simulation state of a part that starts at rest with the kick, at phase 0 of cycle 0.
///
/// Each flight uses the amplitude at its launch, in steps of 1/128. When the amplitude changes, psi
/// is scaled by the ratio of amplitudes, so that the velocity in m/s is unchanged. A part at rest
/// leaves where `sin t = k` at the current amplitude.
#[derive(Clone, Copy, Debug)]
pub struct TrialRun {
    trial: Trial,
    /// Trial in f32, for all computations except the set-up; the board has no f64 hardware.
    k: f32,
    restitution: f32,
    contact: f32,
    contact_phase: Phase,
    /// Phase, velocity and cycles per impact of the attracting locked orbit; `None` without one.
    lock: Option<(Phase, f32, f32)>,
    envelope: KickEnvelope,
    /// Amplitude over target for which `map` is set up.
    amplitude: f32,
    map: Single,
    /// The last launch; `None` at rest.
    state: Option<SingleState>,
    /// Cycles since the start of the kick.
    time: f32,
    settled_since: Option<f32>,
    rests: u8,
    steps: u32,
    /// Number of set-ups of the map so far.
    pub(super) set_ups: u32,
}

impl TrialRun {
    /// The part of `trial` at rest, at the start of `kick` on `drive`.
    pub fn new(trial: Trial, drive: DriveLag, kick: Kick) -> Result<Self, OutOfRange> {
        Ok(Self {
            trial,
            k: trial.k as f32,
            restitution: trial.restitution as f32,
            contact: trial.contact.radians() as f32,
            contact_phase: Phase::from_radians(trial.contact.radians()),
            lock: Lock::with_contact(trial.k, trial.restitution, trial.order, trial.contact)?
                .filter(Lock::attracts)
                .map(|lock| {
                    let PartState { phase, velocity } = lock.state();
                    let phase = Phase::from_radians(phase);
                    (phase, velocity as f32, lock.order() as f32)
                }),
            envelope: KickEnvelope::new(drive, kick),
            amplitude: 1.0,
            map: Single::build(trial.k, trial.restitution)?,
            state: None,
            time: 0.0,
            settled_since: None,
            rests: 0,
            steps: 0,
            set_ups: 1,
        })
    }

    /// Number of impacts and of waits of a resting part so far.
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// Simulates one impact or one wait for the next cycle; returns the outcome once it is decided.
    pub fn simulate_impact(&mut self) -> Option<Outcome> {
        self.steps += 1;
        let Some((lock_phase, lock_velocity, order)) = self.lock else {
            return Some(Outcome::Missed);
        };
        let launch = match self.state {
            Some(state) => {
                let before = self.amplitude;
                let amplitude = self.sample_amplitude(self.time);
                self.set_amplitude(amplitude);
                Some(SingleState {
                    velocity: state.velocity * (before / self.amplitude),
                    ..state
                })
            }
            None => self.lift_off(),
        };
        let settled = self.envelope.is_settled();
        let Some(launch) = launch else {
            // A part at rest at the target amplitude remains at rest.
            return settled.then_some(Outcome::Missed);
        };
        let Landing {
            steps, mut next, ..
        } = self.map.land(launch);
        let mut flight = steps as f32 * (1.0 / Phase::TURN as f32);
        if self.contact != 0.0 {
            flight += self.contact / TAU;
            next = self.hold(next);
        }
        self.time += flight;
        self.state = Some(next);
        if settled {
            let since = *self.settled_since.get_or_insert(self.time);
            if self.time - since > MAX_CYCLES_AFTER_KICK {
                return Some(Outcome::Missed);
            }
            let steps = (next.phase - lock_phase).bits() as i32;
            let distance = steps as f32 * Phase::RADIANS_PER_STEP as f32;
            if libm::fabsf(flight - order) < 0.02
                && libm::fabsf(distance) < LOCK_CAPTURE_DISTANCE
                && libm::fabsf(next.velocity - lock_velocity) < LOCK_CAPTURE_DISTANCE
            {
                return Some(Outcome::Locked);
            }
        }
        if next.velocity < MAX_SERIES_CHATTER_VELOCITY {
            self.sum_chatter(next);
        }
        // At constant amplitude each rest leads to the same orbit, so a second rest excludes the
        // lock.
        (self.rests > 1).then_some(Outcome::Missed)
    }

    /// The launch after a contact that begins in this state; velocity 0 if the part rests.
    #[inline(never)]
    fn hold(&self, impact_state: SingleState) -> SingleState {
        let phase = impact_state.phase + self.contact_phase;
        let pull = self.k_at(self.amplitude) - sine_cosine_single(phase).0;
        let gain = speed_gain(self.restitution) * self.contact;
        let velocity = (impact_state.velocity - gain * pull).max(0.0);
        SingleState { phase, velocity }
    }

    /// Amplitude over target at `time`, rounded to the steps of the map.
    fn sample_amplitude(&mut self, time: f32) -> f32 {
        // The conversion truncates, in one FPU instruction.
        (self.envelope.amplitude(time) * AMPLITUDE_STEPS + 0.5) as i32 as f32 / AMPLITUDE_STEPS
    }

    fn set_amplitude(&mut self, amplitude: f32) {
        if amplitude == self.amplitude {
            return;
        }
        self.amplitude = amplitude;
        let k = match amplitude {
            1.0 => self.trial.k,
            _ => f64::from(self.k_at(amplitude).min(MAX_K)),
        };
        if let Ok(map) = Single::build(k, self.trial.restitution) {
            self.map = map;
            self.set_ups += 1;
        }
    }

    fn k_at(&self, amplitude: f32) -> f32 {
        self.k / amplitude
    }

    /// Sums a decaying chatter if the pull outlasts it; the part is at rest afterwards.
    fn sum_chatter(&mut self, SingleState { phase, velocity }: SingleState) {
        if velocity > 0.0 {
            let (sine, cosine) = sine_cosine_single(phase);
            let pull = self.k_at(self.amplitude) - sine;
            let Some(chatter) = chatter_duration(velocity, [pull, cosine], self.restitution) else {
                return;
            };
            self.time += chatter / TAU;
        }
        self.state = None;
        if self.envelope.is_over() && self.amplitude < MAX_COUNTED_REST_AMPLITUDE {
            self.rests += 1;
        }
    }

    /// Waits at rest for lift-off; `None` if there is none up to the next cycle.
    fn lift_off(&mut self) -> Option<SingleState> {
        let cycle = self.time as u32 as f32;
        let mut phase = (self.time - cycle) * TAU;
        let mut amplitude = 0.0;
        let mut lift_off = PI;
        // Fixed-point iteration: lift-off depends on the amplitude, which changes during the wait.
        // Three rounds reach a step of the amplitude.
        for _ in 0..3 {
            let sampled = self.sample_amplitude(cycle + phase / TAU);
            if sampled == amplitude {
                break;
            }
            amplitude = sampled;
            let k = self.k_at(amplitude);
            lift_off = if k < 1.0 { arcsine_single(k) } else { PI };
            phase = phase.max(lift_off);
        }
        phase += LIFT_OFF_DELAY as f32;
        if phase < PI - lift_off {
            self.set_amplitude(amplitude);
            self.time = cycle + phase / TAU;
            let phase = Phase::from_bits((phase * Phase::STEPS_PER_RADIAN as f32) as u32);
            let velocity = 0.0;
            return Some(SingleState { phase, velocity });
        }
        self.time = cycle + 1.0;
        None
    }
}

#[cfg(test)]
mod tests {
    use super::super::DriveLagSettings;
    use super::*;

    use crate::impact::{Map, Orbit, OrbitEvent, WaveMap};

    /// The orbit in f64 decides, at a constant amplitude.
    #[test]
    fn parts_with_contact_lock_from_rest_where_their_orbit_does() {
        let contact = ContactTime::build(0.02 * f64::from(TAU)).unwrap();
        let drive = DriveLag::build(DriveLagSettings {
            start: 1.0,
            ..DriveLagSettings::DEFAULT
        })
        .unwrap();
        let (mut locked, mut other) = (0, 0);
        for n in 0..80 {
            let k = 0.400 + 0.001 * f64::from(n);
            let trial = Trial {
                k,
                restitution: 0.2,
                order: 1,
                contact,
            };
            let mut run = TrialRun::new(trial, drive, Kick::NONE).unwrap();
            let outcome = (0..10_000).find_map(|_| run.simulate_impact());
            let is_locked = outcome == Some(Outcome::Locked);
            let lock = Lock::with_contact(k, 0.2, 1, contact).unwrap().unwrap();
            let map = WaveMap::build(k, 0.2).unwrap();
            let mut orbit = Orbit::from_rest(&map).with_contact(contact);
            let events = orbit.by_ref().take(3000);
            let last = events.filter_map(|event| match event {
                OrbitEvent::Impact(impact) => Some(impact.next),
                _ => None,
            });
            let expected = last.last().is_some_and(|state| lock.distance(state) < 1e-3);
            locked += u32::from(expected);
            other += u32::from(is_locked != expected);
        }
        // f32 decides otherwise at the edges of a basin.
        assert!((10..70).contains(&locked) && other <= 2, "{locked} {other}");
    }

    #[test]
    fn part_within_the_capture_distance_stays_on_the_orbit() {
        for (k, restitution) in [
            (0.40, 0.2),
            (0.43, 0.2),
            (0.46, 0.2),
            (0.5, 0.3),
            (0.7, 0.5),
            (0.9, 0.5),
        ] {
            let lock = Lock::build(k, restitution, 1).unwrap().unwrap();
            let map = Map::build(k, restitution).unwrap();
            for corner in 0..4 {
                let side = |bit: i32| {
                    let sign = if corner & bit == 0 { 1.0 } else { -1.0 };
                    f64::from(sign * LOCK_CAPTURE_DISTANCE)
                };
                let PartState { phase, velocity } = lock.state();
                let mut state = Map::state(phase + side(1), velocity + side(2)).unwrap();
                for _ in 0..200 {
                    state = map.impact(state).next;
                }
                assert!(lock.distance(state) < 1e-6, "{k} {restitution} {corner}");
            }
        }
    }
}
