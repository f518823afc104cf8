//! Capture: kicks that throw parts onto the wanted orbit, one attempt after the other.

/// A kick being tried: amplitude over the setpoint, cycle by cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kick {
    /// Highest amplitude over the setpoint.
    pub factor: f32,
    /// Cycles at it.
    pub hold: u16,
}

impl Kick {
    fn command(&self, cycle: u32) -> f32 {
        if cycle < u32::from(self.hold) {
            self.factor
        } else {
            1.0
        }
    }

    fn length(&self) -> u32 {
        u32::from(self.hold)
    }
}

const KICKS: [Kick; 6] = [
    Kick {
        factor: 1.5,
        hold: 15,
    },
    Kick {
        factor: 1.35,
        hold: 22,
    },
    Kick {
        factor: 1.8,
        hold: 14,
    },
    Kick {
        factor: 2.1,
        hold: 17,
    },
    Kick {
        factor: 1.25,
        hold: 30,
    },
    Kick {
        factor: 1.65,
        hold: 19,
    },
];

/// What the capture does in a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stage {
    /// Nothing: the parts are not to be captured, or not now.
    Idle,
    /// Waiting for the plan.
    Planning,
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
    /// The plan is ready and a kick begins.
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

    /// Amplitude commanded for this cycle over the setpoint.
    #[must_use]
    pub fn command(&self) -> f32 {
        match self.stage {
            Stage::Kicking(kick, cycle) => kick.command(cycle),
            _ => 1.0,
        }
    }

    /// One cycle on; `locked` is whether the wanted lock is heard, `settled` whether the amplitude is
    /// back at the setpoint.
    pub fn cycle(&mut self, locked: bool, settled: bool) -> Progress {
        match self.stage {
            Stage::Idle => Progress::Going,
            Stage::Planning => self.next(),
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
            Stage::Judging(_) => self.next(),
        }
    }

    fn next(&mut self) -> Progress {
        if self.attempts >= self.allowed {
            self.stage = Stage::Idle;
            return Progress::Failed;
        }
        let kick = KICKS[usize::from(self.attempts) % KICKS.len()];
        self.attempts += 1;
        self.stage = Stage::Kicking(kick, 0);
        Progress::Begun
    }
}
