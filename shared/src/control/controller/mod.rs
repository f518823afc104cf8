//! Supervisory control of one drive: once per drive cycle, from measurements to the next command.
//!
//! A state machine (`supervise`) selects the reference, and the amplitude loop (`drive`) tracks it.
//! The textbook pattern is supervisory control of a servo loop. ARCHITECTURE.md walks through one
//! cycle.

use core::f32::consts::TAU;

use crate::arithmetic::{Phase, sine_cosine_single, square_root_single};
use crate::control::aim::{NoSetpoint, Selection};
use crate::control::angle::{phase_of, radians_of};
use crate::control::supervise::{
    Clearance, Decision, EnableResponse, Expected, FaultDetector, Interlock, LimitInputs,
    LimitMonitor, Observation, RestTest, Standstill, StateMachine, SwingResult, TestSwing,
};
use crate::control::target::Target;
use num_complex::Complex32 as Complex;

use crate::control::drive::{
    AmplitudeLoop, Asked, Move, Reference, Resonance, Scale, Shape, Struck, Tones, TrackMotion,
    UPPER, size,
};
use crate::control::hear::{
    Cycle, Deafness, GearHearing, HeardWith, Listener, LoadMeter, Sound, Tuned, Weighed, Weighing,
};
use crate::control::identify::{self, Driven, Identifier, Step};
use crate::control::inputs::{Inputs, StartCause};
use crate::control::report::Report;
use crate::control::settings::Settings;
use crate::control::state::{Event, Events, Fault, Limits, State};
use crate::feeder::OutOfRange;

/// Slices of planning ([`Controller::plan_step`]) per drive cycle.
pub const PLAN_SLICES: usize = 16;
/// Cycles per quarter of the setpoint while the amplitude glides from a lock to chaos, slow enough
/// to follow each doubling (docs/theory-capture.md#t7.4).
const GLIDE: f32 = 150.0;
/// Relative error of the amplitude at which the setpoint counts as reached: half of the default
/// amplitude error that kicks are planned for.
const NEAR: f32 = 0.01;
/// Amplitude over the hard limit below which the track counts as at rest: about the reading of
/// sensor noise.
const AT_REST: f32 = 0.02;
/// Amplitude, in m per mm of the safe one (30 % of it), above which the resonance is tracked;
/// below, noise hides the phase.
const FOLLOWED: f32 = 0.3e-3;
/// Amplitude over the smallest detectable one above which the upper tones are phase-locked to the
/// first.
const FIRST_TELLS: f32 = 4.0;

/// The controller of one drive.
///
/// [`Controller::cycle`] runs once per drive cycle, at the latest before the next one ends. The
/// signal path latches its command at the next wrap of the phase. [`Controller::plan_step`]
/// computes one bounded slice of planning and belongs in idle time.
///
/// ```
/// use kband::control::{Controller, Cycle, Inputs, Settings, StartCause, State, Target};
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
///
/// A closed loop, sample by sample, with a simulated feeder in place of the board:
///
/// ```
/// use kband::control::{Controller, Signal, State, Target};
/// use kband::plant::{Bench, Scene};
/// let scene = Scene {
///     target: Target::K(0.41),
///     ..Scene::default()
/// };
/// let mut bench = Bench::build(&scene)?;
/// let mut signal = Signal::build(&scene.settings)?;
/// let mut controller = Controller::build(&scene.settings, scene.target, scene.start)?;
/// let mut cycles = 0;
/// while cycles < 60 {
///     // The sample interrupt.
///     let before = signal.phase();
///     let sampled = signal.sample(bench.sample());
///     bench.hold(sampled.output, (signal.phase() - before).bits());
///     if sampled.wrapped {
///         // Once a cycle, with a slice of planning in the idle time that is left.
///         let report = controller.cycle(signal.cycle(), &bench.inputs());
///         signal.command(report.command);
///         controller.plan_step();
///         cycles += 1;
///     }
/// }
/// let report = controller.report();
/// assert_eq!(report.state, State::Holding);
/// assert!((report.k / 0.41 - 1.0).abs() < 0.02);
/// # Ok::<(), kband::feeder::OutOfRange>(())
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
    deafness: Deafness,
    identifier: Identifier,
    /// Phase lead of the track in the last trusted cycle, in rad.
    lead: f32,
    /// Events since the last cycle.
    news: Events,
    limits: LimitMonitor,
    reference: Reference,
    output: f32,
    /// Phase lead of the output before the drive's phase, in rad.
    ahead: f32,
    tones: Tones,
    /// Estimator of the parts' load; `None` without `track_mass`.
    meter: Option<LoadMeter>,
    weighing: Weighing,
    /// Predicted envelope at the ends of three cycles, newest first, over the steady envelope at
    /// full output. The first is of the cycle that the last output drives. The last reading is the
    /// mean of the other two.
    expected: [Complex; 3],
    faults: FaultDetector,
    rest_test: RestTest,
    swing: TestSwing,
    count: u32,
    seen: Seen,
}

/// Measurements of the last cycle.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    /// Amplitude b, in m.
    amplitude: f32,
    /// Phase lead of the track before the output.
    lead: Phase,
    /// Shape of the track's motion.
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
        let scale = Scale::at(settings, resonance.frequency());
        let mut controller = Self {
            settings: *settings,
            scale,
            resonance,
            amplitude,
            selection: Selection::at(target, settings, &scale)?,
            machine: StateMachine::begin(interlock.at_pace(pace), pace, settings.capture_attempts),
            listener: Listener::build(gear_hearing(settings, false))?,
            deafness: Deafness::default(),
            identifier: Identifier::new(),
            lead: 0.0,
            news: Events::default(),
            limits: LimitMonitor::default(),
            reference: Reference::default(),
            output: 0.0,
            ahead: 0.0,
            tones: Tones::build(settings)?,
            meter: LoadMeter::build(settings),
            weighing: Weighing::default(),
            expected: [Complex::default(); 3],
            faults: FaultDetector::default(),
            rest_test: RestTest::build(settings),
            swing: TestSwing::build(settings, scale.envelope.cycles),
            count: 0,
            seen: Seen::default(),
        };
        controller.pursue();
        Ok(controller)
    }

    /// Sets a new target.
    ///
    /// The error names a number out of range, or an amplitude beyond the drive's output; the old
    /// target then stays. A target can lose its setpoint later, by new settings; a target of
    /// [`Controller::build`] can lack one from the start. See [no
    /// setpoint](Controller::no_setpoint).
    ///
    /// [`Controller::plan_step`] searches for the lock that gives a requested speed. Until it is
    /// [chosen](Controller::chosen), a running drive keeps its amplitude, and a drive at rest does
    /// not start.
    pub fn set_target(&mut self, target: Target) -> Result<(), OutOfRange> {
        let selection = Selection::at(target, &self.settings, &self.scale)?;
        if let Some(NoSetpoint::Output { .. }) = selection.no_setpoint() {
            return Err(refused(
                target,
                "what output_maximum and gain let the drive reach at its frequency",
            ));
        }
        self.selection = selection;
        self.news.push(Event::TargetSet);
        self.pursue();
        Ok(())
    }

    /// Records that the settings in use were saved. A fault for invalid settings can then be
    /// acknowledged.
    pub fn settings_saved(&mut self) {
        self.machine.settings_saved();
    }

    /// Begins the way to the target.
    fn pursue(&mut self) {
        self.machine.pursue(self.selection.chaos.is_some());
        let identifies = self.selection.target() == Target::Identify;
        self.listener.gear = gear_hearing(&self.settings, identifies);
        self.listener.forget();
        if identifies {
            self.identifier.begin();
        } else {
            self.identifier.stop();
        }
        if self.selection.no_setpoint().is_some() {
            self.news.push(Event::NoSetpoint);
        }
    }

    /// Processes one cycle's measurements and the board's inputs. The report holds the next
    /// command.
    pub fn cycle(&mut self, cycle: &Cycle, inputs: &Inputs) -> Report {
        self.advance(cycle, inputs);
        self.report()
    }

    /// As [`Controller::cycle`], without the report.
    pub(crate) fn advance(&mut self, cycle: &Cycle, inputs: &Inputs) {
        let mut events = core::mem::take(&mut self.news);
        self.count = self.count.wrapping_add(1);
        // The counter wraps after 99 days at 500 Hz; the classifier's clock restarts with it.
        if self.count == 0 {
            self.listener.begin();
        }
        self.machine.count();
        let silent = Cycle::default();
        let mut sound = cycle.is_finite();
        let cycle = if sound { cycle } else { &silent };
        let sine = -cycle.quadrature / self.scale.square;
        let cosine = -cycle.in_phase / self.scale.square;
        let [mut sine, mut cosine] = self.weigh(cycle, sine, cosine);
        if !(sine.is_finite() && cosine.is_finite()) {
            [sine, cosine] = [0.0; 2];
            sound = false;
        }
        let measured = square_root_single(sine * sine + cosine * cosine);
        let lead = phase_of(libm::atan2f(cosine, sine));
        let motion = self.motion(cycle, Complex::new(sine, cosine));
        let held_back = !self.limits.limits().is_empty();
        let blind = self.watch(cycle, inputs, measured, radians_of(lead), &mut events);
        self.obey(inputs, measured, &mut events);
        if !blind {
            self.lead = radians_of(lead);
        }
        self.limit(inputs);
        let goal = self.move_reference();
        if !self.machine.running() {
            self.rest();
        } else if inputs.held_off {
            self.coast();
        } else if self.resonance.sweeps() {
            self.sweep(measured, &mut events);
        } else {
            // The reading of a sensor that may be lost is not used: the output is held.
            if !blind {
                let reference = self.reference.now;
                let most = self.most_output();
                let struck = Struck {
                    at: (self.meter.as_ref()).map_or(Complex::default(), LoadMeter::struck),
                    silent: self.meter.as_ref().is_none_or(LoadMeter::silent),
                };
                [self.output, self.ahead] = self
                    .amplitude
                    .under_load(motion.first, struck, reference, most)
                    .unwrap_or_else(|| [self.amplitude.cycle(measured, reference, most), 0.0]);
                let wanted = self.machine.listens_for_chaos();
                let heard_with = HeardWith {
                    count: self.count,
                    lead,
                    order: self.order().unwrap_or(1),
                    k: self.scale.k(measured),
                    shape: self.seen.shape,
                };
                let stands = self.machine.kick().is_none()
                    && self.reference.now == goal
                    && (measured - goal).abs() < 2.0 * NEAR * goal;
                let tuned = Tuned {
                    lot: self.selection.lot(&self.settings),
                    lead,
                    order: heard_with.order,
                    k: heard_with.k,
                    shape: heard_with.shape,
                    step: self.scale.step,
                    stands,
                };
                self.listener
                    .cycle(cycle, &heard_with, self.selection.lock(), &tuned, wanted);
                self.follow_resonance(measured);
                self.make_tones(&motion, &mut events);
            }
            self.listen(cycle, goal, measured);
            self.progress(goal, measured, &mut events);
            self.retune_gear();
            let flow = self.load().map(|load| load.flow);
            self.selection
                .serve_flow(flow, &self.settings, &self.scale, &mut events);
            self.identify(cycle, goal, measured, &mut events);
        }
        let load = self.load();
        if let Some(event) = self.weighing.cycle(load, self.resonance.frequency()) {
            events.push(event);
        }
        let limits = self.limits.limits();
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
            self.expected = [Complex::default(); 3];
            self.rest();
        }
        // The limit also holds while an untrusted reading freezes the output.
        self.output = self.output.min(self.most_output());
        let [newest, before, _] = self.expected;
        // Missing amplitude counts as load only while impacts are detected.
        let load = if self.listener.phases.rate() > 0.0 {
            self.amplitude.load()
        } else {
            0.0
        };
        let (_, along) = sine_cosine_single(phase_of(self.ahead));
        let driven = self.output * along - load;
        self.expected = [self.scale.after(newest, driven), newest, before];
        self.seen = Seen {
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

    /// Whether every number of the command is finite.
    fn commands_finite(&self) -> bool {
        let upper = self.tones.output();
        let mut numbers = upper.as_flattened().iter();
        self.output.is_finite() && self.ahead.is_finite() && numbers.all(|part| part.is_finite())
    }

    /// Estimates the parts' load. Gives the track's motion along sine and cosine of the output's
    /// phase, in m, corrected for the impacts that the demodulator blanks.
    fn weigh(&mut self, cycle: &Cycle, sine: f32, cosine: f32) -> [f32; 2] {
        if self.meter.is_none() {
            return [sine, cosine];
        }
        let one = self.listener.margin();
        let phases = &self.listener.phases;
        let goal = self.selection.setpoint(&self.scale);
        let (across, along) = sine_cosine_single(phase_of(self.ahead));
        let seen = Weighed {
            motion: Complex::new(sine, cosine),
            output: Complex::new(along, across) * self.output,
            blanked: cycle.blanked,
            square: self.scale.square,
            frequency: self.resonance.frequency(),
            normal_gravity: self.scale.normal_gravity,
            in_gear: self.in_gear(),
            order: self.order().unwrap_or(1),
            restitution: one.map(|margin| margin.restitution),
            cosine: one.map(|_| libm::cosf(phases.phase()) * phases.concentration()),
            sine: self.selection.shape().is_sine(),
            concentration: phases.concentration(),
            heard: !cycle.heard.is_empty(),
            stands: self.machine.kick().is_none()
                && self.machine.running()
                && self.selection.chosen()
                && (self.reference.now - goal).abs() < NEAR * goal
                && (self.seen.amplitude - goal).abs() < 10.0 * NEAR * goal,
        };
        match &mut self.meter {
            Some(meter) => {
                let found = meter.cycle(&seen);
                [found.re, found.im]
            }
            None => [sine, cosine],
        }
    }

    /// Converts the demodulated acceleration to the track's motion, in m.
    fn motion(&self, cycle: &Cycle, first: Complex) -> TrackMotion {
        // Displacement over acceleration at twice and three times the frequency.
        let scales = [-1.0 / 4.0, -1.0 / 9.0];
        let mut upper = [Complex::default(); UPPER];
        for ((tone, [cosine, sine]), scale) in upper.iter_mut().zip(cycle.upper).zip(scales) {
            *tone = Complex::new(sine, cosine) * (scale / self.scale.square);
        }
        TrackMotion { first, upper }
    }

    /// Controls the upper tones, where the settings allow any. They run at the chosen setpoint
    /// only: never while the link is lost, no setpoint exists, or the drive stops.
    fn make_tones(&mut self, motion: &TrackMotion, events: &mut Events) {
        if !self.tones.allowed() {
            return;
        }
        let limits = self.limits.limits();
        let sound = !limits.contains(Limits::LINK_LOST)
            && !limits.contains(Limits::NO_SETPOINT)
            && self.machine.state() != State::Stopping
            && self.selection.chosen();
        let asked = Asked {
            motion: *motion,
            wanted: if sound {
                self.selection.shape()
            } else {
                Shape::SINE
            },
            reference: self.reference.now,
            square: self.scale.square,
            room: self.settings.output_maximum - self.output,
            least: FIRST_TELLS * self.scale.least,
        };
        let unlike = [Event::SecondToneUnlike, Event::ThirdToneUnlike];
        for (event, happened) in unlike.into_iter().zip(self.tones.cycle(&asked)) {
            if happened {
                events.push(event);
            }
        }
    }

    /// Detects faults. Whether this cycle's reading is untrusted.
    fn watch(
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
        if inputs.stack_low {
            self.machine.fail(Fault::StackLow, events);
        }
        if inputs.supply_low {
            self.machine.fail(Fault::SupplyLow, events);
        }
        if inputs.clock_failed {
            self.machine.fail(Fault::ClockFailed, events);
        }
        if self.machine.running() {
            for (present, fault) in [
                (inputs.over_current, Fault::OverCurrent),
                (inputs.control_late, Fault::ControlLate),
                (inputs.over_temperature, Fault::OverTemperature),
            ] {
                if present {
                    self.machine.fail(fault, events);
                }
            }
        }
        self.rest_test.cycle(cycle);
        let expects = (self.expected[1] + self.expected[2]) * (0.5 * self.scale.strength);
        let expected = Expected {
            running: self.machine.running(),
            known: !self.resonance.sweeps(),
            amplitude: size(expects),
            opposed: self.scale.opposes(expects, lead),
            least: self.scale.least,
            ceiling: self.scale.ceiling,
            reference: self.reference.now,
            error: cycle.noise * square_root_single(2.0 / f32::from(cycle.samples.max(1)))
                / self.scale.square,
            tolerance: self.settings.load_tolerance,
            shifted: self.rest_test.deviates() == Some(true),
        };
        let (fault, blind) = self.faults.cycle(cycle, measured, lead, &expected);
        if let Some(fault) = fault {
            self.machine.fail(fault, events);
        }
        match self.swing.cycle(measured, expected.amplitude) {
            SwingResult::Pending => {}
            // The test swing moves no part, so the usual ratio under load is estimated from here.
            SwingResult::Passed => self.faults.forget_usual(),
            SwingResult::Failed => self.machine.fail(Fault::SensorImplausible, events),
        }
        blind
    }

    /// Follows the enable input.
    fn obey(&mut self, inputs: &Inputs, measured: f32, events: &mut Events) {
        let rest = Standstill {
            reached: self.reference.now <= 0.0 && measured < AT_REST * self.scale.ceiling,
            patience: 4.0 * self.settings.soft_stop * self.settings.frequency,
        };
        if !inputs.enable && !self.machine.running() {
            self.rest_test.restart();
        }
        let clearance = match self.rest_test.deviates() {
            Some(true) => Clearance::Refused(Fault::SensorImplausible),
            Some(false) if self.selection.chosen() => Clearance::Granted,
            _ => Clearance::Pending,
        };
        let response = self.machine.obey(inputs, clearance, &rest, events);
        match response {
            Some(EnableResponse::Acknowledged) => self.faults = FaultDetector::default(),
            Some(EnableResponse::Stopping) if self.resonance.sweeps() => {
                self.resonance.stop();
                self.amplitude.resume(measured, self.output);
            }
            Some(EnableResponse::Started) => {
                self.expected = [Complex::default(); 3];
                self.tones.restart();
                self.swing.begin();
                if self.selection.target() == Target::Identify
                    && self.selection.no_setpoint().is_none()
                {
                    self.identifier.begin();
                    self.selection.go(identify::FIRST);
                }
                if self.resonance.tracks() && self.sweep_amplitude() > 0.0 {
                    self.resonance.begin();
                    self.retune();
                }
            }
            Some(EnableResponse::Stopping) | None => {}
        }
    }

    /// Detects a target that depends on impacts while none are detected.
    fn listen(&mut self, cycle: &Cycle, goal: f32, measured: f32) {
        let limits = self.limits.limits();
        let settled = match self.machine.state() {
            State::Holding | State::Capturing | State::Locked | State::Lost => true,
            State::Limiting => limits == Limits::DEAF,
            _ => false,
        };
        let near = (measured - goal).abs() < 2.0 * NEAR * goal || self.machine.kick().is_some();
        let order = self.order();
        let wanted = match self.selection.target() {
            Target::Gear { .. } | Target::Flow(_) => true,
            _ => self.selection.lock().is_some(),
        };
        let turns = f32::from(order.unwrap_or(1));
        let unit = measured * square_root_single(self.scale.square);
        let middle = 0.5 * (self.settings.restitution_low + self.settings.restitution_high);
        self.deafness.cycle(&Sound {
            listening: settled && wanted && self.selection.chosen(),
            together: self.selection.lock().is_some(),
            near,
            rate: self.listener.phases.rate() * turns,
            concentration: self.listener.phases.concentration(),
            thrown: unit * self.listener.gear.thrown(),
            locked: unit * TAU * turns * self.scale.k(measured) / (1.0 + middle),
            kicked: self.machine.attempts() > 0,
            noise: cycle.noise,
        });
    }

    /// Determines the limits that hold the drive back in this cycle.
    fn limit(&mut self, inputs: &Inputs) {
        let timeout = self.settings.link_timeout;
        self.limits.cycle(&LimitInputs {
            running: self.machine.running(),
            link_heard: inputs.link_heard,
            link_timeout: (timeout > 0.0).then_some(timeout * self.settings.frequency),
            no_setpoint: self.selection.no_setpoint().is_some(),
            // The frequencies of a sweep differ from that of the setpoint.
            cut: !self.resonance.sweeps()
                && self.selection.setpoint(&self.scale) > self.scale.ceiling,
            ceiling_limit: self.scale.ceiling_limit,
            deaf: self.deafness.is_deaf(),
            saturated: self.amplitude.saturated(),
            tones: self.tones.held_back() != [false; UPPER],
        });
    }

    /// Moves the reference by one cycle; its goal, in m.
    fn move_reference(&mut self) -> f32 {
        let (settings, setpoint) = (&self.settings, self.selection.setpoint(&self.scale));
        let limits = self.limits.limits();
        let safe = settings.safe_amplitude * 1e-3;
        let scale = setpoint.max(safe) / settings.frequency;
        let (fewest, pace) = self.amplitude.start();
        let start = settings.soft_start.max(fewest / settings.frequency);
        let up = Move::Ramp(pace * scale / start);
        let down = Move::Ramp(scale / settings.soft_stop);
        let (goal, pace) = match (self.machine.state(), self.machine.kick()) {
            (State::Off | State::Fault, _) => (0.0, Move::Step),
            (State::Stopping, _) => (0.0, down),
            // Without a certain target the amplitude falls or stays, and never rises.
            _ if limits.contains(Limits::LINK_LOST) => {
                (safe.min(setpoint).min(self.reference.now), down)
            }
            _ if limits.contains(Limits::NO_SETPOINT) => (safe.min(self.reference.now), down),
            _ if !self.selection.chosen() => (self.reference.now, Move::Step),
            (_, Some(kick)) => (setpoint * kick, Move::Lag),
            _ if self.machine.glides() => (setpoint, Move::Ramp(setpoint * (0.25 / GLIDE))),
            _ => (setpoint, up),
        };
        let goal = goal.min(self.scale.ceiling);
        let allowed = self.swing_limits().map_or(goal, |[most, _]| goal.min(most));
        self.reference
            .go(allowed, pace, self.lead, self.settings.envelope);
        self.swing
            .hold(allowed < goal && self.reference.now == allowed);
        goal
    }

    /// Limits of a start's test swing on the reference and on the output's amplitude, in m. `None`
    /// during a resonance search, and after the test.
    fn swing_limits(&self) -> Option<[f32; 2]> {
        let Scale { ceiling, least, .. } = self.scale;
        let limits = self.swing.limits(self.reference.now, ceiling, least);
        limits.filter(|_| !self.resonance.sweeps())
    }

    /// Upper limit of the next output, as a share of full output. It does not depend on the
    /// accelerometer.
    fn most_output(&self) -> f32 {
        let amplitude = self.swing_limits().map(|[_, most]| most);
        self.scale.most_output(self.expected[0], amplitude)
    }

    /// Switches the drive off and resets every loop.
    fn rest(&mut self) {
        (self.output, self.ahead) = (0.0, 0.0);
        self.reference.now = 0.0;
        self.amplitude.reset();
        self.tones.rest();
        self.listener.forget();
        self.deafness = Deafness::default();
        self.limits.rest();
        let decision = self.machine.rest();
        self.carry_out(decision);
        self.identifier.interrupt();
    }

    /// Switches the output off while the track comes to rest; the bridge is open already.
    fn coast(&mut self) {
        (self.output, self.ahead) = (0.0, 0.0);
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

    /// One cycle of the resonance search. The output is constant and gives the safe amplitude at
    /// the resonance.
    fn sweep(&mut self, measured: f32, events: &mut Events) {
        let output = self.sweep_amplitude() / self.scale.strength;
        self.output = output.min(self.settings.output_maximum);
        self.ahead = 0.0;
        self.reference.now = measured;
        let ended = self.resonance.swept(measured);
        self.retune();
        if ended {
            self.amplitude.resume(measured, self.output);
            events.push(Event::ResonanceFound);
        }
    }

    fn follow_resonance(&mut self, measured: f32) {
        if self.resonance.tracks() && measured > FOLLOWED * self.settings.safe_amplitude {
            self.resonance.follow(self.lead - self.ahead);
            self.retune();
        }
    }

    /// Updates the numbers that depend on the drive's frequency.
    fn retune(&mut self) {
        self.scale
            .retune(&self.settings, self.resonance.frequency());
    }

    /// Confidence, 0..1, that the parts are in the wanted lock; 0 where the impact of a single part
    /// would not be detected.
    fn confidence(&self) -> f32 {
        if self.deafness.hears_crowds_only() {
            return 0.0;
        }
        self.listener.confidence(self.selection.lock())
    }

    /// Moves between the states of a running drive.
    #[inline(always)]
    fn progress(&mut self, goal: f32, measured: f32, events: &mut Events) {
        let seen = Observation {
            near: self.selection.chosen()
                && self.reference.now == goal
                && (measured - goal).abs() < NEAR * goal
                && self.tones.arrived(),
            limits: self.limits.limits(),
            lock: self.selection.lock().map(|_| self.confidence()),
            regime: self.listener.regime.as_ref(),
            plan: self.selection.search.plan(),
            chaos: self.selection.found_chaos(),
        };
        let decision = self.machine.progress(&seen, events);
        self.carry_out(decision);
    }

    /// Plans gear anew where the parts have changed.
    fn retune_gear(&mut self) {
        if self.machine.settled() {
            self.selection.retune(
                self.listener.margin().as_ref(),
                self.tones.held_back(),
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
            Decision::ListenAnew => self.listener.forget(),
            Decision::GoToChaos(k) => self.selection.go(k),
            Decision::GoToLock => self.selection.go_to_lock(),
            Decision::NoChaos => self.selection.give_up_chaos(),
        }
    }

    /// One cycle of the identification, if one runs.
    fn identify(&mut self, cycle: &Cycle, goal: f32, measured: f32, events: &mut Events) {
        if !self.identifier.listens() {
            return;
        }
        if self.machine.state() != State::Holding {
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
            thrown: self.listener.gear.thrown(),
            loudness: self.listener.gear.loudness(),
        };
        match self.identifier.cycle(&driven, cycle) {
            Step::Going => {}
            Step::At(k) => {
                self.listener.forget();
                self.selection.go(k);
            }
            Step::Done(true) => events.push(Event::Identified),
            Step::Done(false) => events.push(Event::NotIdentified),
        }
    }

    /// Computes one bounded slice of planning. Whether more remain. Call it in idle time, at most
    /// as often per cycle as it returns true.
    pub fn plan_step(&mut self) -> bool {
        self.selection
            .step(&self.settings, &self.scale, &mut self.news)
            || self.identifier.step()
            || self.listener.share.step()
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
        Target::Chaotic => ("target chaotic, order of its lock", 1.0),
        Target::Identify => ("target identify, k that it begins at", identify::FIRST),
    };
    OutOfRange {
        parameter,
        value,
        accepted,
    }
}

/// The estimator of gear: for the configured lot, or for any restitution where the identification
/// is to estimate it.
fn gear_hearing(settings: &Settings, any: bool) -> GearHearing {
    let Settings {
        restitution_low,
        restitution_high,
        scatter,
        ..
    } = *settings;
    if any {
        GearHearing::new(0.0, 1.0, scatter)
    } else {
        GearHearing::new(restitution_low, restitution_high, scatter)
    }
}

#[cfg(any(test, feature = "unstable"))]
mod plans;
mod queries;

#[cfg(test)]
mod tests;
