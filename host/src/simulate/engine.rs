//! What a scene runs on: samples, the envelope, or a board.

use std::sync::{Mutex, PoisonError};

use kband::control::{Controller, Planned};
use kband::plant::{ClosedLoop, EnvelopeLoop, Moment, Sample, Scene, Strike};

use crate::board::BoardLoop;
use crate::refusal::Refusal;

/// How finely a scene is simulated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
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
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Envelope => "envelope",
            Self::Waveform => "waveform",
        }
    }
}

/// A closed loop of a scene.
pub(super) enum Engine<'a> {
    Envelope(Box<EnvelopeLoop>),
    Waveform(Box<ClosedLoop>),
    Board(Box<BoardLoop>),
    /// What somebody else makes of the scene, and the impacts of the last cycle.
    Given(&'a mut dyn FnMut() -> (Moment, Vec<Strike>), Vec<Strike>),
}

impl Engine<'_> {
    pub fn build(scene: &Scene, fidelity: Fidelity) -> Result<Self, Refusal> {
        Ok(match fidelity {
            Fidelity::Envelope => Self::Envelope(Box::new(EnvelopeLoop::build(scene)?)),
            Fidelity::Waveform => Self::Waveform(Box::new(ClosedLoop::build(scene)?)),
        })
    }

    /// Runs to the end of the next drive cycle.
    #[inline]
    pub fn cycle(&mut self) -> Result<Moment, Refusal> {
        match self {
            Self::Envelope(closed) => {
                Plans::share(closed.controller_mut());
                Ok(closed.cycle())
            }
            Self::Waveform(closed) => {
                Plans::share(closed.controller_mut());
                Ok(closed.cycle())
            }
            Self::Board(closed) => closed.cycle(),
            Self::Given(cycle, strikes) => {
                let moment;
                (moment, *strikes) = cycle();
                Ok(moment)
            }
        }
    }

    /// Runs to the end of the next drive cycle and shows every sample, where there are any.
    pub fn cycle_shown(&mut self, show: &mut dyn FnMut(Sample)) -> Result<Moment, Refusal> {
        match self {
            Self::Waveform(closed) => Ok(closed.cycle_shown(show)),
            _ => self.cycle(),
        }
    }

    /// Impacts of the last cycle.
    pub fn strikes(&self) -> &[Strike] {
        match self {
            Self::Envelope(closed) => closed.plant().strikes(),
            Self::Waveform(closed) => closed.plant().strikes(),
            Self::Board(closed) => closed.plant().strikes(),
            Self::Given(_, strikes) => strikes,
        }
    }

    /// Whether the parts' way is watched from now on.
    pub fn watch_way(&mut self, watched: bool) {
        if let Self::Envelope(closed) = self {
            closed.watch_way(watched);
        }
    }

    /// Keeps the plan that the controller has made for the runs to come.
    pub fn keep_plan(&self) {
        match self {
            Self::Envelope(closed) => Plans::keep(closed.controller()),
            Self::Waveform(closed) => Plans::keep(closed.controller()),
            Self::Board(_) | Self::Given(..) => {}
        }
    }
}

/// Most plans that are kept.
const KEPT: usize = 256;

/// The plans that this process has made: one search for each distinct question. A plan depends on its
/// question alone, so that who made it, and when, changes no bit of a run.
struct Plans;

static PLANS: Mutex<Vec<Planned>> = Mutex::new(Vec::new());

impl Plans {
    #[inline]
    fn share(controller: &mut Controller) {
        if controller.planning().is_some() {
            Self::spare(controller);
        }
    }

    #[cold]
    fn spare(controller: &mut Controller) {
        let plans = PLANS.lock().unwrap_or_else(PoisonError::into_inner);
        let asked = controller.planning();
        let known = plans
            .iter()
            .find(|plan| asked == Some(&plan.settings))
            .copied();
        drop(plans);
        if let Some(known) = known {
            controller.plan_known(known);
        }
    }

    fn keep(controller: &Controller) {
        let Some(planned) = controller.planned() else {
            return;
        };
        let mut plans = PLANS.lock().unwrap_or_else(PoisonError::into_inner);
        if plans.len() < KEPT && !plans.iter().any(|plan| plan.settings == planned.settings) {
            plans.push(planned);
        }
    }
}
