//! One part followed on one track in single precision.

use super::Gear;
use super::draw::Draw;
use crate::arithmetic::{Phase, sine_cosine_single};
use crate::feeder::OutOfRange;
use crate::impact::{LATE, Landing, SingleState, Tone, WaveKernel, WaveSingle};

/// The second and the third tone, each as its amplitude over the first (symbol e) and its angle (symbol th) in rad.
pub type Tones = [[f32; 2]; 2];

/// A track in single precision, as a part that is followed on it meets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    map: WaveSingle,
    k: f32,
    /// Amplitudes of the tones above the first, and their angles.
    ratios: [f32; 2],
    angles: [Phase; 2],
}

impl Surface {
    /// The track of these tones at a k; the refusal names what is out of range.
    pub fn at(k: f32, tones: Tones) -> Result<Self, OutOfRange> {
        let built = tones.map(|[ratio, angle]| Tone {
            amplitude: f64::from(ratio),
            angle: f64::from(angle),
        });
        Ok(Self {
            map: WaveSingle::on_tones(built, f64::from(k), 1.0)?,
            k,
            ratios: tones.map(|[ratio, _]| ratio),
            angles: tones.map(|[_, angle]| Phase::from_radians(f64::from(angle))),
        })
    }

    /// How much gravity exceeds the track's downward acceleration at a phase (symbol k - A), and the slope of that
    /// acceleration.
    #[inline]
    fn pull(&self, phase: Phase) -> (f32, f32) {
        let (sine, cosine) = sine_cosine_single(phase);
        let ([second, third], [of_second, of_third]) = (self.ratios, self.angles);
        if second == 0.0 {
            return (self.k - sine, cosine);
        }
        let tone = |times: u32, angle: Phase| {
            sine_cosine_single(Phase::from_bits(phase.bits().wrapping_mul(times)) + angle)
        };
        let (push, slope) = tone(2, of_second);
        let mut pushed = sine + 4.0 * second * push;
        let mut surge = cosine + 8.0 * second * slope;
        if third > 0.0 {
            let (push, slope) = tone(3, of_third);
            pushed += 9.0 * third * push;
            surge += 27.0 * third * slope;
        }
        (self.k - pushed, surge)
    }

    /// Steps of the phase until the track throws a part that rests at a phase; `None` where it never does.
    #[inline]
    fn wait(&self, phase: Phase) -> Option<u32> {
        if self.map.throws(phase) {
            return Some(0);
        }
        let lift_off = self.map.lift_off(phase)?;
        Some((lift_off - phase).bits().wrapping_add(AFTER))
    }
}

/// A lift-off is taken so much after it began, in steps of 2^-32 turns, as in every arithmetic coarser than f64.
const AFTER: u32 = (LATE * Phase::STEPS_PER_RADIAN) as u32;

/// Velocity in `b w` below which a chatter is closed to rest by its series. From 1e-3 to 0.1 every test passes.
const CHATTER: f32 = 0.01;

/// Wait of a part whose throw leads to no flight, in steps of 2^-32 turns: 1.5e-3 rad. From an eighth to eight
/// times of it every test passes.
const STAYS: i64 = 1 << 20;

/// Steps of a phase in a radian.
const STEPS_PER_RADIAN: f32 = Phase::STEPS_PER_RADIAN as f32;

/// How long a part is followed, in steps of 2^-32 turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// From when on the time in gear counts.
    pub begin: i64,
    /// The end.
    pub end: i64,
}

impl Span {
    /// So many drive periods, of which the first ones do not count.
    pub fn periods(all: u16, before: u16) -> Self {
        Self {
            begin: i64::from(before) << 32,
            end: i64::from(all) << 32,
        }
    }
}

/// An impact of a part that is followed.
#[derive(Clone, Copy, Debug)]
pub struct FollowedImpact {
    launch: SingleState,
    /// Phase of the track.
    pub phase: Phase,
    restitution: f32,
    velocity: f32,
    /// The flight that it ended, in steps of 2^-32 turns.
    pub steps: i64,
    /// Whether the part lay on the track before that flight.
    pub rested: bool,
    /// Whether the part is in gear.
    pub in_gear: bool,
}

impl FollowedImpact {
    /// Speed of arrival in `b w`.
    pub fn speed(&self, surface: &Surface) -> f32 {
        if self.restitution > TELLS {
            return self.velocity / self.restitution;
        }
        surface.map.land_at(self.launch, 1.0).next.velocity
    }

    /// The track's downward acceleration (symbol A) where the flight that it ended began.
    pub fn bend(&self, surface: &Surface) -> f32 {
        surface.k - surface.pull(self.launch.phase).0
    }
}

/// Restitution from which on the speed of arrival follows from that of the launch: below, rounding would tell.
const TELLS: f32 = 0.01;

/// A part that begins at rest at phase 0 and whose restitution scatters.
#[derive(Clone, Copy, Debug)]
pub struct Rider {
    draw: Draw,
    gear: Gear<i64>,
    span: Span,
    phase: Phase,
    velocity: f32,
    rests: bool,
    time: i64,
    in_gear: i64,
}

impl Rider {
    /// At rest, with the span for which it is followed and a gear that it has not been in yet.
    pub fn new(draw: Draw, gear: Gear<i64>, span: Span) -> Self {
        Self {
            draw,
            gear,
            span,
            phase: Phase::ZERO,
            velocity: 0.0,
            rests: true,
            time: 0,
            in_gear: 0,
        }
    }

    /// Just thrown from a phase with a velocity over the track's, in `b w`.
    pub fn thrown(self, phase: Phase, velocity: f32) -> Self {
        Self {
            phase,
            velocity,
            rests: false,
            ..self
        }
    }

    /// Time followed so far, in steps of 2^-32 turns.
    pub fn time(&self) -> i64 {
        self.time
    }

    /// The share of the time that counts in which it was in gear, 0..=1.
    pub fn share(&self) -> f32 {
        let watched = self.span.end - self.span.begin;
        self.in_gear as f32 / watched as f32
    }

    /// One flight, and the rest before it; whether the end is reached.
    #[inline]
    pub fn step(&mut self, surface: &Surface) -> bool {
        self.step_heard(surface, |_| {})
    }

    /// As [`Rider::step`]; `heard` is told the impact that ended the flight.
    #[inline]
    pub fn step_heard(&mut self, surface: &Surface, heard: impl FnOnce(FollowedImpact)) -> bool {
        let rested = self.rests;
        if rested {
            let Some(wait) = surface.wait(self.phase) else {
                return true;
            };
            self.go_on(i64::from(wait));
            self.velocity = 0.0;
            self.rests = false;
        }
        let launch = SingleState {
            phase: self.phase,
            velocity: self.velocity,
        };
        let restitution = self.draw.draw();
        let Landing { steps, next, .. } = surface.map.land_at(launch, restitution);
        if steps <= 0 {
            // A hop shorter than a step of time: it stays where it is, and time goes on.
            self.rest();
            self.go_on(STAYS);
            return self.time >= self.span.end;
        }
        self.go_on(steps);
        let added = self.gear.flight(steps);
        let from = (self.time - added).max(self.span.begin);
        self.in_gear += (self.time.min(self.span.end) - from).max(0);
        self.velocity = next.velocity;
        heard(FollowedImpact {
            launch,
            phase: self.phase,
            restitution,
            velocity: next.velocity,
            steps,
            rested,
            in_gear: self.gear.is_in(),
        });
        if self.velocity < CHATTER {
            self.close(surface);
        }
        self.time >= self.span.end
    }

    fn go_on(&mut self, steps: i64) {
        self.time += steps;
        self.phase = Phase::from_bits(self.phase.bits().wrapping_add(steps as u32));
    }

    fn rest(&mut self) {
        self.rests = true;
        self.gear.rest();
    }

    /// Sums the chatter of a slow part whose pull outlasts it (as [`Follow`](crate::regime::capture::Follow) does), and
    /// leaves it at rest.
    fn close(&mut self, surface: &Surface) {
        let (pull, slope) = surface.pull(self.phase);
        let x = 2.0 * self.velocity / (pull * (1.0 - self.draw.mean()));
        if pull <= 0.0 || x * slope.abs() > 0.1 * pull {
            return;
        }
        let duration = x * (1.0 + x * slope / (3.0 * pull));
        self.go_on((duration * STEPS_PER_RADIAN) as i64);
        self.rest();
    }
}
