//! One part and one kick: whether it captures the part.

use kband::impact::Kernel;
use kband::regime::capture::{DriveLag, Follow, Kick, Outcome, Trial};

use crate::refusal::Refusal;

/// Impacts after which a part counts as missed.
const MOST_IMPACTS: u32 = 20_000;

/// Whether `kick` captures a part.
pub(super) fn captures<K: Kernel>(
    part: Trial,
    drive: DriveLag,
    kick: Kick,
) -> Result<bool, Refusal> {
    let mut follow = Follow::<K>::new(part, drive, kick)?;
    while follow.steps() < MOST_IMPACTS {
        if let Some(outcome) = follow.step() {
            return Ok(outcome == Outcome::Locked);
        }
    }
    Ok(false)
}
