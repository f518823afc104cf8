//! Event-driven simulation of one part on one track, in single precision: flights by the impact
//! map, rests in closed form.
//!
//! Equations: docs/theory-impacts.md#t2 (impact map), #t4.1 (chatter), #t4.2 (lift-off).

use super::GearDetector;
use super::draw::Draw;
use crate::arithmetic::{Phase, sine_cosine_single};
use crate::feeder::OutOfRange;
use crate::impact::{LIFT_OFF_DELAY, Landing, Single, SingleState, Tone, WaveKernel, speed_gain};
use crate::regime::{MAX_SERIES_CHATTER_VELOCITY, chatter_duration};

/// Second and third tone: amplitude over the first (symbol e) and angle in rad (symbol th) of each.
pub type Tones = [[f32; 2]; 2];

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpperTones {
    pub ratios: [f32; 2],
    angles: [Phase; 2],
}

impl UpperTones {
    /// Rounds the angles to steps of a phase.
    pub fn new(tones: Tones) -> Self {
        Self {
            ratios: tones.map(|[ratio, _]| ratio),
            angles: tones.map(|[_, angle]| Phase::from_radians(f64::from(angle))),
        }
    }

    /// Sine and cosine of the second tone at a phase of the first.
    #[inline]
    pub fn second(&self, phase: Phase) -> (f32, f32) {
        sine_cosine_single(Phase::from_bits(phase.bits().wrapping_mul(2)) + self.angles[0])
    }

    /// The same of the third tone.
    #[inline]
    pub fn third(&self, phase: Phase) -> (f32, f32) {
        sine_cosine_single(Phase::from_bits(phase.bits().wrapping_mul(3)) + self.angles[1])
    }
}

/// Motion of the track and its impact map, in single precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackMap {
    single: Single,
    k: f32,
    pub upper: UpperTones,
    /// Duration of an impact in rad, and in steps of 2^-32 turns.
    contact: f32,
    contact_steps: u32,
}

impl TrackMap {
    /// Builds the track from k and tones; an error names the parameter out of range.
    pub fn build(k: f32, tones: Tones) -> Result<Self, OutOfRange> {
        let built = tones.map(|[ratio, angle]| Tone::new(f64::from(ratio), f64::from(angle)));
        Ok(Self {
            single: Single::on_tones(built, f64::from(k), 1.0)?,
            k,
            upper: UpperTones::new(tones),
            contact: 0.0,
            contact_steps: 0,
        })
    }

    /// The same track with impacts of this duration in rad.
    pub fn with_contact(self, contact: f32) -> Self {
        Self {
            contact,
            contact_steps: (contact * Phase::STEPS_PER_RADIAN as f32) as u32,
            ..self
        }
    }

    /// Pull `k - A` towards the track at a phase, and the slope of the acceleration A.
    #[inline]
    pub fn pull(&self, phase: Phase) -> (f32, f32) {
        let (sine, cosine) = sine_cosine_single(phase);
        let [second, third] = self.upper.ratios;
        if second == 0.0 {
            return (self.k - sine, cosine);
        }
        let (push, slope) = self.upper.second(phase);
        let mut acceleration = sine + 4.0 * second * push;
        let mut jerk = cosine + 8.0 * second * slope;
        if third > 0.0 {
            let (push, slope) = self.upper.third(phase);
            acceleration += 9.0 * third * push;
            jerk += 27.0 * third * slope;
        }
        (self.k - acceleration, jerk)
    }

    /// One flight and its impact. On the board a copy for each caller takes 4 KiB of flash.
    #[cfg_attr(target_arch = "arm", inline(never))]
    #[cfg_attr(not(target_arch = "arm"), inline(always))]
    fn land(&self, launch: SingleState, restitution: f32) -> Landing<SingleState> {
        self.single.land_at(launch, restitution)
    }

    /// Delay in steps of 2^-32 turns until lift-off of a part at rest; `None` without lift-off.
    #[inline]
    fn wait_to_lift_off(&self, phase: Phase) -> Option<u32> {
        if self.single.throws(phase) {
            return Some(0);
        }
        let lift_off = self.single.lift_off(phase)?;
        Some((lift_off - phase).bits().wrapping_add(LAUNCH_DELAY_STEPS))
    }
}

/// Delay of a launch after lift-off, in steps of 2^-32 turns; f64 needs none.
const LAUNCH_DELAY_STEPS: u32 = (LIFT_OFF_DELAY * Phase::STEPS_PER_RADIAN) as u32;

/// Delay after a launch without a flight, in steps of 2^-32 turns; 1.5e-3 rad.
const NO_FLIGHT_DELAY_STEPS: i64 = 1 << 20;

/// Simulated time, in steps of 2^-32 turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    pub begin: i64,
    pub end: i64,
}

impl Span {
    /// A span of `all` drive periods, the first `before` of which are not counted.
    pub fn from_periods(all: u16, before: u16) -> Self {
        let [begin, end] = [before, all].map(|periods| i64::from(periods) << 32);
        Self { begin, end }
    }
}

#[derive(Clone, Copy, Debug)]
pub struct SimulatedImpact {
    launch: SingleState,
    /// Phase of the drive at which the part touches the track.
    pub phase: Phase,
    restitution: f32,
    velocity: f32,
    /// Flight before the impact with the contact, in steps of 2^-32 turns.
    pub steps: i64,
    pub from_rest: bool,
    pub in_gear: bool,
}

impl SimulatedImpact {
    /// Arrival speed in `b w`.
    pub fn arrival_speed(&self, map: &TrackMap) -> f32 {
        if self.restitution > MIN_RESTITUTION_FOR_DIVISION {
            return self.velocity / self.restitution;
        }
        map.land(self.launch, 1.0).next.velocity
    }

    /// Downward acceleration of the track (symbol A) at the launch of the flight.
    pub fn launch_acceleration(&self, map: &TrackMap) -> f32 {
        map.k - map.pull(self.launch.phase).0
    }
}

/// Smallest restitution by which a launch speed is divided; below it rounding dominates.
const MIN_RESTITUTION_FOR_DIVISION: f32 = 0.01;

/// Simulation state of one part with scattered restitution; it starts at rest at phase 0.
#[derive(Clone, Copy, Debug)]
pub struct SimulatedPart {
    draw: Draw,
    gear: GearDetector<i64>,
    span: Span,
    phase: Phase,
    velocity: f32,
    is_at_rest: bool,
    /// Simulated time so far, in steps of 2^-32 turns.
    pub time: i64,
    in_gear: i64,
}

impl SimulatedPart {
    /// A part at rest, for a time span, with a gear detector in its initial state.
    pub fn new(draw: Draw, gear: GearDetector<i64>, span: Span) -> Self {
        Self {
            draw,
            gear,
            span,
            phase: Phase::ZERO,
            velocity: 0.0,
            is_at_rest: true,
            time: 0,
            in_gear: 0,
        }
    }

    /// Starts in flight instead, at a phase with a launch velocity in `b w` over the track's.
    pub fn with_launch(self, phase: Phase, velocity: f32) -> Self {
        Self {
            phase,
            velocity,
            is_at_rest: false,
            ..self
        }
    }

    pub fn share(&self) -> f32 {
        self.in_gear as f32 / (self.span.end - self.span.begin) as f32
    }

    /// Simulates one flight, with a rest before it, and returns whether the end is reached. Passes
    /// the impact that ended the flight to `record`.
    #[inline]
    pub fn simulate_flight(
        &mut self,
        map: &TrackMap,
        record: impl FnOnce(SimulatedImpact),
    ) -> bool {
        let rested = self.is_at_rest;
        if rested {
            let Some(wait) = map.wait_to_lift_off(self.phase) else {
                return true;
            };
            self.advance_time(i64::from(wait));
            self.velocity = 0.0;
            self.is_at_rest = false;
        }
        let (phase, velocity) = (self.phase, self.velocity);
        let launch = SingleState { phase, velocity };
        let restitution = self.draw.draw();
        let Landing { steps, next, .. } = map.land(launch, restitution);
        if steps <= 0 {
            // The hop is shorter than one step of time: the part rests, and time advances.
            self.begin_rest();
            self.advance_time(NO_FLIGHT_DELAY_STEPS);
            return self.time >= self.span.end;
        }
        self.advance_time(steps);
        let (phase, steps) = (self.phase, steps + i64::from(map.contact_steps));
        if map.contact_steps > 0 {
            self.advance_time(map.contact_steps.into());
        }
        let added = self.gear.add_flight(steps);
        let from = (self.time - added).max(self.span.begin);
        self.in_gear += (self.time.min(self.span.end) - from).max(0);
        self.velocity = next.velocity;
        record(SimulatedImpact {
            launch,
            phase,
            restitution,
            velocity: next.velocity,
            steps,
            from_rest: rested,
            in_gear: self.gear.is_in_gear(),
        });
        if map.contact_steps > 0 {
            self.end_contact(map, restitution);
            if self.is_at_rest {
                return self.time >= self.span.end;
            }
        }
        if self.velocity < MAX_SERIES_CHATTER_VELOCITY {
            self.sum_chatter(map);
        }
        self.time >= self.span.end
    }

    /// Launch speed at the end of the contact; a part without one rests.
    #[inline(never)]
    fn end_contact(&mut self, map: &TrackMap, restitution: f32) {
        self.velocity -= speed_gain(restitution) * map.contact * map.pull(self.phase).0;
        if self.velocity <= 0.0 {
            self.begin_rest();
        }
    }

    fn advance_time(&mut self, steps: i64) {
        self.time += steps;
        self.phase = Phase::from_bits(self.phase.bits().wrapping_add(steps as u32));
    }

    fn begin_rest(&mut self) {
        self.is_at_rest = true;
        self.gear.add_rest();
    }

    /// Sums a decaying chatter if the pull outlasts it; the part is at rest afterwards.
    fn sum_chatter(&mut self, map: &TrackMap) {
        let (pull, slope) = map.pull(self.phase);
        if let Some(chatter) = chatter_duration(self.velocity, [pull, slope], self.draw.mean) {
            self.advance_time((chatter * Phase::STEPS_PER_RADIAN as f32) as i64);
            self.begin_rest();
        }
    }
}
