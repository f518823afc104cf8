//! Capture rates of a lot by Monte Carlo simulation.
//!
//! Restitution and relative error of the amplitude are uniform within the lot's ranges. Each part
//! is simulated on the exact map: without a kick, then with the plan's kicks until one captures it.
//! The results are shares of the parts, 0..1.

use kband::regime::capture::{Kick, Plan, Trial};

use super::Task;
use super::part::captures;
use crate::desk::Desk;
use crate::random::SplitMix;
use crate::refusal::Refusal;

/// Shares of captured parts, 0..1.
pub(super) struct Rates {
    /// Without a kick.
    pub(super) alone: f64,
    /// After each attempt, earlier attempts included.
    pub(super) by_attempt: Vec<f64>,
}

impl Rates {
    pub(super) fn measure(task: &Task<'_>, plan: &Plan, desk: &Desk) -> Result<Self, Refusal> {
        let (runs, attempts) = (task.arguments.runs, task.arguments.attempts);
        let results = desk.try_map("capture runs", runs, |run| {
            let mut random = random(task.arguments.seed as u64, run as u64);
            let (low, high) = (task.lot.restitution.low(), task.lot.restitution.high());
            let part = Trial {
                restitution: low + (high - low) * random.uniform(),
                k: task.lot.k / (1.0 + task.lot.amplitude_error * (2.0 * random.uniform() - 1.0)),
                order: task.lot.order,
                contact: task.lot.contact,
            };
            let alone = captures(part, task.drive, Kick::NONE)?;
            for attempt in 0..attempts {
                let drive = if attempt == 0 { task.drive } else { task.again };
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
        Ok(Self {
            alone: share(results.iter().filter(|(alone, _)| *alone).count()),
            by_attempt: (0..attempts)
                .map(|attempt| {
                    let held = |at: &Option<usize>| at.is_some_and(|at| at <= attempt);
                    share(results.iter().filter(|(_, at)| held(at)).count())
                })
                .collect(),
        })
    }
}

/// Random numbers that depend on seed and run alone.
fn random(seed: u64, run: u64) -> SplitMix {
    let mut random = SplitMix(seed.wrapping_mul(0xD129_0B26_68E5_4F27).wrapping_add(run));
    SplitMix(random.bits())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_numbers_are_even_and_differ_between_runs() {
        let mean = (0..1000).map(|run| random(1, run).uniform()).sum::<f64>() / 1000.0;
        // Standard error 0.29 / sqrt(1000) = 0.009.
        assert!((mean - 0.5).abs() < 0.04, "{mean}");
        assert_ne!(random(1, 2).bits(), random(2, 1).bits());
    }
}
