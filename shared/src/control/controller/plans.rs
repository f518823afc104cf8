//! Results of one controller's searches, supplied to another with equal settings (memoization).

use super::Controller;
use crate::control::aim::{Chaos, ChaosSearch, GearPlanned, GearSearch, Planned};
use crate::regime::capture::PlanSettings;
use crate::regime::gear::{GearPlan, GearPlanSettings, StrikeCount, StrikeSettings};

impl Controller {
    /// The search for kicks that [`Controller::plan_step`] runs; `None` where there is none.
    #[must_use]
    pub fn planning(&self) -> Option<&PlanSettings> {
        self.selection.search.asked()
    }

    /// Supplies the result of the search of [`Controller::planning`], from another controller.
    pub fn plan_known(&mut self, known: Planned) {
        self.selection.search.know(known);
    }

    /// The finished search for kicks of the present target.
    #[must_use]
    pub fn planned(&self) -> Option<Planned> {
        self.selection.search.planned()
    }

    /// The search for gear that [`Controller::plan_step`] runs; `None` where there is none.
    #[must_use]
    pub fn gear_asked(&self) -> Option<&GearPlanSettings> {
        self.selection.gear.as_ref().and_then(GearSearch::asked)
    }

    /// Supplies the result of the search of [`Controller::gear_asked`], from another controller.
    pub fn gear_known(&mut self, known: GearPlanned) {
        if let Some(gear) = &mut self.selection.gear {
            gear.know(known);
        }
    }

    /// The finished search for gear of the present target.
    #[must_use]
    pub fn gear_planned(&self) -> Option<&GearPlanned> {
        self.selection.gear.as_ref().and_then(GearSearch::planned)
    }

    /// The best plan for gear so far; `None` for another target, and before a first k is found.
    #[must_use]
    pub fn gear(&self) -> Option<GearPlan> {
        self.selection.gear_plan().copied()
    }

    /// The count of strikes that [`Controller::plan_step`] runs; `None` where there is none.
    #[must_use]
    pub fn strikes_asked(&self) -> Option<&StrikeSettings> {
        self.listener.share.asked()
    }

    /// Supplies the count of [`Controller::strikes_asked`], made elsewhere.
    pub fn strikes_known(&mut self, count: &StrikeCount) {
        self.listener.share.know(count);
    }

    /// The lot whose chaos [`Controller::plan_step`] searches for; `None` where there is no search.
    #[must_use]
    pub fn chaos_asked(&self) -> Option<[f32; 2]> {
        self.selection.chaos.as_ref().and_then(ChaosSearch::asked)
    }

    /// Supplies the result of the search of [`Controller::chaos_asked`], from another controller.
    pub fn chaos_known(&mut self, known: Chaos) {
        if let Some(chaos) = &mut self.selection.chaos {
            chaos.know(known);
        }
    }

    /// The finished search for chaos of the present target.
    #[must_use]
    pub fn chaos_found(&self) -> Option<Chaos> {
        self.selection.found_chaos().copied()
    }
}
