//! Capture rates of a lot by Monte Carlo simulation.
//!
//! Restitution and relative error of the amplitude are uniform within the lot's ranges. Each part
//! is simulated on the exact map: without a kick, then with the plan's kicks until one captures it.
//! The results are shares of the parts, 0..1.

use kband::regime::capture::{Kick, Plan, Trial};

use super::{Task, captures};
use crate::desk::Desk;
use crate::random::SplitMix;
use crate::refusal::Refusal;

/// Shares of captured parts, 0..1.
pub(super) struct Rates {
    pub(super) alone: f64,
    /// After each attempt, including earlier ones.
    pub(super) by_attempt: Vec<f64>,
}

impl Rates {
    pub(super) fn measure(task: &Task<'_>, plan: &Plan, desk: &Desk) -> Result<Self, Refusal> {
        let (runs, attempts) = (task.arguments.runs, task.arguments.attempts);
        let results = desk.try_map("capture runs", runs, |run| {
            let mut random = random(task.arguments.seed as u64, run as u64);
            let (low, high) = (task.lot.restitution.low(), task.lot.restitution.high());
            let part = Trial {
                restitution: random.within(low, high),
                k: task.lot.k / (1.0 + task.lot.amplitude_error * random.within(-1.0, 1.0)),
                order: task.lot.order,
                contact: task.lot.contact,
            };
            let alone = captures(part, task.drive, Kick::NONE)?;
            for attempt in 0..attempts {
                let drives = [task.drive, task.retry_drive];
                let drive = drives[attempt.min(1)];
                let Some(kick) = plan.attempt(attempt as u32) else {
                    break;
                };
                if captures(part, drive, kick)? {
                    return Ok((alone, Some(attempt)));
                }
            }
            Ok((alone, None))
        })?;
        let share = |count: usize| count as f64 / runs as f64;
        let held_by = |attempt: usize| {
            let held = |at: Option<usize>| at.is_some_and(|at| at <= attempt);
            share(results.iter().filter(|(_, at)| held(*at)).count())
        };
        Ok(Self {
            alone: share(results.iter().filter(|(alone, _)| *alone).count()),
            by_attempt: (0..attempts).map(held_by).collect(),
        })
    }
}

/// Random numbers that depend only on seed and run.
fn random(seed: u64, run: u64) -> SplitMix {
    let mut random = SplitMix(seed.wrapping_mul(0xD129_0B26_68E5_4F27).wrapping_add(run));
    SplitMix(random.bits())
}
