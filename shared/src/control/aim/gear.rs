//! The amplitude at which the parts stay in gear the longest, planned slice by slice.

use super::setpoint::{Choice, Level, NoSetpoint};
use crate::control::drive::Scale;
use crate::control::settings::Settings;
use crate::feeder::OutOfRange;
use crate::regime::band;
use crate::regime::gear::{GearPlan, GearPlanSettings, GearPlanner};

/// Impacts that one slice computes.
const SLICE: u32 = 64;
/// Lowest k that is tried, times the order: below 0.28 no restitution has a band of order 1, nor had any lot its best
/// k there.
const LOWEST: f64 = 0.28;
/// Highest k that is tried over the birth of the liveliest part's lock; above, only what is transient is in gear.
const HIGHEST: f64 = 1.02;
/// Highest k that is tried, whatever the lot: at 1 and above the track throws no part that rests.
const THROWS: f64 = 0.98;

/// The search for the k at which the lot is in gear the longest, within what the drive reaches.
#[derive(Clone, Debug)]
pub struct GearSearch {
    planner: GearPlanner,
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
        let planner = GearPlanner::new(GearPlanSettings {
            restitution: lot,
            scatter: settings.scatter,
            order: u32::from(order),
            k: [reached.max((LOWEST / turns) as f32), high],
        })?;
        Ok(Ok(Self { planner }))
    }

    /// One slice; whether more are to be done.
    pub fn step(&mut self) -> bool {
        self.planner.advance(SLICE)
    }

    /// Whether there is nothing more to find.
    pub fn is_over(&self) -> bool {
        self.plan().is_some_and(|plan| plan.settled)
    }

    /// What was found so far.
    pub fn plan(&self) -> Option<&GearPlan> {
        self.planner.plan()
    }

    /// The choice so far.
    pub fn choice(&self) -> Choice {
        Choice::level(match self.plan() {
            Some(plan) => Level::K(f64::from(plan.k)),
            None => Level::Sought,
        })
    }
}
