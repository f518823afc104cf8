//! Closed loop of a scene: waveform, envelope, or cycles from a caller.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use kband::regime::gear::StrikeCount;
use kband_control::{Controller, Events, GearPlanned, KickResult, Load, State};
use kband_plant::{Change, ClosedLoop, EnvelopeLoop, Moment, Sample, Scene, Strike};

use crate::refusal::Refusal;

/// Fidelity of a simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Fidelity {
    /// Amplitude and phase of drive and demodulator from cycle to cycle, in closed form.
    #[default]
    Envelope,
    /// Every sample through the firmware's signal path.
    Waveform,
}

impl Fidelity {
    /// All fidelities, by ascending cost.
    pub const ALL: [Self; 2] = [Self::Envelope, Self::Waveform];

    /// Name in scenes and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Envelope => "envelope",
            Self::Waveform => "waveform",
        }
    }
}

/// Quantities of a cycle that every run records; a complete [`Moment`] is computed on request.
#[derive(Clone, Copy, Debug)]
pub struct Glance {
    /// Time at the end of the cycle in s.
    pub time: f64,
    /// State of the controller.
    pub state: State,
    /// Events of the cycle.
    pub events: Events,
    /// Measured amplitude b in m.
    pub amplitude: f32,
    /// Reference of the amplitude at the end of the cycle after the next, in m.
    pub reference: f32,
    /// Measured k.
    pub k: f32,
    /// Estimated share of time in gear, 0..=1; a lower bound if its error is infinite.
    pub in_gear: f32,
    /// Standard error of that share.
    pub error: f32,
    /// Estimated load of parts on the track.
    pub load: Option<Load>,
}

impl Glance {
    /// Refuses a number that is not finite: it shows an error in this program.
    fn checked(self) -> Result<Self, Refusal> {
        let numbers = [self.amplitude, self.reference, self.in_gear];
        if numbers.iter().all(|number| number.is_finite()) && !self.k.is_nan() {
            return Ok(self);
        }
        let cause = format!("a value at {:.5} s is no finite number", self.time);
        let next = "this is an error of kband: report the scene and what kband --version prints";
        Err(Refusal::new(cause, next))
    }

    fn at(moment: &Moment) -> Self {
        let report = &moment.report;
        Self {
            time: moment.time,
            state: report.state,
            events: report.events,
            amplitude: report.amplitude,
            reference: report.reference,
            k: report.k,
            in_gear: report.in_gear,
            error: report.in_gear_error,
            load: report.load,
        }
    }
}

pub(crate) type Next<'a> = &'a mut (dyn FnMut() -> Result<(Moment, Vec<Strike>), Refusal> + Send);

/// A closed loop of a scene.
pub struct Engine<'a> {
    kind: Kind<'a>,
    /// The last cycle, for loops that compute complete moments.
    last: Option<Moment>,
}

enum Kind<'a> {
    Envelope(Box<EnvelopeLoop>),
    Waveform(Box<ClosedLoop>),
    /// Cycles from another simulator or a board, and the impacts of the last one.
    Given(Next<'a>, Vec<Strike>),
}

impl<'a> Engine<'a> {
    /// The loop of a scene at time 0; refused if the scene is out of range.
    pub fn build(scene: &Scene, fidelity: Fidelity) -> Result<Self, Refusal> {
        // A run does not use the READY output.
        let kind = match fidelity {
            Fidelity::Envelope => {
                let mut closed = Box::new(EnvelopeLoop::build(scene)?);
                closed.watch_ready(false);
                Kind::Envelope(closed)
            }
            Fidelity::Waveform => {
                let mut closed = Box::new(ClosedLoop::build(scene)?);
                closed.controller_mut().watch_ready(false);
                Kind::Waveform(closed)
            }
        };
        Ok(Self { kind, last: None })
    }

    pub(crate) fn given(next: Next<'a>) -> Self {
        Self {
            kind: Kind::Given(next, Vec::new()),
            last: None,
        }
    }

    fn controller(&self) -> Option<&Controller> {
        match &self.kind {
            Kind::Envelope(closed) => Some(closed.controller()),
            Kind::Waveform(closed) => Some(closed.controller()),
            Kind::Given(..) => None,
        }
    }

    /// Changes the scene from the next cycle on; no effect on a loop with given cycles.
    pub fn apply(&mut self, change: Change) {
        match &mut self.kind {
            Kind::Envelope(closed) => closed.apply(change),
            Kind::Waveform(closed) => closed.apply(change),
            Kind::Given(..) => {}
        }
    }

    /// Runs to the end of the next drive cycle.
    #[inline]
    pub fn cycle(&mut self) -> Result<Glance, Refusal> {
        let Kind::Envelope(closed) = &mut self.kind else {
            return self.whole_cycle(None);
        };
        closed.advance_supplied(Plans::share);
        let controller = closed.controller();
        let amplitude = controller.amplitude();
        Glance {
            time: closed.seconds(),
            state: controller.state(),
            events: controller.events(),
            amplitude,
            reference: controller.reference(),
            k: controller.k(amplitude),
            in_gear: controller.in_gear(),
            error: controller.in_gear_error(),
            load: controller.load(),
        }
        .checked()
    }

    /// Runs to the end of the next drive cycle; `show` receives every sample at waveform fidelity.
    pub fn trace_cycle(&mut self, show: &mut dyn FnMut(Sample)) -> Result<Glance, Refusal> {
        self.whole_cycle(Some(show))
    }

    fn whole_cycle(&mut self, show: Option<&mut dyn FnMut(Sample)>) -> Result<Glance, Refusal> {
        let moment = match &mut self.kind {
            Kind::Envelope(_) => return self.cycle(),
            Kind::Waveform(closed) => {
                Plans::share(closed.controller_mut());
                match show {
                    Some(show) => closed.trace_cycle(show),
                    None => closed.cycle(),
                }
            }
            Kind::Given(next, strikes) => {
                let moment;
                (moment, *strikes) = next()?;
                moment
            }
        };
        self.last = Some(moment);
        Glance::at(&moment).checked()
    }

    /// The last cycle; `None` before the first.
    pub fn moment(&self) -> Option<Moment> {
        match &self.kind {
            Kind::Envelope(closed) => Some(closed.moment()),
            _ => self.last,
        }
    }

    /// Impacts of the last cycle.
    pub fn strikes(&self) -> &[Strike] {
        match &self.kind {
            Kind::Envelope(closed) => closed.strikes(),
            Kind::Waveform(closed) => closed.plant().strikes(),
            Kind::Given(_, strikes) => strikes,
        }
    }

    /// Records all quantities of a moment from now on, or stops that.
    pub fn watch(&mut self, watched: bool) {
        if let Kind::Envelope(closed) = &mut self.kind {
            closed.watch(watched);
        }
    }

    /// Records the displacement of the parts along the track from now on.
    pub fn watch_displacement(&mut self) {
        if let Kind::Envelope(closed) = &mut self.kind {
            closed.watch_displacement(true);
        }
    }

    /// Caches the controller's plan for later runs.
    pub fn cache_plan(&self) {
        if let Some(controller) = self.controller() {
            Plans::cache(controller);
        }
    }

    /// The lot of the present plan for gear; `None` without a plan and for given cycles.
    pub fn gear_lot(&self) -> Option<Lot> {
        let settings = &self.controller()?.gear_planned()?.settings;
        let lot = settings.restitution;
        Some(Lot {
            restitution: [lot.low() as f32, lot.high() as f32],
            scatter: settings.scatter,
        })
    }
}

/// A lot of parts as the controller assumes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lot {
    /// Lowest and highest restitution.
    pub restitution: [f32; 2],
    /// Standard deviation of the restitution from impact to impact.
    pub scatter: f32,
}

const MAX_CACHED_PLANS: usize = 256;

/// Cache of search results for the controllers of this process; it changes no bit of a run.
pub struct Plans {
    kicks: VecDeque<KickResult>,
    gear: VecDeque<GearPlanned>,
    strikes: VecDeque<StrikeCount>,
}

static PLANS: Mutex<Plans> = Mutex::new(Plans {
    kicks: VecDeque::new(),
    gear: VecDeque::new(),
    strikes: VecDeque::new(),
});

impl Plans {
    fn all() -> MutexGuard<'static, Self> {
        PLANS.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Supplies a controller with cached results of the searches that it has begun.
    #[inline]
    pub fn share(controller: &mut Controller) {
        if controller.kicks_search().is_some() || controller.gear_search().is_some() {
            Self::spare(controller);
        }
        if controller.strikes_search().is_some() {
            Self::count(controller);
        }
    }

    /// Supplies a controller with its strike count, computed once for each settings.
    #[cold]
    fn count(controller: &mut Controller) {
        let Some(requested) = controller.strikes_search().copied() else {
            return;
        };
        let is_requested = |count: &&StrikeCount| count.settings == requested;
        let cached = Self::all().strikes.iter().rev().find(is_requested).copied();
        let Some(count) = cached.or_else(|| StrikeCount::compute(requested).ok()) else {
            return;
        };
        controller.supply_strikes(&count);
        remember(&mut Self::all().strikes, count, |count| count.settings);
    }

    #[cold]
    fn spare(controller: &mut Controller) {
        let plans = Self::all();
        if let Some(requested) = controller.kicks_search()
            && let Some(cached) = plans.kicks.iter().find(|plan| plan.settings == *requested)
        {
            controller.supply_kicks(cached.clone());
        }
        if let Some(requested) = controller.gear_search()
            && let Some(cached) = plans.gear.iter().find(|plan| plan.settings == *requested)
        {
            controller.supply_gear(cached.clone());
        }
    }

    /// Caches the results of a controller's searches.
    pub fn cache(controller: &Controller) {
        if let Some(plan) = controller.planned() {
            remember(&mut Self::all().kicks, plan, |plan| plan.settings);
        }
        if let Some(plan) = controller.gear_planned() {
            remember(&mut Self::all().gear, plan.clone(), |plan| plan.settings);
        }
    }
}

/// Adds a result for other settings than those of the cached ones; the oldest one makes room.
fn remember<T, S: PartialEq>(cached: &mut VecDeque<T>, new: T, settings: fn(&T) -> S) {
    if cached.iter().any(|old| settings(old) == settings(&new)) {
        return;
    }
    if cached.len() == MAX_CACHED_PLANS {
        cached.pop_front();
    }
    cached.push_back(new);
}
