//! What one controller has searched for, told to another that asks the same.

use super::Controller;
use crate::control::aim::{Chaos, ChaosSearch, GearPlanned, GearSearch, Planned};
use crate::regime::capture::PlanSettings;
use crate::regime::gear::{GearPlan, GearPlanSettings, StrikeCount, StrikeSettings};

impl Controller {
    /// The kicks that [`Controller::plan_step`] is searching for; `None` where there is nothing to search.
    #[must_use]
    pub fn planning(&self) -> Option<&PlanSettings> {
        self.selection.search.asked()
    }

    /// Spares the search that [`Controller::planning`] tells of, where another controller has done it.
    pub fn plan_known(&mut self, known: Planned) {
        self.selection.search.know(known);
    }

    /// The search that has come to its end for the present target.
    #[must_use]
    pub fn planned(&self) -> Option<Planned> {
        self.selection.search.planned()
    }

    /// The plan for gear that [`Controller::plan_step`] is searching for; `None` where there is nothing to search.
    #[must_use]
    pub fn gear_asked(&self) -> Option<&GearPlanSettings> {
        self.selection.gear.as_ref().and_then(GearSearch::asked)
    }

    /// Spares the search that [`Controller::gear_asked`] tells of, where another controller has done it.
    pub fn gear_known(&mut self, known: GearPlanned) {
        if let Some(gear) = &mut self.selection.gear {
            gear.know(known);
        }
    }

    /// The plan for gear that has come to its end for the present target.
    #[must_use]
    pub fn gear_planned(&self) -> Option<&GearPlanned> {
        self.selection.gear.as_ref().and_then(GearSearch::planned)
    }

    /// What the plan for gear has found so far; `None` for another target, and until a first k is found.
    #[must_use]
    pub fn gear(&self) -> Option<GearPlan> {
        self.selection.gear_plan().copied()
    }

    /// The strikes that [`Controller::plan_step`] is counting; `None` where there is nothing to count.
    #[must_use]
    pub fn strikes_asked(&self) -> Option<&StrikeSettings> {
        self.listener.share.asked()
    }

    /// Spares the count that [`Controller::strikes_asked`] tells of, where it was made elsewhere.
    pub fn strikes_known(&mut self, count: &StrikeCount) {
        self.listener.share.know(count);
    }

    /// The lot whose chaos [`Controller::plan_step`] is searching for; `None` where there is nothing to search.
    #[must_use]
    pub fn chaos_asked(&self) -> Option<[f32; 2]> {
        self.selection.chaos.as_ref().and_then(ChaosSearch::asked)
    }

    /// Spares the search that [`Controller::chaos_asked`] tells of, where another controller has done it.
    pub fn chaos_known(&mut self, known: Chaos) {
        if let Some(chaos) = &mut self.selection.chaos {
            chaos.know(known);
        }
    }

    /// The search for chaos that has come to its end for the present target.
    #[must_use]
    pub fn chaos_found(&self) -> Option<Chaos> {
        self.selection.found_chaos().copied()
    }
}
