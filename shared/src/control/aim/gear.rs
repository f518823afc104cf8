//! The amplitude at which the parts stay in gear the longest, planned slice by slice.

#[cfg(any(test, feature = "unstable"))]
use heapless::Vec;

use super::setpoint::{Choice, Level, NoSetpoint};
use crate::control::drive::{Answer, Scale, SecondTone};
use crate::control::settings::Settings;
use crate::feeder::OutOfRange;
use crate::regime::band;
use crate::regime::gear::{GearLimits, GearPlan, GearPlanSettings, GearPlanner};

/// Impacts that one slice computes.
const SLICE: u32 = 64;
/// Lowest k that is tried, times the order: below 0.28 no restitution has a band of order 1, nor had any lot its best
/// k there.
const LOWEST: f64 = 0.28;
/// Highest k that is tried over the birth of the liveliest part's lock; above, only what is transient is in gear.
/// From 0.95 to 1.1 every test and scene passes.
const HIGHEST: f64 = 1.02;
/// Highest k that is tried, whatever the lot: at 1 and above the track throws no part that rests. From 0.9 to 1
/// every test and scene passes.
const THROWS: f64 = 0.98;

/// A plan for gear that has come to its end: what was asked, and what was found after how many slices.
///
/// Two controllers with the same question find the same after as many slices, so that one that is told need not search
/// ([`Controller::gear_known`](crate::control::Controller::gear_known)).
#[cfg(any(test, feature = "unstable"))]
#[derive(Clone, Debug, PartialEq)]
pub struct GearPlanned {
    /// What was asked.
    pub settings: GearPlanSettings,
    /// What was found, and the slice after which it was, the last one settled.
    pub found: Vec<(u32, GearPlan), FOUND>,
}

/// Most plans, each better than the one before, that a search finds.
#[cfg(any(test, feature = "unstable"))]
pub const FOUND: usize = 8;

/// The search for the k at which the lot is in gear the longest, within what the drive reaches.
#[derive(Clone, Debug)]
pub struct GearSearch {
    planner: GearPlanner,
    plan: Option<GearPlan>,
    #[cfg(any(test, feature = "unstable"))]
    slices: u32,
    #[cfg(any(test, feature = "unstable"))]
    planned: GearPlanned,
    #[cfg(any(test, feature = "unstable"))]
    known: Option<GearPlanned>,
}

impl GearSearch {
    /// The search for an order, or why there is no setpoint for it; the refusal names the parameter.
    pub fn begin(
        order: u8,
        settings: &Settings,
        scale: &Scale,
    ) -> Result<Result<Self, NoSetpoint>, OutOfRange> {
        let lot = settings.lot()?;
        let turns = f64::from(order);
        let born = band::birth(lot.high().min(0.99), u32::from(order))?;
        let high = (HIGHEST * born).min(THROWS) as f32;
        let reached = scale.k(scale.reach(settings));
        if reached > high {
            return Ok(Err(NoSetpoint::Gear {
                needed: scale.amplitude(high) * 1e3,
            }));
        }
        let asked = GearPlanSettings {
            restitution: lot,
            scatter: settings.scatter,
            order: u32::from(order),
            k: [reached.max((LOWEST / turns) as f32), high],
            second_tone: settings.second_tone,
            limits: GearLimits {
                displacement: scale.k(settings.amplitude_limit * 1e-3),
                acceleration: scale.normal_gravity / settings.acceleration_limit,
                output: scale.k(settings.output_maximum * scale.strength),
                overtone: scale.strength / libm::sqrtf(Answer::at(settings).second.norm_sqr()),
            },
        };
        Ok(Ok(Self {
            planner: GearPlanner::new(asked)?,
            plan: None,
            #[cfg(any(test, feature = "unstable"))]
            slices: 0,
            #[cfg(any(test, feature = "unstable"))]
            planned: GearPlanned {
                settings: asked,
                found: Vec::new(),
            },
            #[cfg(any(test, feature = "unstable"))]
            known: None,
        }))
    }

    /// One slice; whether more are to be done.
    pub fn step(&mut self) -> bool {
        #[cfg(any(test, feature = "unstable"))]
        {
            self.slices = self.slices.saturating_add(1);
            if let Some(known) = &self.known {
                let slices = self.slices;
                let found = known.found.iter().rev();
                self.plan = found
                    .clone()
                    .find(|(after, _)| *after <= slices)
                    .map(|(_, plan)| *plan);
                return !self.is_over();
            }
        }
        let more = self.planner.advance(SLICE);
        let plan = self.planner.plan().copied();
        #[cfg(any(test, feature = "unstable"))]
        if let Some(plan) = plan
            && self.plan != Some(plan)
        {
            // One for each round at most, and there are no more rounds.
            let _ = self.planned.found.push((self.slices, plan));
        }
        self.plan = plan;
        more
    }

    /// What is searched for.
    pub fn settings(&self) -> &GearPlanSettings {
        self.planner.settings()
    }

    /// Whether there is nothing more to find.
    pub fn is_over(&self) -> bool {
        self.plan.is_some_and(|plan| plan.settled)
    }

    /// What was found so far.
    pub fn plan(&self) -> Option<&GearPlan> {
        self.plan.as_ref()
    }

    /// The choice so far.
    pub fn choice(&self) -> Choice {
        let Some(plan) = self.plan() else {
            return Choice::level(Level::Sought);
        };
        let [ratio, phase] = plan.second;
        Choice {
            second: SecondTone { ratio, phase },
            ..Choice::level(Level::K(f64::from(plan.k)))
        }
    }

    /// What is being searched; `None` once it is known or found.
    #[cfg(any(test, feature = "unstable"))]
    pub fn asked(&self) -> Option<&GearPlanSettings> {
        Some(&self.planned.settings).filter(|_| !self.is_over() && self.known.is_none())
    }

    /// Spares the search, if it is for this: the same is then found after as many slices.
    #[cfg(any(test, feature = "unstable"))]
    pub fn know(&mut self, known: GearPlanned) {
        if self.asked() == Some(&known.settings) {
            self.known = Some(known);
        }
    }

    /// The search that has come to its end.
    #[cfg(any(test, feature = "unstable"))]
    pub fn planned(&self) -> Option<&GearPlanned> {
        Some(self.known.as_ref().unwrap_or(&self.planned)).filter(|_| self.is_over())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn search(settings: &Settings) -> GearSearch {
        let scale = Scale::at(settings, settings.frequency);
        GearSearch::begin(1, settings, &scale).unwrap().unwrap()
    }

    #[test]
    fn a_search_that_is_spared_finds_the_same_at_the_same_slices() {
        let settings = Settings::default();
        let mut first = search(&settings);
        let mut spared = search(&settings);
        let mut found = std::vec![];
        while first.step() {
            found.push(first.plan().copied());
        }
        let planned = first.planned().unwrap().clone();
        assert!(planned.found.len() > 3);
        // Of another lot nothing is taken.
        let mut other = search(&Settings {
            restitution_high: 0.3,
            ..settings
        });
        other.know(planned.clone());
        assert!(other.asked().is_some());
        spared.step();
        spared.know(planned.clone());
        assert_eq!(spared.plan().copied(), found[0]);
        for plan in &found[1..] {
            assert!(spared.step());
            assert_eq!(spared.plan(), plan.as_ref());
        }
        assert!(!spared.step() && spared.is_over());
        assert_eq!(spared.planned(), Some(&planned));
    }

    #[test]
    fn a_drive_that_is_too_weak_is_told_what_would_serve() {
        let settings = Settings {
            gain: 0.1,
            ..Settings::default()
        };
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
}
