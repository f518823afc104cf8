//! Setpoint selection: the target, its setpoint, and its searches.

use super::GearSearch;
use super::chaos::ChaosSearch;
use super::flow::FlowChoice;
use super::kicks::KickSearch;
use super::retune::Retuning;
use super::setpoint::{Choice, Level, NoSetpoint};
use super::speed::SpeedSearch;
use crate::drive::Scale;
use crate::hear::LockWindow;
use crate::{Event, Events, GearMargin, Settings, Shape, Target, UPPER};
use core::f32::consts::PI;
use kband::arithmetic::square_root_single;
use kband::feeder::{OutOfRange, Restitution};
use kband::regime::gear::GearPlan;

/// Smallest acceptable predicted share of time in gear; below it an event is reported.
pub const MIN_GEAR_SHARE: f32 = 0.7;

#[derive(Clone, Debug)]
pub struct Selection {
    pub target: Target,
    choice: Choice,
    speed: Option<SpeedSearch>,
    pub gear: Option<GearSearch>,
    /// The requested flow, and the order of gear that is requested or found for it.
    flow: Option<FlowChoice>,
    order: u8,
    pub plan: Option<GearPlan>,
    retuning: Retuning,
    pub search: KickSearch,
    pub chaos: Option<ChaosSearch>,
    pub misfit: bool,
}

impl Selection {
    pub fn from_target(
        target: Target,
        settings: &Settings,
        scale: &Scale,
    ) -> Result<Self, OutOfRange> {
        let mut choice = Choice::from_target(target, settings)?.limited_to_reach(settings, scale);
        let order = match target {
            Target::Gear { order } => order,
            _ => 1,
        };
        let gear = match target {
            Target::Gear { .. } | Target::Flow(_) => GearSearch::begin(order, settings, scale)?
                .inspect_err(|cause| choice.level = Level::None(*cause))
                .ok(),
            _ => None,
        };
        let (speed, flow) = match target {
            Target::Speed(speed) => (Some(speed), None),
            // Touching parts: the next one follows after a part's length.
            Target::PartsPerMinute(rate) => (Some(rate * settings.part_length / 60.0), None),
            Target::Flow(flow) => (None, Some(flow)),
            _ => (None, None),
        };
        let chaotic = target == Target::Chaotic && choice.lock.is_some();
        Ok(Self {
            target,
            speed: speed.map(SpeedSearch::begin),
            gear,
            flow: flow.map(FlowChoice::new),
            order,
            plan: None,
            retuning: Retuning::default(),
            search: plan_kicks(&choice, settings, scale)?,
            choice,
            chaos: chaotic.then(|| ChaosSearch::begin(settings)).transpose()?,
            misfit: false,
        })
    }

    /// The requested lock, also on the way to chaos or for a speed.
    pub fn lock(&self) -> Option<&LockWindow> {
        self.choice.lock.as_ref()
    }

    pub fn shape(&self) -> Shape {
        self.choice.shape
    }

    /// Whether the search for the setpoint is over, with or without a result.
    pub fn chosen(&self) -> bool {
        self.choice.level != Level::Pending
    }

    pub fn no_setpoint(&self) -> Option<NoSetpoint> {
        match self.choice.level {
            Level::None(cause) => Some(cause),
            _ => None,
        }
    }

    /// The setpoint's amplitude, in m; 0 if there is none.
    pub fn setpoint(&self, scale: &Scale) -> f32 {
        match self.choice.level {
            Level::K(k) => scale.amplitude(k as f32),
            Level::Amplitude(amplitude) => amplitude,
            Level::Pending | Level::None(_) => 0.0,
        }
    }

    /// Records that the parts do not fit the lot. The setpoint becomes a k of `1/sqrt(1 + pi^2)`,
    /// at which a part thrown from rest flies one drive period (docs/theory-real-parts.md#t10.1).
    pub fn set_misfit(&mut self, settings: &Settings, scale: &Scale) {
        self.misfit = true;
        let k = 1.0 / square_root_single(1.0 + PI * PI);
        let reach = scale.reach(settings);
        self.choice = Choice::level(if scale.amplitude(k) <= reach {
            Level::K(f64::from(k))
        } else {
            Level::Amplitude(reach)
        });
        (self.gear, self.plan, self.flow) = (None, None, None);
    }

    pub fn set_k(&mut self, k: f64) {
        self.choice.level = Level::K(k);
    }

    pub fn go_to_lock(&mut self) {
        if let Some(lock) = self.choice.lock {
            self.choice.level = Level::K(lock.k);
        }
    }

    pub fn give_up_chaos(&mut self) {
        self.choice = Choice::level(Level::None(NoSetpoint::Chaos));
    }

    /// The result of the finished search for chaos: the middle of its interval of k.
    pub fn chaos_result(&self) -> Option<Option<f64>> {
        let interval = self.chaos.as_ref()?.result()?;
        Some(interval.map(|[low, high]| libm::sqrt(low * high)))
    }

    /// The band of gear or the chaotic interval, as lowest and highest k.
    pub fn target_band(&self) -> Option<[f32; 2]> {
        let chaotic = || self.chaos.as_ref()?.result()?;
        let gear = self.plan.map(|plan| plan.band);
        gear.or_else(|| Some(chaotic()?.map(|k| k as f32)))
    }

    /// Restitutions and scatter of the lot: as configured, or as estimated for the plan of gear.
    pub fn lot(&self, settings: &Settings) -> Option<(Restitution, f32)> {
        if let Some(gear) = &self.gear {
            let planned = gear.planner.settings();
            return Some((planned.restitution, planned.scatter));
        }
        Some((settings.lot().ok()?, settings.scatter))
    }

    /// Processes a cycle at the setpoint. Plans again if the parts differ from the planned ones or
    /// the drive lacks a tone. The setpoint stays until that plan is settled.
    pub fn retune(
        &mut self,
        margin: Option<&GearMargin>,
        missing_tones: [bool; UPPER],
        settings: &Settings,
        scale: &Scale,
    ) {
        if let Some(order) = self.gear_order()
            && let Some(gear) = self.gear.as_ref().filter(|gear| gear.is_over())
            && let planned = gear.planner.settings()
            && let Some(proposed) = (self.retuning).cycle(planned, margin, missing_tones, settings)
            && let Ok(Ok(search)) = GearSearch::begin(order, &proposed, scale)
        {
            self.gear = Some(search);
        }
    }

    /// The requested order of gear, or the order found for a flow.
    pub fn gear_order(&self) -> Option<u8> {
        matches!(self.target, Target::Gear { .. } | Target::Flow(_)).then_some(self.order)
    }

    /// Selects the order of gear that gives the requested flow; `flow`: the present one, in g/s.
    pub fn serve_flow(
        &mut self,
        flow: Option<f32>,
        settings: &Settings,
        scale: &Scale,
        events: &mut Events,
    ) {
        let Some(choice) = &mut self.flow else {
            return;
        };
        match choice.cycle(self.order, flow) {
            None => {}
            Some(Ok(order)) => match GearSearch::begin(order, settings, scale) {
                Ok(Ok(search)) => (self.order, self.plan, self.gear) = (order, None, Some(search)),
                _ => self.refuse_flow(flow, events),
            },
            Some(Err(nearest)) => self.refuse_flow(Some(nearest), events),
        }
    }

    fn refuse_flow(&mut self, nearest: Option<f32>, events: &mut Events) {
        self.choice.level = Level::None(NoSetpoint::Flow(nearest.unwrap_or(0.0)));
        self.flow = None;
        events.push(Event::NoSetpoint);
    }

    pub fn step(&mut self, settings: &Settings, scale: &Scale, events: &mut Events) -> bool {
        if let Some(speed) = &mut self.speed {
            if let Some(choice) = speed.step(settings) {
                self.speed = None;
                self.choice = choice.limited_to_reach(settings, scale);
                match plan_kicks(&self.choice, settings, scale) {
                    Ok(search) => self.search = search,
                    // A lock without a plan of kicks is no setpoint.
                    Err(_) => self.choice = Choice::level(Level::None(NoSetpoint::Speed(None))),
                }
                if self.no_setpoint().is_some() {
                    events.push(Event::NoSetpoint);
                }
            }
            return true;
        }
        if let Some(gear) = &mut self.gear
            && !gear.is_over()
        {
            let (more, found) = gear.step();
            // Every plan of the first search is used; of a later search only the settled one.
            if let Some(better) = found
                && (better.settled || self.plan.is_none_or(|plan| !plan.settled))
            {
                self.plan = Some(better);
                if better.settled && better.share < MIN_GEAR_SHARE {
                    events.push(Event::GearPoor);
                }
                self.choice = gear.choice();
            }
            return more;
        }
        self.search.step() || self.chaos.as_mut().is_some_and(ChaosSearch::step)
    }
}

fn plan_kicks(
    choice: &Choice,
    settings: &Settings,
    scale: &Scale,
) -> Result<KickSearch, OutOfRange> {
    let Some(lock) = &choice.lock else {
        return Ok(KickSearch::default());
    };
    let reserve = scale.max_kick(settings, scale.amplitude(lock.k as f32));
    KickSearch::begin(settings, lock, reserve)
}
