//! A plan for gear from another controller: the desk runs many with equal settings (memoization).

use core::ops::Deref;

use heapless::Vec;

use super::gear::GearSearch;
use super::setpoint::NoSetpoint;
use crate::drive::Scale;
use crate::settings::Settings;
use kband::feeder::OutOfRange;
use kband::regime::gear::{GearPlan, GearPlanSettings};

/// Largest number of plans of one search, each better than the one before.
const FOUND: usize = 8;

/// A finished search for gear: its settings, and its plans with the slices that found them.
///
/// Equal settings give the same plans after the same numbers of slices. A controller that gets the
/// result of another one skips the search
/// ([`Controller::supply_gear`](crate::Controller::supply_gear)).
#[derive(Clone, Debug, PartialEq)]
pub struct GearPlanned {
    /// Settings of the search.
    pub settings: GearPlanSettings,
    /// Each plan with the number of the slice that found it; the last one is settled.
    pub found: Vec<(u32, GearPlan), FOUND>,
}

/// A [`GearSearch`] that records its plans, or replays those of another one.
#[derive(Clone, Debug)]
pub struct ReplayedGear {
    search: GearSearch,
    slices: u32,
    planned: GearPlanned,
    /// Whether `planned` was supplied.
    known: bool,
}

impl Deref for ReplayedGear {
    type Target = GearSearch;

    fn deref(&self) -> &GearSearch {
        &self.search
    }
}

impl ReplayedGear {
    /// As [`GearSearch::begin`].
    pub fn begin(
        order: u8,
        settings: &Settings,
        scale: &Scale,
    ) -> Result<Result<Self, NoSetpoint>, OutOfRange> {
        Ok(
            GearSearch::begin(order, settings, scale)?.map(|search| Self {
                planned: GearPlanned {
                    settings: *search.settings(),
                    found: Vec::new(),
                },
                search,
                slices: 0,
                known: false,
            }),
        )
    }

    /// As [`GearSearch::step`].
    pub fn step(&mut self) -> bool {
        self.slices = self.slices.saturating_add(1);
        if self.known {
            let mut found = self.planned.found.iter();
            let found = found.find(|(after, _)| *after == self.slices);
            self.search.take(found.map(|(_, plan)| *plan));
            return !self.is_over();
        }
        let more = self.search.step();
        if let Some(plan) = self.last_plan().copied() {
            // At most one per round, and there are no more rounds.
            let _ = self.planned.found.push((self.slices, plan));
        }
        more
    }

    /// Settings of the running search; `None` once a result is supplied or found.
    pub fn asked(&self) -> Option<&GearPlanSettings> {
        Some(&self.planned.settings).filter(|_| !self.is_over() && !self.known)
    }

    /// Supplies the result of an equal search. Its plans appear after the same numbers of slices.
    pub fn supply(&mut self, known: GearPlanned) {
        if self.asked() == Some(&known.settings) {
            self.planned = known;
            self.known = true;
        }
    }

    /// The finished search.
    pub fn planned(&self) -> Option<&GearPlanned> {
        Some(&self.planned).filter(|_| self.is_over())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn search(settings: &Settings) -> ReplayedGear {
        let scale = Scale::at(settings, settings.frequency);
        ReplayedGear::begin(1, settings, &scale).unwrap().unwrap()
    }

    #[test]
    fn replayed_search_repeats_plans_and_slices() {
        let settings = Settings::default();
        let mut first = search(&settings);
        let mut spared = search(&settings);
        let mut found = std::vec![];
        while first.step() {
            found.push(first.plan().copied());
        }
        let planned = first.planned().unwrap().clone();
        assert!(planned.found.len() > 3);
        // The result of another lot is refused.
        let mut other = search(&Settings {
            restitution_high: 0.3,
            ..settings
        });
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
