//! The amplitude at which the parts stay in gear the longest, planned slice by slice.

use super::setpoint::{Choice, Level, NoSetpoint};
use crate::control::drive::{Answer, Scale, Shape, size};
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

/// The search for the k at which the lot is in gear the longest, within what the drive reaches.
#[derive(Clone, Debug)]
pub struct GearSearch {
    planner: GearPlanner,
    plan: Option<GearPlan>,
    /// Whether the last slice found it.
    fresh: bool,
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
            amplitude_error: settings.amplitude_error,
            order: u32::from(order),
            k: [reached.max((LOWEST / turns) as f32), high],
            most: [settings.second_tone, settings.third_tone],
            limits: GearLimits {
                displacement: scale.k(settings.amplitude_limit * 1e-3),
                acceleration: scale.normal_gravity / settings.acceleration_limit,
                output: scale.k(settings.output_maximum * scale.strength),
                overtones: (Answer::at(settings).upper).map(|answer| scale.strength / size(answer)),
            },
        };
        Ok(Ok(Self {
            planner: GearPlanner::new(asked)?,
            plan: None,
            fresh: false,
        }))
    }

    /// One slice; whether more are to be done.
    pub fn step(&mut self) -> bool {
        let more = self.planner.advance(SLICE);
        let found = self.planner.plan().copied();
        self.take(found.filter(|plan| self.plan != Some(*plan)));
        more
    }

    /// Takes what a slice found.
    pub(super) fn take(&mut self, found: Option<GearPlan>) {
        self.fresh = found.is_some();
        self.plan = found.or(self.plan);
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

    /// What the last slice found, where it found anything.
    pub fn fresh(&self) -> Option<&GearPlan> {
        self.plan().filter(|_| self.fresh)
    }

    /// The choice so far.
    pub fn choice(&self) -> Choice {
        let Some(plan) = self.plan() else {
            return Choice::level(Level::Sought);
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
