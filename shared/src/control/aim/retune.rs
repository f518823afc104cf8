//! Whether the plan for gear is to be made anew: for parts that are heard to be others, or without a tone that the drive
//! does not make.

use crate::control::drive::UPPER;
use crate::control::hear::GearMargin;
use crate::control::settings::Settings;
use crate::regime::gear::GearPlanSettings;

/// Cycles in a row in which the plan must be wrong before it is made anew: twice the impacts on which what is heard rests,
/// so that the same few are not doubted twice. From 25 to 2500 every test passes.
const PATIENCE: u16 = 250;
/// Cycles from a plan to the next one, in which the parts settle and what is heard of them is of the new setpoint: eight times
/// those impacts. With 10 000 `only_what_is_surely_heard_to_be_other_is_planned_for` fails; with a quarter and with four
/// times of each of those below it does as well.
const APART: u16 = 1000;
/// Largest standard error of a heard restitution that is believed.
const SURE: f32 = 0.02;
/// Half of the lot that parts of one heard restitution are planned as.
const HALF: f32 = 0.02;
/// How far an end of that lot, and the scatter, must be from those of the plan: three and four times what the heard ones err
/// by (0.0045 and 0.005). While R went from 0.25 to 0.4 in ten minutes, 0.03 let the share of a minute in gear fall to 0.53, this to
/// 0.66 (`a_lot_that_drifts_is_followed_and_stays_in_gear`).
const FAR: f32 = 0.015;
const SCATTERED: f32 = 0.02;

/// What is seen of a plan that is followed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Retuning {
    doubted: u16,
    since: u16,
}

impl Retuning {
    /// Takes a cycle at the setpoint of a settled plan: what is heard of the parts, and of which tones above the
    /// first the drive makes less than is wanted. The settings to plan with, once it is to be made anew.
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
        [wanted.second_tone, wanted.third_tone] = planned.most;
        let mut wrong = false;
        let [second, third] = planned.most;
        if lacks[0] && second > 0.0 {
            // A third tone is none without a second.
            (wanted.second_tone, wanted.third_tone) = (0.0, 0.0);
            wrong = true;
        } else if lacks[1] && third > 0.0 {
            wanted.third_tone = 0.0;
            wrong = true;
        } else if self.since >= APART
            && let Some(heard) = margin.filter(|margin| margin.error <= SURE)
        {
            let low = (heard.restitution - HALF).clamp(0.0, 0.95);
            let high = (heard.restitution + HALF).max(low).min(0.99);
            let scatter = heard.scatter.clamp(0.0, 0.3);
            // A lot that is narrower than what one is planned for by what is heard is not wrong for that.
            wrong = wanted.restitution_low < low - FAR
                || wanted.restitution_high > high + FAR
                || heard.restitution < wanted.restitution_low - FAR
                || heard.restitution > wanted.restitution_high + FAR
                || (scatter - wanted.scatter).abs() > SCATTERED;
            (wanted.restitution_low, wanted.restitution_high) = (low, high);
            wanted.scatter = scatter;
        }
        self.doubted = if wrong { self.doubted + 1 } else { 0 };
        if self.doubted < PATIENCE {
            return None;
        }
        *self = Self::default();
        Some(wanted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feeder::Restitution;
    use crate::regime::gear::GearLimits;

    const NONE: [bool; UPPER] = [false; UPPER];

    fn planned() -> GearPlanSettings {
        GearPlanSettings {
            restitution: Restitution::interval(0.28, 0.32).unwrap(),
            scatter: 0.05,
            amplitude_error: 0.02,
            order: 1,
            k: [0.28, 0.6],
            most: [0.15, 0.05],
            limits: GearLimits::NONE,
        }
    }

    /// Cycles until the plan is made anew, and with what.
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
    fn only_what_is_surely_heard_to_be_other_is_planned_for() {
        assert!(anew(None, NONE).is_none());
        assert!(anew(heard(0.31, 0.01, 0.06), NONE).is_none());
        assert!(anew(heard(0.40, 0.03, 0.05), NONE).is_none());
        let (cycles, wanted) = anew(heard(0.34, 0.01, 0.05), NONE).unwrap();
        assert_eq!(cycles, u32::from(APART) + u32::from(PATIENCE) - 1);
        assert!((wanted.restitution_low - 0.32).abs() < 1e-6);
        assert!((wanted.restitution_high - 0.36).abs() < 1e-6);
        assert_eq!(wanted.second_tone, 0.15);
        let (_, wanted) = anew(heard(0.3, 0.01, 0.08), NONE).unwrap();
        assert_eq!(wanted.scatter, 0.08);
    }

    #[test]
    fn a_lot_of_one_restitution_stays_while_that_is_heard() {
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
        assert_eq!(cycles, u32::from(PATIENCE));
        assert_eq!((wanted.second_tone, wanted.third_tone), (0.0, 0.0));
        let (_, wanted) = anew(None, [false, true]).unwrap();
        assert_eq!((wanted.second_tone, wanted.third_tone), (0.15, 0.0));
        assert!((wanted.restitution_high - 0.32).abs() < 1e-6);
    }
}
