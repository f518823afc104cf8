//! Supervisory control of one drive: once per drive cycle, from measurements to the next command.
//!
//! A state machine (`supervise`) selects the reference, and the amplitude loop (`drive`) tracks it:
//! supervisory control of a servo loop. ARCHITECTURE.md walks through one cycle.

use crate::aim::Selection;
use crate::drive::{AmplitudeLoop, Reference, Resonance, Scale, Tones};
use crate::hear::{GearEstimator, Listener, LoadEvents, LoadMeter, MissedImpactDetector};
use crate::identify::Identifier;
use crate::supervise::{FaultDetector, LimitMonitor, RestTest, StateMachine, TestSwing};
use crate::{
    Cycle, Event, Events, Inputs, Interlock, NoSetpoint, Recipe, Report, Settings, Shape,
    StartCause, Target,
};
use kband::arithmetic::Phase;
use kband::feeder::OutOfRange;
use num_complex::Complex32 as Complex;

/// Slices of planning ([`Controller::plan_step`]) per drive cycle.
pub const PLAN_SLICES: usize = 16;

/// The controller of one drive.
///
/// [`Controller::cycle`] runs once per drive cycle; the signal path latches its command at the next
/// wrap of the phase. [`Controller::plan_step`] belongs in idle time.
///
/// ```
/// use kband_control::{Controller, Cycle, Inputs, Settings, StartCause, State, Target};
/// let target = Target::Locked { order: 1 };
/// let mut controller = Controller::build(&Settings::default(), target, StartCause::Ordinary)?;
/// // Without the enable input the drive stays off.
/// let report = controller.cycle(&Cycle::default(), &Inputs::default());
/// assert_eq!((report.state, report.command.amplitude), (State::Off, 0.0));
/// // With it, a soft start begins.
/// let enabled = Inputs { enable: true, ..Inputs::default() };
/// assert_eq!(controller.cycle(&Cycle::default(), &enabled).state, State::Starting);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Controller {
    settings: Settings,
    scale: Scale,
    resonance: Resonance,
    amplitude: AmplitudeLoop,
    selection: Selection,
    machine: StateMachine,
    listener: Listener,
    missed_impact_detector: MissedImpactDetector,
    identifier: Identifier,
    /// Phase lead of the track in the last trusted cycle, in rad.
    lead: f32,
    pending_events: Events,
    limits: LimitMonitor,
    reference: Reference,
    output: f32,
    /// Phase lead of the output before the drive's phase, in rad.
    output_lead: f32,
    tones: Tones,
    /// Estimator of the parts' load; `None` without `track_mass`.
    meter: Option<LoadMeter>,
    weighing: LoadEvents,
    /// Predicted envelopes at the ends of three cycles, newest first, over that at full output.
    predicted_envelopes: [Complex; 3],
    /// Envelope by the measured current at the last cycle's end, over the steady one at 1 A.
    by_current: Complex,
    faults: FaultDetector,
    rest_test: RestTest,
    swing: TestSwing,
    count: u32,
    measured: Measured,
    watches_ready: bool,
}

#[derive(Clone, Copy, Debug, Default)]
struct Measured {
    /// Amplitude b, in m.
    amplitude: f32,
    lead: Phase,
    shape: Shape,
    events: Events,
}

impl Controller {
    /// Builds the controller. The error names the parameter that is out of range.
    pub fn build(
        settings: &Settings,
        target: Target,
        start: StartCause,
    ) -> Result<Self, OutOfRange> {
        let interlock = Interlock::begin(start, settings.frequency);
        Self::resume(settings, target, &interlock)
    }

    /// As [`Controller::build`], with another controller's causes that keep the drive off.
    pub fn resume(
        settings: &Settings,
        target: Target,
        interlock: &Interlock,
    ) -> Result<Self, OutOfRange> {
        let rate = settings.frequency;
        let amplitude = AmplitudeLoop::build(settings)?;
        let scale = Scale::from_settings(settings);
        let mut controller = Self {
            settings: *settings,
            scale,
            resonance: Resonance::new(settings),
            amplitude,
            selection: Selection::from_target(target, settings, &scale)?,
            machine: StateMachine::begin(interlock.at_rate(rate), rate, settings.capture_attempts),
            listener: Listener::build()?,
            missed_impact_detector: MissedImpactDetector::default(),
            identifier: Identifier::new(),
            lead: 0.0,
            pending_events: Events::default(),
            limits: LimitMonitor::default(),
            reference: Reference::default(),
            output: 0.0,
            output_lead: 0.0,
            tones: Tones::build(settings)?,
            meter: LoadMeter::build(settings),
            weighing: LoadEvents::default(),
            predicted_envelopes: [Complex::default(); 3],
            by_current: Complex::default(),
            faults: FaultDetector::default(),
            rest_test: RestTest::build(settings),
            swing: TestSwing::build(settings, scale.envelope.cycles),
            count: 0,
            measured: Measured::default(),
            watches_ready: true,
        };
        controller.begin_target();
        Ok(controller)
    }

    /// Sets a new target. The error names a number out of range, or an amplitude beyond the drive's
    /// output; the old target then stays. See [no setpoint](Controller::no_setpoint).
    ///
    /// [`Controller::plan_step`] searches for the lock that gives a requested speed. Until it is
    /// [chosen](Controller::is_setpoint_found), a running drive keeps its amplitude, and a
    /// stopped one does not start.
    pub fn set_target(&mut self, target: Target) -> Result<(), OutOfRange> {
        self.selection = self.select(target, &self.settings)?;
        self.pending_events.push(Event::TargetSet);
        self.begin_target();
        Ok(())
    }

    /// Sets target and settings of a recipe. The error names a number out of range; both then stay.
    pub fn use_recipe(&mut self, recipe: &Recipe) -> Result<(), OutOfRange> {
        let settings = recipe.applied_to(&self.settings)?;
        self.selection = self.select(recipe.target, &settings)?;
        self.settings = settings;
        self.tones.set_rates(&settings);
        if let Some(meter) = &mut self.meter {
            meter.set_lot(&settings);
        }
        self.pending_events.push(Event::TargetSet);
        self.begin_target();
        Ok(())
    }

    /// Whether [`Controller::use_recipe`] accepts a recipe.
    pub fn check_recipe(&self, recipe: &Recipe) -> Result<(), OutOfRange> {
        let settings = recipe.applied_to(&self.settings)?;
        self.select(recipe.target, &settings).map(|_| ())
    }

    /// Reports that a selected recipe cannot be used.
    pub fn report_refused_recipe(&mut self) {
        self.pending_events.push(Event::RecipeRefused);
    }

    /// The setpoint selection for a target within the drive's reach.
    #[inline(never)]
    fn select(&self, target: Target, settings: &Settings) -> Result<Selection, OutOfRange> {
        let selection = Selection::from_target(target, settings, &self.scale)?;
        match selection.no_setpoint() {
            Some(NoSetpoint::Output { .. }) => {
                let reach = "what output_maximum and gain let the drive reach at its frequency";
                Err(target.refused(reach))
            }
            _ => Ok(selection),
        }
    }

    /// Records that the settings in use were saved: their fault can then be acknowledged.
    pub fn settings_saved(&mut self) {
        self.machine.interlock.settings_saved = true;
    }

    fn begin_target(&mut self) {
        self.machine.set_chaotic(self.selection.chaos.is_some());
        let identifies = self.selection.target == Target::Identify;
        let settings = &self.settings;
        // An identification expects any restitution.
        let lot = if identifies {
            [0.0, 1.0]
        } else {
            [settings.restitution_low, settings.restitution_high]
        };
        self.listener.gear = GearEstimator::new(lot, settings.scatter, settings.contact_time());
        self.listener.clear();
        if identifies {
            self.identifier.begin(self.settings.contact_time());
        } else {
            self.identifier.stop();
        }
        if self.selection.no_setpoint().is_some() {
            self.pending_events.push(Event::NoSetpoint);
        }
    }

    /// Processes one cycle's measurements and inputs; the report holds the next command.
    pub fn cycle(&mut self, cycle: &Cycle, inputs: &Inputs) -> Report {
        self.advance(cycle, inputs);
        self.report()
    }

    /// Computes one bounded slice of planning, in idle time. Returns whether more remain.
    pub fn plan_step(&mut self) -> bool {
        let chosen = self.selection.chosen();
        chosen && (self.identifier.step() || self.listener.share.step())
            || (self.selection).step(&self.settings, &self.scale, &mut self.pending_events)
    }
}

#[cfg(any(test, feature = "memo"))]
mod plans;
mod queries;
mod steps;

#[cfg(test)]
mod tests;
