//! Capture: kicks that bring parts onto the wanted orbit, one attempt after the other
//! (docs/theory-capture.md#t7.3).
//!
//! A token bucket (leaky bucket as a meter: Turner 1986) limits the rate of kicks: a kick and its
//! test need 80 cycles, in which the parts are conveyed worse.
//!
//! A sequential probability ratio test (Wald, Ann. Math. Stat. 16, 1945, 117) stops the kicks of
//! parts outside the lot: a kick misses a part with the probability of the plan, or always.

use kband::regime::capture::{Kick, Plan};

/// Predicted share of captured parts below which a plan is called uncertain.
const MIN_CAPTURED_SHARE: f64 = 0.95;

/// Kicks per hour that the token bucket gains: 60 in an hour cost 2.7 % of the time at 50 Hz.
const KICKS_PER_HOUR: f32 = 40.0;
/// Largest number of saved kicks: two complete captures in a row.
const MAX_SAVED_KICKS: f32 = 20.0;

/// Largest probability that the kicks miss parts of the lot (false alarm rate).
const MAX_MISS_PROBABILITY: f64 = 1e-3;

/// Stage of a capture.
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

/// Cycles after a kick, at the setpoint's amplitude, before it failed: as the plan simulates.
const LOCK_TEST_CYCLES: u32 = 60;

/// The attempts at capturing the parts.
#[derive(Clone, Copy, Debug)]
pub struct Capture {
    stage: Stage,
    pub attempts: u8,
    allowed: u8,
    /// Probability of the plan that kicks miss as often as they did.
    miss_probability: f64,
    /// Kicks in the token bucket, and kicks gained per cycle.
    tokens: f32,
    tokens_per_cycle: f32,
}

/// The wanted lock, as detected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DetectedLock {
    /// Of all parts.
    All,
    /// Of most parts.
    Most,
    /// Of few parts or none: the evidence of a kick that missed.
    Few,
}

/// Event of the capture in a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CaptureEvent {
    /// The plan is ready.
    Planned {
        /// Whether its best kick captures all but one part in twenty.
        sure: bool,
    },
    Begun,
    /// The kick is over and the test for the lock begins.
    Ended,
    Captured,
    /// The attempts of this capture or of the hour are used up, or the misses improbable.
    Failed,
}

impl Capture {
    /// A capture of at most `allowed` kicks, 60 in an hour; `pace` in cycles per second.
    pub fn new(allowed: u8, pace: f32) -> Self {
        Self {
            stage: Stage::Idle,
            attempts: 0,
            allowed,
            miss_probability: 1.0,
            tokens: MAX_SAVED_KICKS,
            tokens_per_cycle: KICKS_PER_HOUR / (3600.0 * pace),
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

    /// Advances one cycle. `settled`: the amplitude is back at the setpoint.
    pub fn cycle(
        &mut self,
        plan: Option<&Plan>,
        lock: DetectedLock,
        settled: bool,
    ) -> Option<CaptureEvent> {
        match self.stage {
            Stage::Idle => None,
            Stage::Planning => match plan {
                Some(plan) => {
                    self.stage = Stage::Ready;
                    Some(CaptureEvent::Planned {
                        sure: (plan.best()).is_some_and(|best| best.share() >= MIN_CAPTURED_SHARE),
                    })
                }
                None => None,
            },
            Stage::Ready => self.next(plan),
            Stage::Kicking(kick, cycle) => {
                if cycle + 1 < kick.length() {
                    self.stage = Stage::Kicking(kick, cycle + 1);
                    None
                } else {
                    self.stage = Stage::Judging(0);
                    Some(CaptureEvent::Ended)
                }
            }
            Stage::Judging(_) if lock == DetectedLock::All && settled => {
                self.stage = Stage::Idle;
                Some(CaptureEvent::Captured)
            }
            Stage::Judging(cycle) if cycle < LOCK_TEST_CYCLES => {
                self.stage = Stage::Judging(cycle + u32::from(settled));
                None
            }
            Stage::Judging(_) => {
                if let (DetectedLock::Few, Some(plan)) = (lock, plan) {
                    let attempt = u32::from(self.attempts).saturating_sub(1);
                    self.miss_probability *= plan.miss_probability(attempt);
                }
                self.next(plan)
            }
        }
    }

    fn next(&mut self, plan: Option<&Plan>) -> Option<CaptureEvent> {
        let kick = plan
            .and_then(|plan| plan.attempt(u32::from(self.attempts)))
            .filter(|_| self.attempts < self.allowed && self.tokens >= 1.0)
            .filter(|_| self.miss_probability > MAX_MISS_PROBABILITY);
        let Some(kick) = kick else {
            self.stage = Stage::Idle;
            return Some(CaptureEvent::Failed);
        };
        self.attempts += 1;
        self.tokens -= 1.0;
        self.stage = Stage::Kicking(kick, 0);
        Some(CaptureEvent::Begun)
    }
}

#[cfg(test)]
mod tests {
    use core::task::Poll;

    use super::*;
    use kband::feeder::Restitution;
    use kband::impact::ContactTime;
    use kband::regime::band::Band;
    use kband::regime::capture::{DriveLag, DriveLagSettings, Lot, PlanSettings, Planner};

    fn plan(low: f64, high: f64) -> Plan {
        let restitution = Restitution::interval(low, high).unwrap();
        let mut planner = Planner::new(PlanSettings {
            lot: Lot {
                k: Band::common(restitution, 1).unwrap().setpoint(),
                restitution,
                order: 1,
                amplitude_error: 0.02,
                contact: ContactTime::INSTANT,
            },
            drive: DriveLag::build(DriveLagSettings::DEFAULT).unwrap(),
            time_constant: 5.0,
            effort: PlanSettings::DEFAULT_EFFORT,
        })
        .unwrap();
        loop {
            if let Poll::Ready(plan) = planner.advance(1000) {
                return plan;
            }
        }
    }

    /// Kicks until the capture fails, where each leaves `lock`.
    fn kicks(plan: &Plan, lock: DetectedLock) -> u8 {
        let mut capture = Capture::new(8, 50.0);
        capture.begin();
        for _ in 0..10_000 {
            if capture.cycle(Some(plan), lock, true) == Some(CaptureEvent::Failed) {
                return capture.attempts;
            }
        }
        panic!("a capture ends");
    }

    #[test]
    fn kicks_end_once_their_misses_are_improbable() {
        for (low, high, most) in [(0.18, 0.22, 3), (0.48, 0.52, 8)] {
            let plan = plan(low, high);
            let mut misses = (0..8).scan(1.0, |product, attempt| {
                *product *= plan.miss_probability(attempt);
                Some(*product)
            });
            let stop = (misses.position(|product| product <= 1e-3)).map_or(8, |n| n as u8 + 1);
            assert_eq!(kicks(&plan, DetectedLock::Few), stop, "{low} {plan:?}");
            assert!((2..=most).contains(&stop), "{low}: {stop}");
            assert_eq!(kicks(&plan, DetectedLock::Most), 8, "{low}");
        }
    }

    #[test]
    fn plan_that_captures_less_than_95_percent_is_uncertain() {
        for (low, high, sure) in [(0.18, 0.22, true), (0.48, 0.52, false)] {
            let plan = plan(low, high);
            let share = plan.best().unwrap().share();
            assert!((0.35..0.95).contains(&share) != sure, "{low}: {share}");
            let mut capture = Capture::new(8, 50.0);
            capture.begin();
            let event = capture.cycle(Some(&plan), DetectedLock::Few, true);
            assert_eq!(event, Some(CaptureEvent::Planned { sure }), "{low}");
        }
    }
}
