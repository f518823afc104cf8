//! Capture: kicks that throw parts onto the wanted orbit, one attempt after the other.

use crate::regime::capture::{Kick, Plan};

/// Share of the lot below which a plan is called uncertain. All but one part in twenty. It names an event and
/// decides nothing.
const SURE: f64 = 0.95;

/// Kicks that an hour brings, and most that are saved up. A kick and the judging of it take 80 cycles in which the parts
/// are thrown higher and conveyed worse: sixty of them in an hour at 50 Hz are 2.7 % of it. Parts that are lost oftener
/// than every hundred seconds are not won by kicks; two whole captures in a row are.
const HOURLY: f32 = 40.0;
const SAVED: f32 = 20.0;

/// What the capture does in a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stage {
    /// Nothing: the parts are not to be captured, or not now.
    Idle,
    /// Waiting for the plan.
    Planning,
    /// About to try the next kick.
    Ready,
    /// In the kick's n-th cycle.
    Kicking(Kick, u32),
    /// Listening to what became of it, for n cycles.
    Judging(u32),
}

/// Cycles of listening after the kick's amplitude has come back, before it counts as failed: parts may hop for a
/// while before the orbit takes them. As many as the plan gives a part after its kick. Between 15 and 120 every
/// scene passes.
const PATIENCE: u32 = 60;

/// The attempts at capturing the parts.
#[derive(Clone, Copy, Debug)]
pub struct Capture {
    stage: Stage,
    attempts: u8,
    allowed: u8,
    /// Kicks that may be made now, and how many a cycle brings.
    left: f32,
    gain: f32,
}

/// What happened in a cycle of the capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CaptureEvent {
    /// The plan is ready; whether its best kick captured the whole lot.
    Planned {
        /// Whether it captured all but one part in twenty.
        sure: bool,
    },
    /// A kick begins.
    Begun,
    /// The kick is over and listening begins.
    Ended,
    /// The parts are heard in the wanted lock.
    Captured,
    /// The attempts are used up, those of this capture or those of the hour.
    Failed,
}

impl Capture {
    /// A capture that may try `allowed` kicks, at so many cycles a second; in an hour at most sixty.
    #[must_use]
    pub fn new(allowed: u8, pace: f32) -> Self {
        Self {
            stage: Stage::Idle,
            attempts: 0,
            allowed,
            left: SAVED,
            gain: HOURLY / (3600.0 * pace),
        }
    }

    /// Begins anew, with every attempt ahead.
    pub fn begin(&mut self) {
        self.attempts = 0;
        self.stage = Stage::Planning;
    }

    /// A cycle on.
    pub fn count(&mut self) {
        self.left = (self.left + self.gain).min(SAVED);
    }

    /// Gives up what it was doing.
    pub fn stop(&mut self) {
        self.stage = Stage::Idle;
    }

    /// Kicks begun since [`Capture::begin`].
    #[must_use]
    pub fn attempts(&self) -> u8 {
        self.attempts
    }

    /// Amplitude commanded for the coming cycle over the setpoint.
    #[must_use]
    pub fn command(&self) -> f32 {
        match self.stage {
            Stage::Kicking(kick, cycle) => kick.command(cycle),
            _ => 1.0,
        }
    }

    /// One cycle on; `plan` is there once the search for kicks is over, `locked` is whether the wanted lock is heard, `settled` whether the amplitude is
    /// back at the setpoint.
    pub fn cycle(
        &mut self,
        plan: Option<&Plan>,
        locked: bool,
        settled: bool,
    ) -> Option<CaptureEvent> {
        match self.stage {
            Stage::Idle => None,
            Stage::Planning => match plan {
                Some(plan) => {
                    self.stage = Stage::Ready;
                    Some(CaptureEvent::Planned {
                        sure: plan.best().is_some_and(|best| best.share() >= SURE),
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
            Stage::Judging(_) if locked && settled => {
                self.stage = Stage::Idle;
                Some(CaptureEvent::Captured)
            }
            Stage::Judging(cycle) if cycle < PATIENCE => {
                self.stage = Stage::Judging(cycle + u32::from(settled));
                None
            }
            Stage::Judging(_) => self.next(plan),
        }
    }

    fn next(&mut self, plan: Option<&Plan>) -> Option<CaptureEvent> {
        let kick = plan
            .and_then(|plan| plan.attempt(u32::from(self.attempts)))
            .filter(|_| self.attempts < self.allowed && self.left >= 1.0);
        let Some(kick) = kick else {
            self.stage = Stage::Idle;
            return Some(CaptureEvent::Failed);
        };
        self.attempts += 1;
        self.left -= 1.0;
        self.stage = Stage::Kicking(kick, 0);
        Some(CaptureEvent::Begun)
    }
}

#[cfg(test)]
mod tests {
    use core::task::Poll;

    use super::*;
    use crate::feeder::Restitution;
    use crate::impact::Hybrid;
    use crate::regime::band::Band;
    use crate::regime::capture::{DriveLag, DriveLagSettings, Lot, PlanSettings, Planner};

    fn plan(low: f64, high: f64) -> Plan {
        let restitution = Restitution::interval(low, high).unwrap();
        let mut planner = Planner::<Hybrid>::new(PlanSettings {
            lot: Lot {
                k: Band::common(restitution, 1).unwrap().setpoint(),
                restitution,
                order: 1,
                amplitude_error: 0.02,
            },
            drive: DriveLag::build(DriveLagSettings::DEFAULT).unwrap(),
            time_constant: 5.0,
            effort: PlanSettings::EFFORT,
        })
        .unwrap();
        loop {
            if let Poll::Ready(plan) = planner.advance(1000) {
                return plan;
            }
        }
    }

    #[test]
    fn a_plan_that_misses_more_than_one_part_in_twenty_is_uncertain() {
        for (low, high, sure) in [(0.18, 0.22, true), (0.48, 0.52, false)] {
            let plan = plan(low, high);
            let share = plan.best().unwrap().share();
            assert!((0.35..0.95).contains(&share) != sure, "{low}: {share}");
            let mut capture = Capture::new(8, 50.0);
            capture.begin();
            let event = capture.cycle(Some(&plan), false, true);
            assert_eq!(event, Some(CaptureEvent::Planned { sure }), "{low}");
        }
    }
}
