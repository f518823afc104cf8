//! The search for the kicks that throw parts onto the wanted orbit.

use core::task::Poll;

use crate::control::hear::LockWindow;
use crate::control::settings::Settings;
use crate::feeder::OutOfRange;
use crate::impact::Hybrid;
use crate::regime::capture::{DriveLag, DriveLagSettings, Lot, Plan, PlanSettings, Planner};

/// Impacts that one slice of planning computes: at most 0.2 million instructions, which 300 drive cycles a
/// second leave time for.
const SLICE: u32 = 20;
/// Highest amplitude of a kick over the setpoint that is planned.
const HIGHEST: f32 = 2.5;

/// A search that has come to its end: what was asked, what came, after how many slices.
///
/// Two controllers with the same question come to the same plan after as many slices, so that one that
/// is told need not search ([`Controller::plan_known`](crate::control::Controller::plan_known)).
#[derive(Clone, Debug, PartialEq)]
pub struct Planned {
    /// What was asked.
    pub settings: PlanSettings,
    /// The plan.
    pub plan: Plan,
    /// Slices that it took.
    pub slices: u32,
}

/// The search for kicks, slice by slice; by default there is nothing to search.
#[derive(Clone, Debug, Default)]
pub struct Search {
    planner: Option<Planner<Hybrid>>,
    #[cfg(any(test, feature = "unstable"))]
    settings: Option<PlanSettings>,
    slices: u32,
    known: Option<Planned>,
    plan: Option<Plan>,
}

impl Search {
    /// A search for the kicks that bring the lot onto a lock whose amplitude a kick may exceed `reserve`
    /// times.
    pub fn begin(settings: &Settings, lock: &LockWindow, reserve: f32) -> Result<Self, OutOfRange> {
        let envelope = f64::from(settings.envelope);
        let settings = PlanSettings {
            lot: Lot {
                k: lock.k,
                restitution: settings.lot()?,
                order: u32::from(lock.order),
                amplitude_error: f64::from(settings.amplitude_error),
            },
            drive: DriveLag::build(DriveLagSettings {
                time_constant: envelope,
                start: 1.0,
                limit: f64::from(reserve.clamp(1.0, HIGHEST)),
            })?,
            time_constant: envelope,
            effort: PlanSettings::EFFORT,
        };
        Ok(Self {
            planner: Some(Planner::new(settings)?),
            #[cfg(any(test, feature = "unstable"))]
            settings: Some(settings),
            ..Self::default()
        })
    }

    /// One slice; whether more are to be done.
    pub fn step(&mut self) -> bool {
        let Some(planner) = &mut self.planner else {
            return false;
        };
        self.slices = self.slices.saturating_add(1);
        let progress = match &self.known {
            Some(known) if self.slices < known.slices => Poll::Pending,
            Some(known) => Poll::Ready(known.plan.clone()),
            None => planner.advance(SLICE),
        };
        match progress {
            Poll::Pending => true,
            Poll::Ready(plan) => {
                self.planner = None;
                self.plan = Some(plan);
                false
            }
        }
    }

    /// What is being searched; `None` once it is known or found.
    #[cfg(any(test, feature = "unstable"))]
    pub fn asked(&self) -> Option<&PlanSettings> {
        self.settings
            .as_ref()
            .filter(|_| self.planner.is_some() && self.known.is_none())
    }

    /// Spares the search, if it is for this: the plan then comes after as many slices as it took.
    #[cfg(any(test, feature = "unstable"))]
    pub fn know(&mut self, known: Planned) {
        if self.asked() == Some(&known.settings) {
            self.known = Some(known);
        }
    }

    /// The search that came to its end.
    #[cfg(any(test, feature = "unstable"))]
    pub fn planned(&self) -> Option<Planned> {
        Some(Planned {
            settings: self.settings?,
            plan: self.plan.clone()?,
            slices: self.slices,
        })
    }

    /// The plan, once it is there.
    #[must_use]
    pub fn plan(&self) -> Option<&Plan> {
        self.plan.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::aim::setpoint::Choice;

    #[test]
    fn a_kick_goes_as_far_as_the_reserve_but_no_further_than_the_highest() {
        let settings = Settings::default();
        let lock = Choice::lock(1, &settings).unwrap().lock.unwrap();
        for (reserve, limit) in [(0.5, 1.0), (1.3, 1.3), (2.4, 2.4), (9.0, 2.5)] {
            let search = Search::begin(&settings, &lock, reserve).unwrap();
            let asked = search.asked().unwrap().drive;
            let wanted = DriveLag::build(DriveLagSettings {
                time_constant: f64::from(settings.envelope),
                start: 1.0,
                limit: f64::from(limit as f32),
            });
            assert_eq!(asked, wanted.unwrap(), "{reserve}");
        }
    }
}
