//! The search for the kicks from rest onto the requested lock (docs/theory-capture.md#t7.3).
//!
//! The planner of `regime::capture` simulates the lot; here it runs in slices of idle time.

use crate::hear::LockWindow;
use crate::settings::Settings;
use core::task::Poll;
use kband::feeder::OutOfRange;
use kband::regime::capture::{DriveLag, DriveLagSettings, Lot, Plan, PlanSettings, Planner};

/// Impacts that one slice computes: at most 0.2 million instructions.
const SLICE_IMPACTS: u32 = 20;
/// Highest amplitude of a planned kick over the setpoint.
const MAX_KICK_RATIO: f32 = 2.5;

/// A finished search: its settings, its plan, its number of slices. Equal settings give the same
/// plan after as many slices ([`crate::Controller::supply_kicks`]).
#[derive(Clone, Debug, PartialEq)]
pub struct KickResult {
    /// Settings of the search.
    pub settings: PlanSettings,
    /// The plan found.
    pub plan: Plan,
    /// Number of slices it needed.
    pub slices: u32,
}

#[derive(Clone, Debug, Default)]
pub struct KickSearch {
    planner: Option<Planner>,
    #[cfg(any(test, feature = "memo"))]
    settings: Option<PlanSettings>,
    slices: u32,
    stored: Option<KickResult>,
    pub plan: Option<Plan>,
}

impl KickSearch {
    /// Begins the search for kicks onto a lock, with amplitudes up to `reserve` times the lock's.
    pub fn begin(settings: &Settings, lock: &LockWindow, reserve: f32) -> Result<Self, OutOfRange> {
        let envelope = f64::from(settings.envelope);
        let settings = PlanSettings {
            lot: Lot {
                k: lock.k,
                restitution: settings.lot()?,
                order: u32::from(lock.order),
                amplitude_error: f64::from(settings.amplitude_error),
                contact: settings.contact_time(),
            },
            drive: DriveLag::build(DriveLagSettings {
                time_constant: envelope,
                start: 1.0,
                limit: f64::from(reserve.clamp(1.0, MAX_KICK_RATIO)),
            })?,
            time_constant: envelope,
            effort: PlanSettings::DEFAULT_EFFORT,
        };
        Ok(Self {
            planner: Some(Planner::new(settings)?),
            #[cfg(any(test, feature = "memo"))]
            settings: Some(settings),
            ..Self::default()
        })
    }

    pub fn step(&mut self) -> bool {
        let Some(planner) = &mut self.planner else {
            return false;
        };
        self.slices = self.slices.saturating_add(1);
        let progress = match &self.stored {
            Some(stored) if self.slices < stored.slices => Poll::Pending,
            Some(stored) => Poll::Ready(stored.plan.clone()),
            None => planner.advance(SLICE_IMPACTS),
        };
        if let Poll::Ready(plan) = progress {
            (self.planner, self.plan) = (None, Some(plan));
        }
        self.planner.is_some()
    }

    /// Settings of the running search; `None` once a plan is supplied or found.
    #[cfg(any(test, feature = "memo"))]
    pub fn pending_settings(&self) -> Option<&PlanSettings> {
        (self.settings.as_ref()).filter(|_| self.planner.is_some() && self.stored.is_none())
    }

    /// Supplies the plan of an equal search. It appears after the same number of slices.
    #[cfg(any(test, feature = "memo"))]
    pub fn supply(&mut self, stored: KickResult) {
        if self.pending_settings() == Some(&stored.settings) {
            self.stored = Some(stored);
        }
    }

    #[cfg(any(test, feature = "memo"))]
    pub fn planned(&self) -> Option<KickResult> {
        Some(KickResult {
            settings: self.settings?,
            plan: self.plan.clone()?,
            slices: self.slices,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aim::setpoint::Choice;

    #[test]
    fn kick_is_bounded_by_reserve_and_maximum() {
        let settings = Settings::default();
        let lock = Choice::lock(1, &settings).unwrap().lock.unwrap();
        for (reserve, limit) in [(0.5, 1.0), (1.3, 1.3), (2.4, 2.4), (9.0, 2.5)] {
            let search = KickSearch::begin(&settings, &lock, reserve).unwrap();
            let pending_settings = search.pending_settings().unwrap().drive;
            let expected = DriveLag::build(DriveLagSettings {
                time_constant: f64::from(settings.envelope),
                start: 1.0,
                limit: f64::from(limit as f32),
            });
            assert_eq!(pending_settings, expected.unwrap(), "{reserve}");
        }
    }
}
