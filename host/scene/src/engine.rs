//! What a scene runs on: samples, the envelope, or what a caller gives.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use kband::regime::gear::StrikeCount;
use kband_control::{Controller, Events, GearPlanned, KickResult, Load, State};
use kband_plant::{Change, ClosedLoop, EnvelopeLoop, Moment, Sample, Scene, Strike};

use crate::refusal::Refusal;

/// How finely a scene is simulated.
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
    /// Both, in the order of their cost.
    pub const ALL: [Self; 2] = [Self::Envelope, Self::Waveform];

    /// Its name in scenes and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Envelope => "envelope",
            Self::Waveform => "waveform",
        }
    }
}

/// What every run takes of a cycle; the whole [`Moment`] is put together where it is asked for.
#[derive(Clone, Copy, Debug)]
pub struct Glance {
    /// Time at the end of the cycle in s.
    pub time: f64,
    /// What the controller is doing.
    pub state: State,
    /// What happened.
    pub events: Events,
    /// Measured amplitude b in m.
    pub amplitude: f32,
    /// Amplitude that the loop follows at the end of the next cycle but one, in m.
    pub reference: f32,
    /// Measured k.
    pub k: f32,
    /// Estimated share of time in gear, 0..=1; a lower bound where its error is infinite.
    pub in_gear: f32,
    /// Standard error of that share.
    pub error: f32,
    /// The parts on the track as weighed.
    pub load: Option<Load>,
}

impl Glance {
    /// Refused where a number is not finite: it came of an error of this program, and nothing after
    /// it is worth anything.
    fn checked(self) -> Result<Self, Refusal> {
        let numbers = [self.amplitude, self.reference, self.in_gear];
        if numbers.iter().all(|number| number.is_finite()) && !self.k.is_nan() {
            return Ok(self);
        }
        Err(Refusal::new(
            format!("a value at {:.5} s is no finite number", self.time),
            "this is an error of kband: report the scene and what kband --version prints",
        ))
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

/// Gives the next cycle of a closed loop, and the impacts in it.
pub(crate) type Next<'a> = &'a mut (dyn FnMut() -> Result<(Moment, Vec<Strike>), Refusal> + Send);

/// A closed loop of a scene.
pub struct Engine<'a> {
    kind: Kind<'a>,
    /// The last cycle, of a loop whose every cycle is a whole moment.
    last: Option<Moment>,
}

enum Kind<'a> {
    Envelope(Box<EnvelopeLoop>),
    Waveform(Box<ClosedLoop>),
    /// What another simulator, or a board, makes of the scene, and the impacts of the last cycle.
    Given(Next<'a>, Vec<Strike>),
}

impl<'a> Engine<'a> {
    /// The loop of a scene at time 0.
    ///
    /// # Errors
    /// A `Refusal` for a scene out of range.
    pub fn build(scene: &Scene, fidelity: Fidelity) -> Result<Self, Refusal> {
        // A run has no READY output.
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

    /// A loop whose cycles `next` gives.
    pub(crate) fn given(next: Next<'a>) -> Self {
        Self {
            kind: Kind::Given(next, Vec::new()),
            last: None,
        }
    }

    /// Its controller; a loop that is given has none here.
    fn controller(&self) -> Option<&Controller> {
        match &self.kind {
            Kind::Envelope(closed) => Some(closed.controller()),
            Kind::Waveform(closed) => Some(closed.controller()),
            Kind::Given(..) => None,
        }
    }

    /// Changes something about the scene from the next cycle on; no effect on a loop that is given.
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
        closed.advance_spared(Plans::share);
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

    /// Runs to the end of the next drive cycle and shows every sample, where there are any.
    pub fn cycle_shown(&mut self, show: &mut dyn FnMut(Sample)) -> Result<Glance, Refusal> {
        self.whole_cycle(Some(show))
    }

    fn whole_cycle(&mut self, show: Option<&mut dyn FnMut(Sample)>) -> Result<Glance, Refusal> {
        let moment = match &mut self.kind {
            Kind::Envelope(_) => return self.cycle(),
            Kind::Waveform(closed) => {
                Plans::share(closed.controller_mut());
                match show {
                    Some(show) => closed.cycle_shown(show),
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

    /// Whether quantities that need whole moments are recorded from now on.
    pub fn watch(&mut self, watched: bool) {
        if let Kind::Envelope(closed) = &mut self.kind {
            closed.watch(watched);
        }
    }

    /// Whether the parts' displacement along the track is watched from now on, and nothing else of
    /// the moments.
    pub fn watch_displacement(&mut self) {
        if let Kind::Envelope(closed) = &mut self.kind {
            closed.watch_displacement(true);
        }
    }

    /// Keeps the plan that the controller has made for the runs to come.
    pub fn keep_plan(&self) {
        if let Some(controller) = self.controller() {
            Plans::keep(controller);
        }
    }

    /// The lot that gear is planned for; `None` while it is not, for another target, and where that
    /// is not known here.
    pub fn planned_for(&self) -> Option<Lot> {
        let settings = &self.controller()?.gear_planned()?.settings;
        let lot = settings.restitution;
        Some(Lot {
            restitution: [lot.low() as f32, lot.high() as f32],
            scatter: settings.scatter,
        })
    }
}

/// A lot of parts as a controller takes it to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lot {
    /// Lowest and highest restitution.
    pub restitution: [f32; 2],
    /// Its standard deviation from impact to impact.
    pub scatter: f32,
}

/// Most plans of a kind that are kept.
const MAX_CACHED_PLANS: usize = 256;

/// What the controllers of this process have searched for: one search for each distinct question.
/// What comes of it depends on the question alone, so that who asked, and when, changes no bit of a
/// run.
pub(crate) struct Plans {
    kicks: Vec<KickResult>,
    gear: Vec<GearPlanned>,
    strikes: VecDeque<StrikeCount>,
}

static PLANS: Mutex<Plans> = Mutex::new(Plans {
    kicks: Vec::new(),
    gear: Vec::new(),
    strikes: VecDeque::new(),
});

impl Plans {
    fn all() -> MutexGuard<'static, Self> {
        PLANS.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Spares a controller the searches that another one has done.
    #[inline]
    pub(crate) fn share(controller: &mut Controller) {
        if controller.kicks_search().is_some() || controller.gear_search().is_some() {
            Self::spare(controller);
        }
        if controller.strikes_search().is_some() {
            Self::count(controller);
        }
    }

    /// Tells a controller of the strikes that it is counting. They are counted here once for each
    /// question, whoever asks.
    #[cold]
    fn count(controller: &mut Controller) {
        let Some(requested) = controller.strikes_search().copied() else {
            return;
        };
        let known = |plans: &Self| {
            let mut counts = plans.strikes.iter().rev();
            counts.find(|count| count.settings == requested).copied()
        };
        let count = known(&Self::all());
        let Some(count) = count.or_else(|| StrikeCount::compute(requested).ok()) else {
            return;
        };
        controller.supply_strikes(&count);
        let mut plans = Self::all();
        if known(&plans).is_none() {
            if plans.strikes.len() == MAX_CACHED_PLANS {
                plans.strikes.pop_front();
            }
            plans.strikes.push_back(count);
        }
    }

    #[cold]
    fn spare(controller: &mut Controller) {
        let plans = Self::all();
        if let Some(requested) = controller.kicks_search()
            && let Some(known) = plans.kicks.iter().find(|plan| plan.settings == *requested)
        {
            controller.supply_kicks(known.clone());
        }
        if let Some(requested) = controller.gear_search()
            && let Some(known) = plans.gear.iter().find(|plan| plan.settings == *requested)
        {
            controller.supply_gear(known.clone());
        }
    }

    fn keep(controller: &Controller) {
        let (planned, geared) = (controller.planned(), controller.gear_planned());
        if planned.is_none() && geared.is_none() {
            return;
        }
        let plans = &mut *Self::all();
        remember(&mut plans.gear, geared.cloned(), |plan, new| {
            plan.settings == new.settings
        });
        remember(&mut plans.kicks, planned, |plan, new| {
            plan.settings == new.settings
        });
    }
}

/// Keeps a plan, unless one for the same question is known.
fn remember<T>(known: &mut Vec<T>, plan: Option<T>, same: impl Fn(&T, &T) -> bool) {
    if let Some(plan) = plan
        && known.len() < MAX_CACHED_PLANS
        && !known.iter().any(|other| same(other, &plan))
    {
        known.push(plan);
    }
}
