//! Capture: kicks that throw parts onto the wanted orbit, one attempt after the other.

use super::setpoint::{LockAt, lot};
use super::settings::Settings;
use crate::feeder::OutOfRange;
use crate::impact::Hybrid;
use crate::regime::capture::{
    Drive, DriveSettings, Kick, Lot, Plan, PlanSettings, Planner, Progress as Planning,
};

/// Impacts that one slice of planning computes: at most 0.2 million instructions, which 300 drive cycles a
/// second leave time for.
const SLICE: u32 = 20;
/// Highest amplitude of a kick over the setpoint that is planned.
const HIGHEST: f32 = 2.5;
/// Share of the lot below which a plan is called uncertain.
const SURE: f64 = 0.95;

/// A search that has come to its end: what was asked, what came, after how many slices.
///
/// Two controllers with the same question come to the same plan after as many slices, so that one that
/// is told need not search ([`Controller::plan_known`](super::Controller::plan_known)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planned {
    /// What was asked.
    pub settings: PlanSettings,
    /// The plan.
    pub plan: Plan,
    /// Slices that it took.
    pub slices: u32,
}

/// The search for kicks, slice by slice; the default wants nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Search {
    planner: Option<Planner<Hybrid>>,
    settings: Option<PlanSettings>,
    slices: u32,
    known: Option<Planned>,
    plan: Option<Plan>,
}

impl Search {
    /// A search for the kicks that bring the lot onto a lock whose amplitude a kick may exceed `reserve`
    /// times.
    pub fn begin(settings: &Settings, lock: &LockAt, reserve: f32) -> Result<Self, OutOfRange> {
        let envelope = f64::from(settings.envelope);
        let settings = PlanSettings {
            lot: Lot {
                k: lock.k,
                restitution: lot(settings)?,
                order: u32::from(lock.order),
                amplitude_error: f64::from(settings.amplitude_error),
            },
            drive: Drive::build(DriveSettings {
                time_constant: envelope,
                start: 1.0,
                limit: f64::from(reserve.clamp(1.0, HIGHEST)),
            })?,
            time_constant: envelope,
            effort: PlanSettings::EFFORT,
        };
        Ok(Self {
            planner: Some(Planner::new(settings)?),
            settings: Some(settings),
            ..Self::default()
        })
    }

    /// One slice; whether more are to be done.
    pub fn step(&mut self) -> bool {
        let Some(planner) = &mut self.planner else {
            return false;
        };
        self.slices = self.slices.saturating_add(1);
        let progress = match self.known {
            Some(known) if self.slices < known.slices => Planning::Working,
            Some(known) => Planning::Done(known.plan),
            None => planner.advance(SLICE),
        };
        match progress {
            Planning::Working => true,
            Planning::Done(plan) => {
                self.planner = None;
                self.plan = Some(plan);
                false
            }
        }
    }

    /// What is being searched; `None` once it is known or found.
    pub fn asked(&self) -> Option<&PlanSettings> {
        self.settings
            .as_ref()
            .filter(|_| self.planner.is_some() && self.known.is_none())
    }

    /// Spares the search, if it is for this: the plan then comes after as many slices as it took.
    pub fn know(&mut self, known: Planned) {
        if self.asked() == Some(&known.settings) {
            self.known = Some(known);
        }
    }

    /// The search that came to its end.
    pub fn planned(&self) -> Option<Planned> {
        Some(Planned {
            settings: self.settings?,
            plan: self.plan?,
            slices: self.slices,
        })
    }

    /// The plan, once it is there.
    #[must_use]
    pub fn plan(&self) -> Option<&Plan> {
        self.plan.as_ref()
    }
}

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

/// Cycles of listening after the kick's amplitude has come back, before it counts as failed: parts may
/// hop for a while before the orbit takes them.
const PATIENCE: u32 = 60;

/// The attempts at capturing the parts.
#[derive(Clone, Copy, Debug)]
pub struct Capture {
    stage: Stage,
    attempts: u8,
    allowed: u8,
}

/// What changed in a cycle of the capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Nothing worth telling.
    Going,
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
    /// The attempts are used up.
    Failed,
}

impl Capture {
    /// A capture that may try `allowed` kicks.
    #[must_use]
    pub fn new(allowed: u8) -> Self {
        Self {
            stage: Stage::Idle,
            attempts: 0,
            allowed,
        }
    }

    /// Begins anew, with every attempt ahead.
    pub fn begin(&mut self) {
        self.attempts = 0;
        self.stage = Stage::Planning;
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

    /// One cycle on; `locked` is whether the wanted lock is heard, `settled` whether the amplitude is
    /// back at the setpoint.
    pub fn cycle(&mut self, search: &Search, locked: bool, settled: bool) -> Progress {
        match self.stage {
            Stage::Idle => Progress::Going,
            Stage::Planning => match search.plan() {
                Some(plan) => {
                    self.stage = Stage::Ready;
                    Progress::Planned {
                        sure: plan.best().is_some_and(|best| best.share() >= SURE),
                    }
                }
                None => Progress::Going,
            },
            Stage::Ready => self.next(search),
            Stage::Kicking(kick, cycle) => {
                if cycle + 1 < kick.length() {
                    self.stage = Stage::Kicking(kick, cycle + 1);
                    Progress::Going
                } else {
                    self.stage = Stage::Judging(0);
                    Progress::Ended
                }
            }
            Stage::Judging(_) if locked && settled => {
                self.stage = Stage::Idle;
                Progress::Captured
            }
            Stage::Judging(cycle) if cycle < PATIENCE => {
                self.stage = Stage::Judging(cycle + u32::from(settled));
                Progress::Going
            }
            Stage::Judging(_) => self.next(search),
        }
    }

    fn next(&mut self, search: &Search) -> Progress {
        let kick = search
            .plan()
            .and_then(|plan| plan.attempt(u32::from(self.attempts)))
            .filter(|_| self.attempts < self.allowed);
        let Some(kick) = kick else {
            self.stage = Stage::Idle;
            return Progress::Failed;
        };
        self.attempts += 1;
        self.stage = Stage::Kicking(kick, 0);
        Progress::Begun
    }
}
