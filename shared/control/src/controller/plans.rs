//! Results of one controller's searches, supplied to another with equal settings (memoization).

use super::Controller;
use crate::aim::{GearPlanned, GearSearch, KickResult};
use kband::regime::capture::PlanSettings;
use kband::regime::gear::{GearPlan, GearPlanSettings, StrikeCount, StrikeSettings};

impl Controller {
    /// The search for kicks that [`Controller::plan_step`] runs; `None` if there is none.
    pub fn kicks_search(&self) -> Option<&PlanSettings> {
        self.selection.search.pending_settings()
    }

    /// Supplies the result of the search of [`Controller::kicks_search`], from another controller.
    pub fn supply_kicks(&mut self, stored: KickResult) {
        self.selection.search.supply(stored);
    }

    /// The finished search for kicks of the present target.
    pub fn planned(&self) -> Option<KickResult> {
        self.selection.search.planned()
    }

    /// The search for gear that [`Controller::plan_step`] runs; `None` if there is none.
    pub fn gear_search(&self) -> Option<&GearPlanSettings> {
        let gear = self.selection.gear.as_ref();
        gear.and_then(GearSearch::pending_settings)
    }

    /// Supplies the result of the search of [`Controller::gear_search`], from another controller.
    pub fn supply_gear(&mut self, stored: GearPlanned) {
        if let Some(gear) = &mut self.selection.gear {
            gear.supply(stored);
        }
    }

    /// The finished search for gear of the present target.
    pub fn gear_planned(&self) -> Option<&GearPlanned> {
        self.selection.gear.as_ref().and_then(GearSearch::planned)
    }

    /// The best plan for gear so far; `None` for another target, and before a first k is found.
    pub fn gear(&self) -> Option<GearPlan> {
        self.selection.plan
    }

    /// The count of strikes that [`Controller::plan_step`] runs; `None` if there is none.
    pub fn strikes_search(&self) -> Option<&StrikeSettings> {
        self.listener.share.profiler.as_ref()?.pending_settings()
    }

    /// Supplies the count of [`Controller::strikes_search`], made elsewhere.
    pub fn supply_strikes(&mut self, count: &StrikeCount) {
        if let Some(profiler) = &mut self.listener.share.profiler {
            profiler.set_stored_result(count);
        }
    }
}
