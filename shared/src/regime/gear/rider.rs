//! One part followed on one track in single precision.

use super::Gear;
use super::draw::Draw;
use crate::arithmetic::{Phase, sine_cosine_single};
use crate::impact::{Kernel, LATE, Single, SingleState};

/// A flight and how fast it ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flown {
    /// Its duration in steps of 2^-32 turns of the drive; 0 where the part stays.
    pub steps: i64,
    /// Arrival speed (symbol s) in `b w`.
    pub arrival: f32,
}

/// A track in single precision, as a part that is followed on it meets it.
pub trait Surface: Copy {
    /// The flight of a part that leaves at a phase with a velocity in `b w`.
    fn flight(&self, phase: Phase, velocity: f32) -> Flown;

    /// How much gravity exceeds the track's downward acceleration at a phase (symbol k - A), and the slope of that
    /// acceleration.
    fn pull(&self, phase: Phase) -> (f32, f32);

    /// Steps of the phase until the track throws a part that rests at a phase; `None` where it never does.
    fn wait(&self, phase: Phase) -> Option<u32>;
}

/// A track of one tone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OneTone {
    map: Single,
    k: f32,
    /// Where a part at rest leaves, and the steps from there to where none leaves any more; no steps where k is 1 or
    /// more.
    lift_off: u32,
    hump: u32,
}

impl OneTone {
    /// The track at a k in 0.005..=4; `None` outside.
    pub fn at(k: f32) -> Option<Self> {
        let wide = f64::from(k);
        // Restitution 1: what is left of the arrival speed is the part's own affair.
        let map = Single::build(wide, 1.0).ok()?;
        let (lift_off, hump) = if wide < 1.0 {
            let angle = libm::asin(wide) + LATE;
            let lift_off = Phase::from_radians(angle).bits();
            (lift_off, (1_u32 << 31).saturating_sub(2 * lift_off))
        } else {
            (0, 0)
        };
        Some(Self {
            map,
            k,
            lift_off,
            hump,
        })
    }
}

impl Surface for OneTone {
    #[inline]
    fn flight(&self, phase: Phase, velocity: f32) -> Flown {
        let landing = self.map.land(SingleState { phase, velocity });
        Flown {
            steps: landing.steps,
            arrival: landing.next.velocity,
        }
    }

    #[inline]
    fn pull(&self, phase: Phase) -> (f32, f32) {
        let (sine, cosine) = sine_cosine_single(phase);
        (self.k - sine, cosine)
    }

    #[inline]
    fn wait(&self, phase: Phase) -> Option<u32> {
        if self.hump == 0 {
            return None;
        }
        let since = phase.bits().wrapping_sub(self.lift_off);
        Some(if since < self.hump {
            0
        } else {
            since.wrapping_neg()
        })
    }
}

/// Velocity in `b w` below which a chatter is closed to rest by its series.
const CHATTER: f32 = 0.01;

/// What a part that is thrown into no flight waits, in steps of 2^-32 turns: 1.5e-3 rad.
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
    /// At rest, to be followed for a span with a gear that was never in.
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

    /// The share of the time that counts in which it was in gear, 0..=1.
    pub fn share(&self) -> f32 {
        let watched = self.span.end - self.span.begin;
        self.in_gear as f32 / watched as f32
    }

    /// One flight, and the rest before it; whether the end is reached.
    pub fn step(&mut self, surface: &impl Surface) -> bool {
        if self.rests {
            let Some(wait) = surface.wait(self.phase) else {
                return true;
            };
            self.go_on(i64::from(wait));
            self.velocity = 0.0;
            self.rests = false;
        }
        let flown = surface.flight(self.phase, self.velocity);
        if flown.steps <= 0 {
            // A hop of no step: it stays, and time goes on.
            self.rest();
            self.go_on(STAYS);
            return self.time >= self.span.end;
        }
        self.go_on(flown.steps);
        let added = self.gear.flight(flown.steps);
        let from = (self.time - added).max(self.span.begin);
        self.in_gear += (self.time.min(self.span.end) - from).max(0);
        self.velocity = flown.arrival * self.draw.draw();
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
    fn close(&mut self, surface: &impl Surface) {
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
