//! Test of whether gear must be planned again, for other parts or without an infeasible tone.
//!
//! A test of the estimates against the plan's values, debounced over consecutive cycles.

use crate::{GearMargin, Settings, UPPER};
use kband::regime::gear::GearPlanSettings;

/// Cycles in a row in which the plan must be wrong: twice the impacts behind an estimate.
const WRONG_CYCLES: u16 = 250;
/// Minimum number of cycles between two plans, in which the parts settle.
const MIN_CYCLES_BETWEEN_PLANS: u16 = 1000;
/// Largest standard error of an estimated restitution that is used.
const MAX_STANDARD_ERROR: f32 = 0.02;
/// Half width in restitution of the lot planned for one estimated restitution.
const LOT_HALF_WIDTH: f32 = 0.02;
/// Tolerance between restitutions estimated and planned: three standard errors (0.0045).
const RESTITUTION_TOLERANCE: f32 = 0.015;
/// Tolerance between scatters estimated and planned: four standard errors (0.005).
const SCATTER_TOLERANCE: f32 = 0.02;

#[derive(Clone, Copy, Debug, Default)]
pub struct Retuning {
    wrong_cycles: u16,
    cycles_since_plan: u16,
}

impl Retuning {
    /// Processes a cycle at the setpoint of a settled plan. `missing_tones` marks the upper tones
    /// that the drive makes too weak. Returns the settings of a new plan, once it is due.
    pub fn cycle(
        &mut self,
        planned: &GearPlanSettings,
        margin: Option<&GearMargin>,
        missing_tones: [bool; UPPER],
        settings: &Settings,
    ) -> Option<Settings> {
        self.cycles_since_plan = self.cycles_since_plan.saturating_add(1);
        let mut proposed = *settings;
        proposed.restitution_low = planned.restitution.low() as f32;
        proposed.restitution_high = planned.restitution.high() as f32;
        proposed.scatter = planned.scatter;
        [proposed.second_tone, proposed.third_tone] = planned.max_tones;
        let mut deviates = false;
        let [second, third] = planned.max_tones;
        if missing_tones[0] && second > 0.0 {
            // A third tone requires a second.
            (proposed.second_tone, proposed.third_tone) = (0.0, 0.0);
            deviates = true;
        } else if missing_tones[1] && third > 0.0 {
            proposed.third_tone = 0.0;
            deviates = true;
        } else if self.cycles_since_plan >= MIN_CYCLES_BETWEEN_PLANS
            && let Some(estimated) = margin.filter(|margin| margin.error <= MAX_STANDARD_ERROR)
        {
            let low = (estimated.restitution - LOT_HALF_WIDTH).clamp(0.0, 0.95);
            let high = (estimated.restitution + LOT_HALF_WIDTH).max(low).min(0.99);
            let scatter = estimated.scatter.clamp(0.0, 0.3);
            // A planned lot that lies within the estimated one is not wrong.
            deviates = proposed.restitution_low < low - RESTITUTION_TOLERANCE
                || proposed.restitution_high > high + RESTITUTION_TOLERANCE
                || estimated.restitution < proposed.restitution_low - RESTITUTION_TOLERANCE
                || estimated.restitution > proposed.restitution_high + RESTITUTION_TOLERANCE
                || (scatter - proposed.scatter).abs() > SCATTER_TOLERANCE;
            (proposed.restitution_low, proposed.restitution_high) = (low, high);
            proposed.scatter = scatter;
        }
        self.wrong_cycles = if deviates { self.wrong_cycles + 1 } else { 0 };
        if self.wrong_cycles < WRONG_CYCLES {
            return None;
        }
        *self = Self::default();
        Some(proposed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;
    use kband::feeder::Restitution;
    use kband::impact::ContactTime;
    use kband::regime::gear::GearLimits;

    const NONE: [bool; UPPER] = [false; UPPER];

    fn planned() -> GearPlanSettings {
        GearPlanSettings {
            restitution: Restitution::interval(0.28, 0.32).unwrap(),
            scatter: 0.05,
            amplitude_error: 0.02,
            order: 1,
            k: [0.28, 0.6],
            max_tones: [0.15, 0.05],
            limits: GearLimits::NONE,
            contact: ContactTime::INSTANT,
        }
    }

    /// Cycles until a new plan is due, and its settings.
    fn replan(
        planned: &GearPlanSettings,
        margin: Option<GearMargin>,
        missing_tones: [bool; UPPER],
    ) -> Option<(u32, Settings)> {
        let mut retuning = Retuning::default();
        let settings = Settings::default();
        (1..5000).find_map(|n| {
            let proposed = retuning.cycle(planned, margin.as_ref(), missing_tones, &settings)?;
            Some((n, proposed))
        })
    }

    #[test]
    fn only_significant_changes_start_a_new_plan() {
        let lot = planned();
        let one = with(lot, |it| it.restitution = Restitution::single(0.3).unwrap());
        // Plan; estimated restitution, its error, scatter; the proposed lot and scatter.
        for (plan, [restitution, error, scatter], proposed) in [
            (&lot, [0.31, 0.01, 0.06], None),
            (&lot, [0.40, 0.03, 0.05], None),
            (&lot, [0.34, 0.01, 0.05], Some([0.32, 0.36, 0.05])),
            (&lot, [0.30, 0.01, 0.08], Some([0.28, 0.32, 0.08])),
            // One end of the lot alone is too far from the estimated one.
            (&lot, [0.275, 0.01, 0.05], Some([0.255, 0.295, 0.05])),
            (&lot, [0.325, 0.01, 0.05], Some([0.305, 0.345, 0.05])),
            (&one, [0.305, 0.008, 0.05], None),
            (&one, [0.29, 0.008, 0.05], None),
            (&one, [0.32, 0.008, 0.05], Some([0.3, 0.34, 0.05])),
            (&one, [0.28, 0.008, 0.05], Some([0.26, 0.3, 0.05])),
        ] {
            let numbers = (restitution, error, scatter);
            let margin = with(GearMargin::default(), |it| {
                (it.restitution, it.error, it.scatter) = numbers;
            });
            let actual = replan(plan, Some(margin), NONE);
            assert_eq!(actual.is_some(), proposed.is_some(), "{margin:?}");
            if let (Some((cycles, actual)), Some(expected)) = (actual, proposed) {
                let due = MIN_CYCLES_BETWEEN_PLANS + WRONG_CYCLES - 1;
                assert_eq!((cycles, actual.second_tone), (u32::from(due), 0.15));
                let keys = ["restitution_low", "restitution_high", "scatter"];
                for (key, expected) in keys.into_iter().zip(expected) {
                    let actual = actual.get(key).unwrap();
                    assert!((actual - expected).abs() < 1e-6, "{margin:?} {actual}");
                }
            }
        }
        assert!(replan(&lot, None, NONE).is_none());
    }

    #[test]
    fn tones_that_the_drive_does_not_make_are_planned_without() {
        let (cycles, proposed) = replan(&planned(), None, [true, false]).unwrap();
        assert_eq!(cycles, u32::from(WRONG_CYCLES));
        assert_eq!((proposed.second_tone, proposed.third_tone), (0.0, 0.0));
        let (_, proposed) = replan(&planned(), None, [false, true]).unwrap();
        assert_eq!((proposed.second_tone, proposed.third_tone), (0.15, 0.0));
        assert!((proposed.restitution_high - 0.32).abs() < 1e-6);
    }
}
