//! Capture: kicks that bring parts onto the requested orbit (docs/theory-capture.md#t7.3).
//!
//! A token bucket (leaky bucket as a meter: Turner 1986) limits the rate of kicks.
//!
//! A sequential probability ratio test (Wald, Ann. Math. Stat. 16, 1945, 117) stops the kicks for
//! parts outside the lot. A kick misses a part with the probability of the plan, or always.

use super::machine::{LOCK_CONFIDENCE, LOST_CONFIDENCE};
use crate::Event;
use kband::regime::capture::{Kick, Plan};

/// Predicted share of captured parts below which a plan is called uncertain.
const MIN_CAPTURED_SHARE: f64 = 0.95;
/// Kicks per hour that the token bucket gains: 60 in an hour take 2.7 % of the time at 50 Hz.
const KICKS_PER_HOUR: f32 = 40.0;
/// Largest number of saved kicks: two complete captures in a row.
const MAX_SAVED_KICKS: f32 = 20.0;
/// Largest probability that the kicks miss parts of the lot (false alarm rate).
const MAX_MISS_PROBABILITY: f64 = 1e-3;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stage {
    Idle,
    Planning,
    Ready,
    /// In the kick's n-th cycle.
    Kicking(Kick, u32),
    /// Testing for the lock after a kick; number of cycles with a settled amplitude so far.
    Judging(u32),
}

/// Settled cycles at the setpoint after which a kick counts as failed, as in the plan's simulation.
const LOCK_TEST_CYCLES: u32 = 60;

#[derive(Clone, Copy, Debug)]
pub struct Capture {
    stage: Stage,
    pub attempts: u8,
    allowed: u8,
    /// Probability by the plan of as many misses as there were.
    miss_probability: f64,
    /// Kicks in the token bucket, and kicks gained per cycle.
    tokens: f32,
    tokens_per_cycle: f32,
}

impl Capture {
    /// A capture of at most `allowed` kicks, 60 in an hour; `rate` in cycles per second.
    pub fn new(allowed: u8, rate: f32) -> Self {
        Self {
            stage: Stage::Idle,
            attempts: 0,
            allowed,
            miss_probability: 1.0,
            tokens: MAX_SAVED_KICKS,
            tokens_per_cycle: KICKS_PER_HOUR / (3600.0 * rate),
        }
    }

    pub fn begin(&mut self) {
        (self.attempts, self.miss_probability) = (0, 1.0);
        self.stage = Stage::Planning;
    }

    pub fn count(&mut self) {
        self.tokens = (self.tokens + self.tokens_per_cycle).min(MAX_SAVED_KICKS);
    }

    pub fn stop(&mut self) {
        self.stage = Stage::Idle;
    }

    /// Amplitude of the next cycle over the setpoint.
    pub fn command(&self) -> f32 {
        match self.stage {
            Stage::Kicking(kick, cycle) => kick.command(cycle),
            _ => 1.0,
        }
    }

    /// Advances one cycle. `lock`: confidence that the parts are locked; `settled`: the amplitude is
    /// back at the setpoint. `NotCaptured`: no attempt is left, or the misses are improbable.
    pub fn cycle(&mut self, plan: Option<&Plan>, lock: f32, settled: bool) -> Option<Event> {
        match self.stage {
            Stage::Idle => None,
            Stage::Planning => {
                let best = plan?.best();
                self.stage = Stage::Ready;
                if best.is_some_and(|best| best.share() >= MIN_CAPTURED_SHARE) {
                    Some(Event::KickPlanned)
                } else {
                    Some(Event::KickUncertain)
                }
            }
            Stage::Ready => self.next(plan),
            Stage::Kicking(kick, cycle) => {
                if cycle + 1 < kick.length() {
                    self.stage = Stage::Kicking(kick, cycle + 1);
                    None
                } else {
                    self.stage = Stage::Judging(0);
                    Some(Event::KickEnded)
                }
            }
            Stage::Judging(_) if lock >= LOCK_CONFIDENCE && settled => {
                self.stage = Stage::Idle;
                Some(Event::Locked)
            }
            Stage::Judging(cycle) if cycle < LOCK_TEST_CYCLES => {
                self.stage = Stage::Judging(cycle + u32::from(settled));
                None
            }
            Stage::Judging(_) => {
                // Few locked parts are the evidence of a kick that missed.
                if let Some(plan) = plan.filter(|_| lock < LOST_CONFIDENCE) {
                    let attempt = u32::from(self.attempts).saturating_sub(1);
                    self.miss_probability *= plan.miss_probability(attempt);
                }
                self.next(plan)
            }
        }
    }

    fn next(&mut self, plan: Option<&Plan>) -> Option<Event> {
        let kick = plan
            .and_then(|plan| plan.attempt(u32::from(self.attempts)))
            .filter(|_| self.attempts < self.allowed && self.tokens >= 1.0)
            .filter(|_| self.miss_probability > MAX_MISS_PROBABILITY);
        let Some(kick) = kick else {
            self.stage = Stage::Idle;
            return Some(Event::NotCaptured);
        };
        self.attempts += 1;
        self.tokens -= 1.0;
        self.stage = Stage::Kicking(kick, 0);
        Some(Event::KickBegun)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::lot;
    use crate::{Controller, StartCause, Target};

    #[test]
    fn plan_that_captures_less_than_95_percent_is_uncertain() {
        for (low, high, sure) in [(0.18, 0.22, true), (0.48, 0.52, false)] {
            let (settings, target) = (lot(low, high), Target::Locked { order: 1 });
            let mut controller =
                Controller::build(&settings, target, StartCause::Ordinary).unwrap();
            while controller.plan_step() {}
            let plan = controller.planned().unwrap().plan;
            let share = plan.best().unwrap().share();
            assert!((0.35..0.95).contains(&share) != sure, "{low}: {share}");
            let mut capture = Capture::new(8, 50.0);
            capture.begin();
            let event = capture.cycle(Some(&plan), 0.0, true);
            assert_eq!(event == Some(Event::KickPlanned), sure, "{low}");
            assert_eq!(event == Some(Event::KickUncertain), !sure, "{low}");
        }
    }
}
