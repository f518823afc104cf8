//! The amplitude at which the parts stay in gear the longest (docs/theory-real-parts.md#t10.8).
//!
//! The search is the planner of `regime::gear`; here are its limits in k, and its slices.

use super::setpoint::{Choice, Level, NoSetpoint};
use crate::drive::{Scale, Shape, absolute, upper_response};
use crate::settings::Settings;
use kband::feeder::OutOfRange;
use kband::regime::band;
use kband::regime::gear::{GearLimits, GearPlan, GearPlanSettings, GearPlanner};

/// Impacts that one slice computes.
const SLICE: u32 = 64;
/// Lowest k of the search, times the order: below it no restitution has a band of order 1.
const MIN_K: f64 = 0.28;
/// Highest k of the search over the birth of the lock at the lot's highest restitution.
const MAX_K_OVER_BIRTH: f64 = 1.02;
/// Highest k of the search for any lot: from k = 1 the track throws no resting part.
const MAX_K: f64 = 0.98;

/// Limits in k of the configured drive at its configured frequency.
pub fn drive_limits(settings: &Settings) -> GearLimits {
    limits_at(settings, &Scale::at(settings, settings.frequency))
}

fn limits_at(settings: &Settings, scale: &Scale) -> GearLimits {
    GearLimits {
        displacement: scale.k(settings.amplitude_limit * 1e-3),
        acceleration: scale.normal_gravity / settings.acceleration_limit,
        output: scale.k(settings.output_maximum * scale.full_amplitude),
        overtones: upper_response(settings).map(|answer| scale.full_amplitude / absolute(answer)),
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
    pub found: heapless::Vec<(u32, GearPlan), 8>,
}

/// The search for the k at which the lot stays in gear the longest, within the drive's reach.
#[derive(Clone, Debug)]
pub struct GearSearch {
    planner: GearPlanner,
    plan: Option<GearPlan>,
    /// Whether the last slice found a new plan.
    fresh: bool,
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
        let turns = f64::from(order);
        let (liveliest, contact) = (lot.high().min(0.99), settings.contact_time());
        let [edge, _] = band::edges_with_contact(liveliest, u32::from(order), contact)?;
        let born = band::birth(liveliest, u32::from(order))?.max(edge);
        let high = (MAX_K_OVER_BIRTH * born).min(MAX_K) as f32;
        let reached = scale.k(scale.reach(settings));
        if reached > high {
            return Ok(Err(NoSetpoint::Gear {
                needed: scale.amplitude(high) * 1e3,
            }));
        }
        let asked = GearPlanSettings {
            restitution: lot,
            scatter: settings.scatter,
            amplitude_error: settings.amplitude_error,
            order: u32::from(order),
            k: [reached.max((MIN_K / turns) as f32), high],
            max_tones: [settings.second_tone, settings.third_tone],
            limits: limits_at(settings, scale),
            contact,
        };
        Ok(Ok(Self {
            planner: GearPlanner::new(asked)?,
            plan: None,
            fresh: false,
            #[cfg(any(test, feature = "memo"))]
            memo: (
                0,
                GearPlanned {
                    settings: asked,
                    found: heapless::Vec::new(),
                },
                false,
            ),
        }))
    }

    /// Computes one slice. Whether more remain.
    pub fn step(&mut self) -> bool {
        #[cfg(any(test, feature = "memo"))]
        if let (slices, planned, true) = &mut self.memo {
            *slices += 1;
            let found = planned.found.iter().find(|(after, _)| after == slices);
            let found = found.map(|(_, plan)| *plan);
            self.take(found);
            return !self.is_over();
        }
        let more = self.planner.advance(SLICE);
        let found = self.planner.plan().copied();
        self.take(found.filter(|plan| self.plan != Some(*plan)));
        #[cfg(any(test, feature = "memo"))]
        {
            self.memo.0 += 1;
            if let Some(plan) = self.last_plan().copied() {
                let _ = self.memo.1.found.push((self.memo.0, plan));
            }
        }
        more
    }

    fn take(&mut self, found: Option<GearPlan>) {
        self.fresh = found.is_some();
        self.plan = found.or(self.plan);
    }

    /// Settings of the running search; `None` once a result is supplied or found.
    #[cfg(any(test, feature = "memo"))]
    pub fn asked(&self) -> Option<&GearPlanSettings> {
        Some(&self.memo.1.settings).filter(|_| !self.is_over() && !self.memo.2)
    }

    /// Supplies the result of an equal search. Its plans appear after the same numbers of slices.
    #[cfg(any(test, feature = "memo"))]
    pub fn supply(&mut self, known: GearPlanned) {
        if self.asked() == Some(&known.settings) {
            (self.memo.1, self.memo.2) = (known, true);
        }
    }

    /// The finished search.
    #[cfg(any(test, feature = "memo"))]
    pub fn planned(&self) -> Option<&GearPlanned> {
        Some(&self.memo.1).filter(|_| self.is_over())
    }

    pub fn settings(&self) -> &GearPlanSettings {
        self.planner.settings()
    }

    pub fn is_over(&self) -> bool {
        self.plan.is_some_and(|plan| plan.settled)
    }

    /// The best plan so far.
    pub fn plan(&self) -> Option<&GearPlan> {
        self.plan.as_ref()
    }

    /// The plan of the last slice, if it found a new one.
    pub fn last_plan(&self) -> Option<&GearPlan> {
        self.plan().filter(|_| self.fresh)
    }

    /// The setpoint of the best plan so far.
    pub fn choice(&self) -> Choice {
        let Some(plan) = self.plan() else {
            return Choice::level(Level::Pending);
        };
        Choice {
            shape: Shape::of(plan.tones),
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
        let scale = Scale::at(&settings, 50.0);
        let Err(NoSetpoint::Gear { needed }) = GearSearch::begin(1, &settings, &scale).unwrap()
        else {
            panic!("no amplitude of this drive throws the parts so far");
        };
        let served = Settings {
            gain: needed / settings.output_maximum * 1.01,
            ..settings
        };
        let scale = Scale::at(&served, 50.0);
        assert!(GearSearch::begin(1, &served, &scale).unwrap().is_ok());
    }

    #[test]
    fn replayed_search_repeats_plans_and_slices() {
        let settings = Settings::default();
        let search = |settings: &Settings| {
            let scale = Scale::at(settings, settings.frequency);
            GearSearch::begin(1, settings, &scale).unwrap().unwrap()
        };
        let mut first = search(&settings);
        let mut spared = search(&settings);
        let mut found = std::vec![];
        while first.step() {
            found.push(first.plan().copied());
        }
        let planned = first.planned().unwrap().clone();
        assert!(planned.found.len() > 3);
        // The result of another lot is refused.
        let mut other = search(&with(settings, |it| it.restitution_high = 0.3));
        other.supply(planned.clone());
        assert!(other.asked().is_some());
        spared.step();
        spared.supply(planned.clone());
        assert_eq!(spared.plan().copied(), found[0]);
        for plan in &found[1..] {
            assert!(spared.step());
            assert_eq!(spared.plan(), plan.as_ref());
        }
        assert!(!spared.step() && spared.is_over());
        assert_eq!(spared.planned(), Some(&planned));
    }
}
