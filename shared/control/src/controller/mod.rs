//! Supervisory control of one drive: once per drive cycle, from measurements to the next command.
//!
//! A state machine (`supervise`) selects the reference, and the amplitude loop (`drive`) tracks it:
//! supervisory control of a servo loop. ARCHITECTURE.md walks through one cycle.

use core::f32::consts::TAU;

use crate::aim::{NoSetpoint, Selection};
use crate::angle::{phase_of, radians_of};
use crate::supervise::{
    Clearance, Decision, EnableResponse, FaultDetector, Interlock, LimitInputs, LimitMonitor,
    Observation, Prediction, RestTest, StateMachine, SwingResult, TestSwing,
};
use crate::target::Target;
use kband::arithmetic::{Phase, sine_cosine_single, square_root_single};
use num_complex::Complex32 as Complex;

use crate::drive::{
    AmplitudeLoop, Approach, ImpactPhase, Reference, Resonance, Scale, Shape, ToneInputs, Tones,
    TrackMotion, UPPER, absolute,
};
use crate::hear::{
    Cycle, DriveState, GearEstimator, ImpactEvidence, Listener, LoadEvents, LoadMeter,
    MissedImpactDetector, Weighed,
};
use crate::identify::{self, Driven, Identifier, Step};
use crate::inputs::{Inputs, StartCause};
use crate::recipe::Recipe;
use crate::report::Report;
use crate::settings::Settings;
use crate::state::{Event, Events, Fault, Limits, State};
use kband::feeder::OutOfRange;

/// Slices of planning ([`Controller::plan_step`]) per drive cycle.
pub const PLAN_SLICES: usize = 16;
/// Cycles per quarter of the setpoint on the way from a lock to chaos, slow enough to follow each
/// doubling (docs/theory-capture.md#t7.4).
const GLIDE_CYCLES_PER_QUARTER: f32 = 150.0;
/// Relative error of the amplitude at which the setpoint counts as reached.
const SETPOINT_TOLERANCE: f32 = 0.01;
/// Amplitude over the hard limit below which the track counts as at rest: about sensor noise.
const REST_AMPLITUDE_SHARE: f32 = 0.02;
/// Amplitude, in m per mm of the safe one, above which the resonance is tracked.
const MIN_TRACKING_AMPLITUDE: f32 = 0.3e-3;
/// Amplitude over the smallest detectable one above which the upper tones are phase-locked.
const MIN_FIRST_TONE_RATIO: f32 = 4.0;

/// The controller of one drive.
///
/// [`Controller::cycle`] runs once per drive cycle, before the next one ends. The signal path
/// latches its command at the next wrap of the phase. [`Controller::plan_step`] belongs in idle time.
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
    deafness: MissedImpactDetector,
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
    /// Predicted envelope at the ends of three cycles, newest first, over the steady one at full
    /// output. The first is of the cycle that the last output drives.
    predicted_envelopes: [Complex; 3],
    /// Envelope under the measured current at the last cycle's end, over the steady one at 1 A.
    by_current: Complex,
    faults: FaultDetector,
    rest_test: RestTest,
    swing: TestSwing,
    count: u32,
    measured: Measured,
    /// Whether READY is read.
    watches_ready: bool,
}

/// Measurements of the last cycle.
#[derive(Clone, Copy, Debug, Default)]
struct Measured {
    /// Amplitude b, in m.
    amplitude: f32,
    /// Phase lead of the track before the output.
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

    /// As [`Controller::build`], with another controller's interlock, which keeps the drive off for
    /// the same causes.
    pub fn resume(
        settings: &Settings,
        target: Target,
        interlock: &Interlock,
    ) -> Result<Self, OutOfRange> {
        let pace = settings.frequency;
        let amplitude = AmplitudeLoop::build(settings)?;
        let resonance = Resonance::new(settings);
        let scale = Scale::at(settings, resonance.frequency);
        let mut controller = Self {
            settings: *settings,
            scale,
            resonance,
            amplitude,
            selection: Selection::of_target(target, settings, &scale)?,
            machine: StateMachine::begin(interlock.at_pace(pace), pace, settings.capture_attempts),
            listener: Listener::build(build_gear_estimator(settings, false))?,
            deafness: MissedImpactDetector::default(),
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

    /// Sets target and settings of a recipe, as [`Controller::set_target`] sets a target. The error
    /// names the number out of range; target and settings then stay.
    pub fn use_recipe(&mut self, recipe: &Recipe) -> Result<(), OutOfRange> {
        let settings = recipe.applied_to(&self.settings)?;
        self.selection = self.select(recipe.target, &settings)?;
        self.settings = settings;
        self.tones.set_pace(&settings);
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

    /// The selection for a target that the drive reaches.
    #[inline(never)]
    fn select(&self, target: Target, settings: &Settings) -> Result<Selection, OutOfRange> {
        let selection = Selection::of_target(target, settings, &self.scale)?;
        match selection.no_setpoint() {
            Some(NoSetpoint::Output { .. }) => Err(refused(
                target,
                "what output_maximum and gain let the drive reach at its frequency",
            )),
            _ => Ok(selection),
        }
    }

    /// Records that the settings in use were saved: their fault can then be acknowledged.
    pub fn settings_saved(&mut self) {
        self.machine.interlock.settings_saved();
    }

    fn begin_target(&mut self) {
        self.machine.pursue(self.selection.chaos.is_some());
        let identifies = self.selection.target == Target::Identify;
        self.listener.gear = build_gear_estimator(&self.settings, identifies);
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

    /// Processes one cycle's measurements and the board's inputs; the report holds the next
    /// command.
    pub fn cycle(&mut self, cycle: &Cycle, inputs: &Inputs) -> Report {
        self.advance(cycle, inputs);
        self.report()
    }

    /// As [`Controller::cycle`], without the report.
    pub fn advance(&mut self, cycle: &Cycle, inputs: &Inputs) {
        let mut events = core::mem::take(&mut self.pending_events);
        self.count = self.count.wrapping_add(1);
        // The counter wraps after 99 days at 500 Hz; the classifier's clock restarts with it.
        if self.count == 0 {
            self.listener.begin();
        }
        self.machine.count();
        let silent = Cycle::default();
        let mut sound = cycle.is_finite();
        let cycle = if sound { cycle } else { &silent };
        let sine = -cycle.quadrature / self.scale.angular_squared;
        let cosine = -cycle.in_phase / self.scale.angular_squared;
        let [mut sine, mut cosine] = self.estimate_load(cycle, sine, cosine);
        if !(sine.is_finite() && cosine.is_finite()) {
            [sine, cosine] = [0.0; 2];
            sound = false;
        }
        let measured = square_root_single(sine * sine + cosine * cosine);
        let lead = phase_of(libm::atan2f(cosine, sine));
        let motion = self.motion(cycle, Complex::new(sine, cosine));
        let held_back = !self.limits.limits.is_empty();
        let blind = self.detect_faults(cycle, inputs, measured, radians_of(lead), &mut events);
        self.follow_enable_input(inputs, measured, &mut events);
        if !blind {
            self.lead = radians_of(lead);
        }
        self.update_limits(inputs);
        let goal = self.move_reference();
        if !self.machine.running() {
            self.switch_off();
        } else if inputs.held_off {
            self.release_output();
        } else if self.resonance.is_sweeping() {
            self.advance_sweep(measured, &mut events);
        } else {
            // The reading of a sensor that may be lost is not used: the output is held.
            if !blind {
                let reference = self.reference.now;
                let most = self.most_output();
                let struck = ImpactPhase {
                    at: (self.meter.as_ref()).map_or(Complex::default(), LoadMeter::struck),
                    silent: self.meter.as_ref().is_none_or(LoadMeter::silent),
                };
                [self.output, self.output_lead] = self
                    .amplitude
                    .control_under_load(motion.first, struck, reference, most)
                    .unwrap_or_else(|| [self.amplitude.cycle(measured, reference, most), 0.0]);
                let drive_state = DriveState {
                    count: self.count,
                    lead,
                    order: self.order().unwrap_or(1),
                    k: self.scale.k(measured),
                    shape: self.measured.shape,
                    step: self.scale.step,
                    lot: self.selection.lot(&self.settings),
                    stands: self.machine.kick().is_none()
                        && self.reference.now == goal
                        && (measured - goal).abs() < 2.0 * SETPOINT_TOLERANCE * goal,
                    contact: self.settings.contact_time(),
                    detects_gear: self.detects_gear(),
                    needs_regime: self.machine.listens_for_chaos(),
                };
                self.listener
                    .cycle(cycle, &drive_state, self.selection.lock());
                self.follow_resonance(measured);
                self.control_tones(&motion, &mut events);
            }
            self.detect_deafness(cycle, goal, measured);
            self.advance_state(goal, measured, &mut events);
            self.watch_fit();
            self.retune_gear();
            let flow = self.load().map(|load| load.flow);
            self.selection
                .serve_flow(flow, &self.settings, &self.scale, &mut events);
            self.identify(cycle, goal, measured, &mut events);
        }
        let load = self.load();
        if let Some(event) = self.weighing.cycle(load, self.resonance.frequency) {
            events.push(event);
        }
        let limits = self.limits.limits;
        if !held_back && !limits.is_empty() {
            events.push(Event::Limited);
        } else if held_back && limits.is_empty() && self.machine.running() {
            events.push(Event::Freed);
        }
        if !(sound && self.commands_finite()) {
            // An error of the firmware: switch the drive off and drop what the loops estimated.
            self.machine.fail(Fault::ControlLate, &mut events);
            self.amplitude.forget();
            self.meter = LoadMeter::build(&self.settings);
            self.tones.restart();
            self.predicted_envelopes = [Complex::default(); 3];
            self.switch_off();
        }
        // The limit also holds while an untrusted reading freezes the output.
        self.output = self.output.min(self.most_output());
        let [newest, before, _] = self.predicted_envelopes;
        // Missing amplitude counts as load only while impacts are detected.
        let load = if self.listener.phases.rate() > 0.0 {
            self.amplitude.load()
        } else {
            0.0
        };
        let (_, along) = sine_cosine_single(phase_of(self.output_lead));
        let driven = self.output * along - load;
        self.predicted_envelopes = [self.scale.after(newest, driven), newest, before];
        self.measured = Measured {
            amplitude: measured,
            lead,
            shape: if self.tones.allowed() {
                motion.shape()
            } else {
                Shape::SINE
            },
            events,
        };
    }

    /// Whether [`Controller::is_ready`] depends on detected gear.
    fn detects_gear(&self) -> bool {
        let target = self.selection.target;
        self.watches_ready && matches!(target, Target::Gear { .. } | Target::Flow(_))
    }

    fn commands_finite(&self) -> bool {
        let upper = self.tones.output();
        let mut numbers = upper.as_flattened().iter();
        self.output.is_finite()
            && self.output_lead.is_finite()
            && numbers.all(|part| part.is_finite())
    }

    /// Estimates the parts' load. Corrects the track's motion along sine and cosine of the output's
    /// phase, in m, for the impacts that the demodulator blanks.
    fn estimate_load(&mut self, cycle: &Cycle, sine: f32, cosine: f32) -> [f32; 2] {
        if self.meter.is_none() {
            return [sine, cosine];
        }
        let one = self.listener.margin();
        let phases = &self.listener.phases;
        let goal = self.selection.setpoint(&self.scale);
        let (across, along) = sine_cosine_single(phase_of(self.output_lead));
        let seen = Weighed {
            motion: Complex::new(sine, cosine),
            output: Complex::new(along, across) * self.output,
            blanked: cycle.blanked,
            square: self.scale.angular_squared,
            frequency: self.resonance.frequency,
            normal_gravity: self.scale.normal_gravity,
            in_gear: self.in_gear(),
            order: self.order().unwrap_or(1),
            restitution: one.map(|margin| margin.restitution),
            cosine: one.map(|_| libm::cosf(phases.phase()) * phases.concentration()),
            sine: self.selection.shape.is_sine(),
            concentration: phases.concentration(),
            heard: !cycle.heard.is_empty(),
            settled: self.machine.kick().is_none()
                && self.machine.running()
                && self.selection.chosen()
                && (self.reference.now - goal).abs() < SETPOINT_TOLERANCE * goal
                && (self.measured.amplitude - goal).abs() < 10.0 * SETPOINT_TOLERANCE * goal,
        };
        let found = (self.meter.as_mut()).map_or(seen.motion, |meter| meter.cycle(&seen));
        [found.re, found.im]
    }

    /// Converts the demodulated acceleration to the track's motion, in m.
    fn motion(&self, cycle: &Cycle, first: Complex) -> TrackMotion {
        // Displacement over acceleration at twice and three times the frequency.
        let scales = [-1.0 / 4.0, -1.0 / 9.0];
        let mut upper = [Complex::default(); UPPER];
        for ((tone, [cosine, sine]), scale) in upper.iter_mut().zip(cycle.upper).zip(scales) {
            *tone = Complex::new(sine, cosine) * (scale / self.scale.angular_squared);
        }
        TrackMotion { first, upper }
    }

    /// Controls the upper tones, where the settings allow any. Only at the chosen setpoint.
    fn control_tones(&mut self, motion: &TrackMotion, events: &mut Events) {
        if !self.tones.allowed() {
            return;
        }
        let limits = self.limits.limits;
        let sound = !limits.contains(Limits::LINK_LOST)
            && !limits.contains(Limits::NO_SETPOINT)
            && self.machine.state != State::Stopping
            && self.selection.chosen();
        let asked = ToneInputs {
            motion: *motion,
            wanted: if sound {
                self.selection.shape
            } else {
                Shape::SINE
            },
            reference: self.reference.now,
            square: self.scale.angular_squared,
            room: self.settings.output_maximum - self.output,
            least: MIN_FIRST_TONE_RATIO * self.scale.least,
        };
        let unlike = [Event::SecondToneUnlike, Event::ThirdToneUnlike];
        for (event, happened) in unlike.into_iter().zip(self.tones.cycle(&asked)) {
            if happened {
                events.push(event);
            }
        }
    }

    /// Detects faults. Whether this cycle's reading is untrusted.
    fn detect_faults(
        &mut self,
        cycle: &Cycle,
        inputs: &Inputs,
        measured: f32,
        lead: f32,
        events: &mut Events,
    ) -> bool {
        if inputs.chatters {
            events.push(Event::EnableChatters);
        }
        for (present, at_rest_too, fault) in [
            (inputs.stack_low, true, Fault::StackLow),
            (inputs.supply_low, true, Fault::SupplyLow),
            (inputs.clock_failed, true, Fault::ClockFailed),
            (inputs.over_current, false, Fault::OverCurrent),
            (inputs.control_late, false, Fault::ControlLate),
            (inputs.over_temperature, false, Fault::OverTemperature),
        ] {
            if present && (at_rest_too || self.machine.running()) {
                self.machine.fail(fault, events);
            }
        }
        self.rest_test.cycle(cycle);
        let driven = self.scale.after(self.by_current, cycle.current);
        let by_current = (self.by_current + driven) * (0.5 * self.scale.per_ampere);
        self.by_current = driven;
        let expects = (self.predicted_envelopes[1] + self.predicted_envelopes[2])
            * (0.5 * self.scale.full_amplitude);
        let expected = Prediction {
            running: self.machine.running(),
            known: !self.resonance.is_sweeping(),
            amplitude: absolute(expects),
            by_current: (self.scale.per_ampere > 0.0).then(|| absolute(by_current)),
            opposed: self.scale.is_opposed(expects, lead),
            least: self.scale.least,
            ceiling: self.scale.ceiling,
            reference: self.reference.now,
            error: cycle.noise * square_root_single(2.0 / f32::from(cycle.samples.max(1)))
                / self.scale.angular_squared,
            tolerance: self.settings.load_tolerance,
            shifted: self.rest_test.deviates() == Some(true),
        };
        let (fault, blind) = self.faults.cycle(cycle, measured, lead, &expected);
        if let Some(fault) = fault {
            self.machine.fail(fault, events);
        }
        let by_current = expected.by_current.unwrap_or(expected.amplitude);
        match self.swing.cycle(measured, [expected.amplitude, by_current]) {
            SwingResult::Pending => {}
            // The test swing moves no part, so the usual ratio under load is estimated from here.
            SwingResult::Passed => self.faults.forget_usual(),
            SwingResult::Failed => self.machine.fail(Fault::SensorImplausible, events),
        }
        blind
    }

    /// Follows the enable input, and the run bit of a bus in control.
    fn follow_enable_input(&mut self, inputs: &Inputs, measured: f32, events: &mut Events) {
        let at_rest =
            self.reference.now <= 0.0 && measured < REST_AMPLITUDE_SHARE * self.scale.ceiling;
        let patience = 4.0 * self.settings.soft_stop * self.settings.frequency;
        let waits = !inputs.enable || inputs.bus.is_some_and(|bus| !bus.runs());
        if waits && !self.machine.running() {
            self.rest_test.restart();
        }
        let clearance = match self.rest_test.deviates() {
            Some(true) => Clearance::Refused(Fault::SensorImplausible),
            Some(false) if self.selection.chosen() => Clearance::Granted,
            _ => Clearance::Pending,
        };
        let response =
            self.machine
                .follow_enable_input(inputs, clearance, (at_rest, patience), events);
        match response {
            Some(EnableResponse::Acknowledged) => self.faults = FaultDetector::default(),
            Some(EnableResponse::Stopping) if self.resonance.is_sweeping() => {
                self.resonance.stop();
                self.amplitude.resume(measured, self.output);
            }
            Some(EnableResponse::Started) => {
                self.predicted_envelopes = [Complex::default(); 3];
                self.tones.restart();
                self.swing.begin();
                if self.selection.target == Target::Identify
                    && self.selection.no_setpoint().is_none()
                {
                    self.identifier.begin(self.settings.contact_time());
                    self.selection.set_k(identify::FIRST_K);
                }
                if self.resonance.is_tracking() && self.sweep_amplitude() > 0.0 {
                    self.resonance.begin();
                    self.update_scale();
                }
            }
            Some(EnableResponse::Stopping) | None => {}
        }
    }

    /// Detects a target that depends on impacts while none are detected.
    fn detect_deafness(&mut self, cycle: &Cycle, goal: f32, measured: f32) {
        let limits = self.limits.limits;
        let settled = match self.machine.state {
            State::Holding | State::Capturing | State::Locked | State::Lost => true,
            State::Limiting => limits == Limits::DEAF || limits == Limits::MISFIT,
            _ => false,
        };
        let near = (measured - goal).abs() < 2.0 * SETPOINT_TOLERANCE * goal
            || self.machine.kick().is_some();
        let order = self.order();
        let wanted = match self.selection.target {
            Target::Gear { .. } | Target::Flow(_) => true,
            _ => self.selection.lock().is_some(),
        };
        let turns = f32::from(order.unwrap_or(1));
        let unit = measured * square_root_single(self.scale.angular_squared);
        let middle = 0.5 * (self.settings.restitution_low + self.settings.restitution_high);
        self.deafness.cycle(&ImpactEvidence {
            listening: settled && wanted && self.selection.chosen(),
            together: self.selection.lock().is_some(),
            near,
            rate: self.listener.phases.rate() * turns,
            concentration: self.listener.phases.concentration(),
            thrown: unit * self.listener.gear.landing_speed_from_rest(),
            locked: unit * TAU * turns * self.scale.k(measured) / (1.0 + middle),
            kicked: self.machine.attempts() > 0,
            noise: cycle.noise,
        });
    }

    /// Determines the limits that hold the drive back in this cycle.
    fn update_limits(&mut self, inputs: &Inputs) {
        let timeout = match inputs.bus {
            None => self.settings.link_timeout,
            Some(_) => self.settings.bus_timeout,
        };
        let mut causes = Limits::default();
        // The frequencies of a sweep differ from that of the setpoint.
        let above_ceiling = !self.resonance.is_sweeping()
            && self.selection.setpoint(&self.scale) > self.scale.ceiling;
        for (limit, present) in [
            (Limits::NO_SETPOINT, self.selection.no_setpoint().is_some()),
            (self.scale.ceiling_limit, above_ceiling),
            (Limits::DEAF, self.deafness.missed_impacts),
            (Limits::MISFIT, self.selection.misfit),
            (
                Limits::SECOND_TONE,
                self.tones.missing_tones() != [false; UPPER],
            ),
        ] {
            causes.set(limit, present);
        }
        self.limits.cycle(&LimitInputs {
            running: self.machine.running(),
            frame_received: inputs.link_heard,
            link_timeout: (timeout > 0.0).then_some(timeout * self.settings.frequency),
            saturated: self.amplitude.saturated,
            causes,
        });
    }

    /// Moves the reference by one cycle; its goal, in m.
    fn move_reference(&mut self) -> f32 {
        let (settings, setpoint) = (&self.settings, self.selection.setpoint(&self.scale));
        let limits = self.limits.limits;
        let safe = settings.safe_amplitude * 1e-3;
        let scale = setpoint.max(safe) / settings.frequency;
        let (fewest, pace) = self.amplitude.start_limits();
        let start = settings.soft_start.max(fewest / settings.frequency);
        let up = Approach::Ramp(pace * scale / start);
        let down = Approach::Ramp(scale / settings.soft_stop);
        let (goal, pace) = match (self.machine.state, self.machine.kick()) {
            (State::Off | State::Fault, _) => (0.0, Approach::Step),
            (State::Stopping, _) => (0.0, down),
            // Without a certain target the amplitude falls or stays, and never rises.
            _ if limits.contains(Limits::LINK_LOST) => {
                (safe.min(setpoint).min(self.reference.now), down)
            }
            _ if limits.contains(Limits::NO_SETPOINT) => (safe.min(self.reference.now), down),
            _ if !self.selection.chosen() => (self.reference.now, Approach::Step),
            (_, Some(kick)) => (setpoint * kick, Approach::Lag),
            _ if self.machine.glides() => (
                setpoint,
                Approach::Ramp(setpoint * (0.25 / GLIDE_CYCLES_PER_QUARTER)),
            ),
            _ => (setpoint, up),
        };
        let goal = goal.min(self.scale.ceiling);
        let allowed = self.swing_limits().map_or(goal, |[most, _]| goal.min(most));
        self.reference
            .advance(allowed, pace, self.lead, self.settings.envelope);
        self.swing
            .hold(allowed < goal && self.reference.now == allowed);
        goal
    }

    /// Limits of a start's test swing on the reference and on the output's amplitude, in m.
    fn swing_limits(&self) -> Option<[f32; 2]> {
        let Scale { ceiling, least, .. } = self.scale;
        let limits = self.swing.limits(self.reference.now, ceiling, least);
        limits.filter(|_| !self.resonance.is_sweeping())
    }

    /// Upper limit of the next output, as a share of full output, without the accelerometer.
    fn most_output(&self) -> f32 {
        let amplitude = self.swing_limits().map(|[_, most]| most);
        self.scale
            .most_output(self.predicted_envelopes[0], amplitude)
    }

    fn switch_off(&mut self) {
        (self.output, self.output_lead) = (0.0, 0.0);
        self.reference.now = 0.0;
        self.amplitude.reset();
        self.tones.rest();
        self.listener.clear();
        self.deafness = MissedImpactDetector::default();
        self.limits.rest();
        if self.selection.misfit {
            self.begin_again();
        }
        let decision = self.machine.rest();
        self.carry_out(decision);
        self.identifier.interrupt();
    }

    /// Switches the output off while the track comes to rest; the bridge is open already.
    fn release_output(&mut self) {
        (self.output, self.output_lead) = (0.0, 0.0);
        self.reference.now = 0.0;
        self.amplitude.reset();
        self.tones.rest();
    }

    /// Amplitude at the peak of the resonance search, in m.
    fn sweep_amplitude(&self) -> f32 {
        (self.settings.safe_amplitude * 1e-3)
            .min(self.selection.setpoint(&self.scale))
            .min(self.scale.ceiling)
    }

    /// One cycle of the resonance search, with the output of the safe amplitude at the resonance.
    fn advance_sweep(&mut self, measured: f32, events: &mut Events) {
        let output = self.sweep_amplitude() / self.scale.full_amplitude;
        self.output = output.min(self.settings.output_maximum);
        self.output_lead = 0.0;
        self.reference.now = measured;
        let ended = self.resonance.advance_sweep(measured);
        self.update_scale();
        if ended {
            self.amplitude.resume(measured, self.output);
            events.push(Event::ResonanceFound);
        }
    }

    fn follow_resonance(&mut self, measured: f32) {
        if self.resonance.is_tracking()
            && measured > MIN_TRACKING_AMPLITUDE * self.settings.safe_amplitude
        {
            self.resonance.track(self.lead - self.output_lead);
            self.update_scale();
        }
    }

    /// Updates the numbers that depend on the drive's frequency.
    fn update_scale(&mut self) {
        self.scale.retune(&self.settings, self.resonance.frequency);
    }

    /// Confidence, 0..1, that the parts are in the wanted lock; 0 with too faint single impacts.
    fn confidence(&self) -> f32 {
        if self.deafness.crowd {
            return 0.0;
        }
        self.listener.confidence(self.selection.lock())
    }

    /// Moves between the states of a running drive.
    #[inline(always)]
    fn advance_state(&mut self, goal: f32, measured: f32, events: &mut Events) {
        let seen = Observation {
            near: self.selection.chosen()
                && self.reference.now == goal
                && (measured - goal).abs() < SETPOINT_TOLERANCE * goal
                && self.tones.arrived(),
            limits: self.limits.limits,
            lock: self.selection.lock().map(|_| self.confidence()),
            regime: self.listener.regime.as_ref(),
            plan: self.selection.search.plan(),
            chaos: self.selection.found_chaos(),
        };
        let decision = self.machine.advance(&seen, events);
        self.carry_out(decision);
    }

    /// Tests whether the parts fit the lot of gear. The verdict stays until the track is empty.
    fn watch_fit(&mut self) {
        if self.selection.misfit {
            if self.listener.empty {
                self.begin_again();
            }
            return;
        }
        if self.selection.gear_order().is_some()
            && self.machine.settled()
            && self.listener.is_misfit()
        {
            self.selection.set_misfit(&self.settings, &self.scale);
        }
    }

    /// Begins the target anew, for other parts.
    #[inline(never)]
    fn begin_again(&mut self) {
        if let Ok(selection) = self.select(self.selection.target, &self.settings) {
            self.selection = selection;
            self.begin_target();
        }
    }

    fn retune_gear(&mut self) {
        if self.machine.settled() {
            self.selection.retune(
                self.listener.margin().as_ref(),
                self.tones.missing_tones(),
                &self.settings,
                &self.scale,
            );
        }
    }

    /// Carries out a decision of the state machine.
    #[inline(always)]
    fn carry_out(&mut self, decision: Decision) {
        match decision {
            Decision::Stay => {}
            Decision::ForgetImpacts => self.listener.clear(),
            Decision::GoToChaos(k) => self.selection.set_k(k),
            Decision::GoToLock => self.selection.go_to_lock(),
            Decision::NoChaos => self.selection.give_up_chaos(),
        }
    }

    fn identify(&mut self, cycle: &Cycle, goal: f32, measured: f32, events: &mut Events) {
        if !self.identifier.is_running() {
            return;
        }
        if self.machine.state != State::Holding {
            if self.identifier.wait() != Step::Going {
                events.push(Event::NotIdentified);
            }
            return;
        }
        let off = if self.reference.now == goal {
            (measured - goal).abs() / goal
        } else {
            f32::INFINITY
        };
        let driven = Driven {
            off,
            k: f64::from(self.scale.k(measured)),
            lead: phase_of(self.lead),
            least: f64::from(self.scale.k(self.scale.reach(&self.settings))),
            normal_gravity: self.scale.normal_gravity,
            step: self.scale.step,
            margin: self.listener.margin(),
            thrown: self.listener.gear.landing_speed_from_rest(),
            loudness: self.listener.gear.loudness(),
        };
        match self.identifier.cycle(&driven, cycle) {
            Step::Going => {}
            Step::At(k) => {
                self.listener.clear();
                self.selection.set_k(k);
            }
            Step::Done(true) => events.push(Event::Identified),
            Step::Done(false) => events.push(Event::NotIdentified),
        }
    }

    /// Computes one bounded slice of planning, in idle time. Whether more remain.
    pub fn plan_step(&mut self) -> bool {
        let chosen = self.selection.chosen();
        chosen && (self.identifier.step() || self.listener.share.step())
            || self
                .selection
                .step(&self.settings, &self.scale, &mut self.pending_events)
    }
}

/// The refusal of a target's number, with the accepted range.
fn refused(target: Target, accepted: &'static str) -> OutOfRange {
    let (parameter, value) = match target {
        Target::Locked { order } => ("target locked order", f64::from(order)),
        Target::Gear { order } => ("target gear order", f64::from(order)),
        Target::K(k) | Target::Tones { k, .. } => ("target k", f64::from(k)),
        Target::Amplitude(b) => ("target amplitude", f64::from(b)),
        Target::Speed(speed) => ("target speed", f64::from(speed)),
        Target::Flow(flow) => ("target flow", f64::from(flow)),
        Target::PartsPerMinute(rate) => ("target parts a minute", f64::from(rate)),
        Target::Chaotic => ("target chaotic, order of its lock", 1.0),
        Target::Identify => ("target identify, k that it begins at", identify::FIRST_K),
    };
    OutOfRange {
        parameter,
        value,
        accepted,
    }
}

/// The estimator of gear: for the configured lot, or for any restitution to identify.
fn build_gear_estimator(settings: &Settings, any: bool) -> GearEstimator {
    let [low, high] = if any {
        [0.0, 1.0]
    } else {
        [settings.restitution_low, settings.restitution_high]
    };
    GearEstimator::new(low, high, settings.scatter).with_contact(settings.contact_time())
}

#[cfg(any(test, feature = "memo"))]
mod plans;
mod queries;

#[cfg(test)]
mod tests;
