//! Test of whether gear must be planned anew, for other parts or without a tone that the drive
//! fails to make.
//!
//! A test of the estimates against the plan's values, debounced over consecutive cycles.

use crate::drive::UPPER;
use crate::hear::GearMargin;
use crate::settings::Settings;
use kband::regime::gear::GearPlanSettings;

/// Cycles in a row in which the plan must be wrong: twice the impacts behind an estimate.
const WRONG_CYCLES: u16 = 250;
/// Minimum number of cycles between two plans, in which the parts settle.
const MIN_CYCLES_BETWEEN_PLANS: u16 = 1000;
/// Largest standard error of an estimated restitution that is used.
const MAX_STANDARD_ERROR: f32 = 0.02;
/// Half width in restitution of the lot that is planned for one estimated restitution.
const LOT_HALF_WIDTH: f32 = 0.02;
/// Tolerance between restitutions estimated and planned: three standard errors (0.0045).
const RESTITUTION_TOLERANCE: f32 = 0.015;
/// Tolerance between scatters estimated and planned: four standard errors (0.005).
const SCATTER_TOLERANCE: f32 = 0.02;

/// Counters of the test for the present plan.
#[derive(Clone, Copy, Debug, Default)]
pub struct Retuning {
    doubted: u16,
    since: u16,
}

impl Retuning {
    /// Processes a cycle at the setpoint of a settled plan. `lacks` marks the upper tones that the
    /// drive makes too weak. Returns the settings of a new plan, once it is due.
    pub fn cycle(
        &mut self,
        planned: &GearPlanSettings,
        margin: Option<&GearMargin>,
        lacks: [bool; UPPER],
        settings: &Settings,
    ) -> Option<Settings> {
        self.since = self.since.saturating_add(1);
        let mut wanted = *settings;
        wanted.restitution_low = planned.restitution.low() as f32;
        wanted.restitution_high = planned.restitution.high() as f32;
        wanted.scatter = planned.scatter;
        [wanted.second_tone, wanted.third_tone] = planned.max_tones;
        let mut wrong = false;
        let [second, third] = planned.max_tones;
        if lacks[0] && second > 0.0 {
            // A third tone requires a second.
            (wanted.second_tone, wanted.third_tone) = (0.0, 0.0);
            wrong = true;
        } else if lacks[1] && third > 0.0 {
            wanted.third_tone = 0.0;
            wrong = true;
        } else if self.since >= MIN_CYCLES_BETWEEN_PLANS
            && let Some(heard) = margin.filter(|margin| margin.error <= MAX_STANDARD_ERROR)
        {
            let low = (heard.restitution - LOT_HALF_WIDTH).clamp(0.0, 0.95);
            let high = (heard.restitution + LOT_HALF_WIDTH).max(low).min(0.99);
            let scatter = heard.scatter.clamp(0.0, 0.3);
            // A planned lot that lies within the estimated one is not wrong.
            wrong = wanted.restitution_low < low - RESTITUTION_TOLERANCE
                || wanted.restitution_high > high + RESTITUTION_TOLERANCE
                || heard.restitution < wanted.restitution_low - RESTITUTION_TOLERANCE
                || heard.restitution > wanted.restitution_high + RESTITUTION_TOLERANCE
                || (scatter - wanted.scatter).abs() > SCATTER_TOLERANCE;
            (wanted.restitution_low, wanted.restitution_high) = (low, high);
            wanted.scatter = scatter;
        }
        self.doubted = if wrong { self.doubted + 1 } else { 0 };
        if self.doubted < WRONG_CYCLES {
            return None;
        }
        *self = Self::default();
        Some(wanted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
    fn anew(margin: Option<GearMargin>, lacks: [bool; UPPER]) -> Option<(u32, Settings)> {
        let mut retuning = Retuning::default();
        let settings = Settings::default();
        (1..5000).find_map(|n| {
            let wanted = retuning.cycle(&planned(), margin.as_ref(), lacks, &settings)?;
            Some((n, wanted))
        })
    }

    fn heard(restitution: f32, error: f32, scatter: f32) -> Option<GearMargin> {
        Some(GearMargin {
            restitution,
            error,
            scatter,
            ..GearMargin::default()
        })
    }

    #[test]
    fn only_significant_changes_start_a_new_plan() {
        assert!(anew(None, NONE).is_none());
        assert!(anew(heard(0.31, 0.01, 0.06), NONE).is_none());
        assert!(anew(heard(0.40, 0.03, 0.05), NONE).is_none());
        let (cycles, wanted) = anew(heard(0.34, 0.01, 0.05), NONE).unwrap();
        let due = u32::from(MIN_CYCLES_BETWEEN_PLANS) + u32::from(WRONG_CYCLES) - 1;
        assert_eq!(due, cycles);
        assert!((wanted.restitution_low - 0.32).abs() < 1e-6);
        assert!((wanted.restitution_high - 0.36).abs() < 1e-6);
        assert_eq!(wanted.second_tone, 0.15);
        let (_, wanted) = anew(heard(0.3, 0.01, 0.08), NONE).unwrap();
        assert_eq!(wanted.scatter, 0.08);
    }

    #[test]
    fn plan_stays_while_the_estimate_agrees() {
        let settings = Settings::default();
        let of_one = GearPlanSettings {
            restitution: Restitution::single(0.3).unwrap(),
            ..planned()
        };
        let anew = |restitution| {
            let mut retuning = Retuning::default();
            let heard = heard(restitution, 0.008, 0.05);
            (1..5000).any(|_| {
                let wanted = retuning.cycle(&of_one, heard.as_ref(), NONE, &settings);
                wanted.is_some()
            })
        };
        assert!(!anew(0.305) && !anew(0.29));
        assert!(anew(0.32) && anew(0.28));
    }

    #[test]
    fn tones_that_the_drive_does_not_make_are_planned_without() {
        let (cycles, wanted) = anew(None, [true, false]).unwrap();
        assert_eq!(cycles, u32::from(WRONG_CYCLES));
        assert_eq!((wanted.second_tone, wanted.third_tone), (0.0, 0.0));
        let (_, wanted) = anew(None, [false, true]).unwrap();
        assert_eq!((wanted.second_tone, wanted.third_tone), (0.15, 0.0));
        assert!((wanted.restitution_high - 0.32).abs() < 1e-6);
    }
}
