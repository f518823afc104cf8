//! The amplitude at which the parts stay in gear the longest (docs/theory-real-parts.md#t10.8).
//!
//! The search is the planner of `regime::gear`. This module sets its limits in k and its slices.

use super::setpoint::{Choice, Level, NoSetpoint};
use crate::drive::{Scale, absolute, upper_response};
use crate::{Settings, Shape};
use kband::feeder::OutOfRange;
use kband::regime::band;
use kband::regime::gear::{GearLimits, GearPlan, GearPlanSettings, GearPlanner};

const SLICE_IMPACTS: u32 = 64;
/// Lowest k of the search, times the order: below it no restitution has a band of order 1.
const MIN_K: f64 = 0.28;
/// Highest k of the search over the birth of the lock at the lot's highest restitution.
const MAX_K_OVER_BIRTH: f64 = 1.02;
/// Highest k of the search for any lot: from k = 1 the track throws no resting part.
const MAX_K: f64 = 0.98;

/// Limits in k of the configured drive at its configured frequency.
pub fn drive_limits(settings: &Settings) -> GearLimits {
    limits_at(settings, &Scale::from_settings(settings))
}

fn limits_at(settings: &Settings, scale: &Scale) -> GearLimits {
    let [amplitude, acceleration] = settings.reference_limits();
    GearLimits {
        displacement: scale.k(amplitude * 1e-3),
        acceleration: scale.normal_gravity / acceleration,
        output: scale.k(settings.output_maximum * scale.full_amplitude),
        overtones: upper_response(settings)
            .map(|response| scale.full_amplitude / absolute(response)),
    }
}

/// A finished search for gear: its settings, and its plans with the slices that found them. Equal
/// settings give the same plans after as many slices ([`crate::Controller::supply_gear`]).
#[cfg(any(test, feature = "memo"))]
#[derive(Clone, Debug, PartialEq)]
pub struct GearPlanned {
    /// Settings of the search.
    pub settings: GearPlanSettings,
    /// Each plan with the number of the slice that found it; the last one is settled.
    pub result: heapless::Vec<(u32, GearPlan), 8>,
}

/// The search for the k at which the lot stays in gear the longest, within the drive's reach.
#[derive(Clone, Debug)]
pub struct GearSearch {
    pub planner: GearPlanner,
    pub plan: Option<GearPlan>,
    /// Slices so far, the plans that they found, and whether these were supplied.
    #[cfg(any(test, feature = "memo"))]
    memo: (u32, GearPlanned, bool),
}

impl GearSearch {
    /// Begins the search for an order, or gives the reason for no setpoint.
    pub fn begin(
        order: u8,
        settings: &Settings,
        scale: &Scale,
    ) -> Result<Result<Self, NoSetpoint>, OutOfRange> {
        let lot = settings.lot()?;
        let (highest_restitution, contact) = (lot.high().min(0.99), settings.contact_time());
        let [edge, _] = band::edges_with_contact(highest_restitution, u32::from(order), contact)?;
        let birth_k = band::birth(highest_restitution, u32::from(order))?.max(edge);
        let high = (MAX_K_OVER_BIRTH * birth_k).min(MAX_K) as f32;
        let lowest_k = scale.k(scale.reach(settings));
        if lowest_k > high {
            return Ok(Err(NoSetpoint::Gear {
                needed: scale.amplitude(high) * 1e3,
            }));
        }
        let pending_settings = GearPlanSettings {
            restitution: lot,
            scatter: settings.scatter,
            amplitude_error: settings.amplitude_error,
            order: u32::from(order),
            k: [lowest_k.max((MIN_K / f64::from(order)) as f32), high],
            max_tones: [settings.second_tone, settings.third_tone],
            limits: limits_at(settings, scale),
            contact,
        };
        Ok(Ok(Self {
            planner: GearPlanner::new(pending_settings)?,
            plan: None,
            #[cfg(any(test, feature = "memo"))]
            memo: (
                0,
                GearPlanned {
                    settings: pending_settings,
                    result: heapless::Vec::new(),
                },
                false,
            ),
        }))
    }

    /// Computes one slice. Returns whether more remain, and the plan that it found.
    pub fn step(&mut self) -> (bool, Option<GearPlan>) {
        #[cfg(any(test, feature = "memo"))]
        if let (slices, planned, true) = &mut self.memo {
            *slices += 1;
            let mut results = planned.result.iter();
            let found = results.find_map(|(after, plan)| (after == slices).then_some(*plan));
            self.plan = found.or(self.plan);
            return (!self.is_over(), found);
        }
        let more = self.planner.advance(SLICE_IMPACTS);
        let plan = self.planner.plan().copied();
        let found = plan.filter(|plan| self.plan != Some(*plan));
        self.plan = found.or(self.plan);
        #[cfg(any(test, feature = "memo"))]
        {
            self.memo.0 += 1;
            if let Some(plan) = found {
                let _ = self.memo.1.result.push((self.memo.0, plan));
            }
        }
        (more, found)
    }

    /// Settings of the running search; `None` once a result is supplied or found.
    #[cfg(any(test, feature = "memo"))]
    pub fn pending_settings(&self) -> Option<&GearPlanSettings> {
        Some(&self.memo.1.settings).filter(|_| !self.is_over() && !self.memo.2)
    }

    /// Supplies the result of an equal search. Its plans appear after the same numbers of slices.
    #[cfg(any(test, feature = "memo"))]
    pub fn supply(&mut self, stored: GearPlanned) {
        if self.pending_settings() == Some(&stored.settings) {
            (self.memo.1, self.memo.2) = (stored, true);
        }
    }

    #[cfg(any(test, feature = "memo"))]
    pub fn planned(&self) -> Option<&GearPlanned> {
        Some(&self.memo.1).filter(|_| self.is_over())
    }

    pub fn is_over(&self) -> bool {
        self.plan.is_some_and(|plan| plan.settled)
    }

    pub fn choice(&self) -> Choice {
        let Some(plan) = self.plan else {
            return Choice::level(Level::Pending);
        };
        Choice {
            shape: Shape::from_tones(plan.tones),
            ..Choice::level(Level::K(f64::from(plan.k)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;

    #[test]
    fn weak_drive_gets_the_sufficient_amplitude() {
        let settings = with(Settings::default(), |it| it.gain = 0.1);
        let scale = Scale::from_settings(&settings);
        let Err(NoSetpoint::Gear { needed }) = GearSearch::begin(1, &settings, &scale).unwrap()
        else {
            panic!("no amplitude of this drive throws the parts so far");
        };
        for (factor, suffices) in [(0.99, false), (1.01, true)] {
            let gain = needed / settings.output_maximum * factor;
            let served = with(settings, |it| it.gain = gain);
            let scale = Scale::from_settings(&served);
            let begun = GearSearch::begin(1, &served, &scale).unwrap();
            assert_eq!(begun.is_ok(), suffices, "{factor}");
        }
    }

    #[test]
    fn replayed_search_repeats_plans_and_slices() {
        let settings = Settings::default();
        let search = |settings: &Settings| {
            let begun = GearSearch::begin(1, settings, &Scale::from_settings(settings));
            begun.unwrap().unwrap()
        };
        let mut first = search(&settings);
        let mut supplied = search(&settings);
        let mut result = std::vec![];
        while first.step().0 {
            result.push(first.plan);
        }
        let planned = first.planned().unwrap().clone();
        assert!(planned.result.len() > 3);
        // The result of another lot is refused.
        let mut other = search(&with(settings, |it| it.restitution_high = 0.3));
        other.supply(planned.clone());
        assert!(other.pending_settings().is_some());
        supplied.step();
        supplied.supply(planned.clone());
        assert_eq!(supplied.plan, result[0]);
        for plan in &result[1..] {
            assert!(supplied.step().0);
            assert_eq!(supplied.plan, *plan);
        }
        assert!(!supplied.step().0 && supplied.is_over());
        assert_eq!(supplied.planned(), Some(&planned));
    }
}
