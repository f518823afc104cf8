//! One part and one kick: whether it captures the part.

use kband::regime::capture::{DriveLag, Kick, Outcome, Trial, TrialRun};

use crate::refusal::Refusal;

/// Impacts after which a part counts as missed.
const MOST_IMPACTS: u32 = 20_000;

pub(super) fn captures(part: Trial, drive: DriveLag, kick: Kick) -> Result<bool, Refusal> {
    let mut trial_run = TrialRun::new(part, drive, kick)?;
    while trial_run.steps() < MOST_IMPACTS {
        if let Some(outcome) = trial_run.simulate_impact() {
            return Ok(outcome == Outcome::Locked);
        }
    }
    Ok(false)
}
