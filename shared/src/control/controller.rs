//! The controller: one call per drive cycle decides what the drive does next.

use core::f32::consts::{PI, TAU};

use super::amplitude::{AmplitudeLoop, held};
use super::angle::{phase_of, radians_of};
use super::capture::{Capture, Planned, Progress, Search};
use super::chaos::{Chaos, ChaosSearch};
use super::hearing::Hearing;
use super::identify::{self, Driven, Identification, Identifier, Step};
use super::resonance::Resonance;
use super::setpoint::{Choice, Level, LockAt, NoSetpoint, Target};
use super::settings::Settings;
use super::signal::{Command, Cycle, Signal, phase_step};
use super::speed::SpeedSearch;
use super::supervise::{Event, Events, Fault, Limits, State};
use crate::arithmetic::Phase;
use crate::feeder::OutOfRange;
use crate::regime::capture::PlanSettings;
use crate::regime::classify::{Classifier, HearingSettings, Regime, Verdict};

/// Slices of planning ([`Controller::plan_step`]) that a drive cycle gets.
pub const PLAN_SLICES: usize = 16;

/// Why the controller starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Start {
    /// Power came, or a user asked for it.
    #[default]
    Ordinary,
    /// The watchdog or a brown-out reset the board: off until enabled anew.
    Reset,
    /// The stored settings were refused: off, with the defaults in their place.
    Refused,
}

/// What the board tells the controller each cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Inputs {
    /// The enable input.
    pub enable: bool,
    /// The over-temperature input.
    pub over_temperature: bool,
    /// Whether the link brought a valid frame since the last cycle.
    pub link_heard: bool,
    /// Whether the stack came close to its end.
    pub stack_low: bool,
}

/// What the controller saw and did in one cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Report {
    /// Cycles since the controller was built.
    pub cycle: u32,
    /// Measured k; infinite at rest.
    pub k: f32,
    /// Measured normal amplitude of the track (symbol b) in m.
    pub amplitude: f32,
    /// Measured phase lead of the track before the output, in rad, -pi..pi.
    pub lead: f32,
    /// Amplitude that the loop follows at the end of the next cycle but one, in m.
    pub reference: f32,
    /// Amplitude chosen for the target, in m; 0 where there is none.
    pub setpoint: f32,
    /// Impacts heard per cycle, over the last 16.
    pub rate: f32,
    /// Mean phase of the track (symbol t) at the impacts heard, in rad, -pi..pi.
    pub phase: f32,
    /// Concentration of these phases, 0..1.
    pub concentration: f32,
    /// What the parts are heard to do, and how sure that is.
    pub regime: Option<Verdict>,
    /// Drive frequency in Hz.
    pub frequency: f32,
    /// Confidence that the parts are in the wanted lock, 0..1.
    pub confidence: f32,
    /// Kicks begun for the present target.
    pub attempts: u8,
    /// How far the identification of the parts' restitution has come.
    pub identification: Identification,
    /// What the controller is doing.
    pub state: State,
    /// What stopped it.
    pub fault: Option<Fault>,
    /// What holds it back.
    pub limits: Limits,
    /// What happened in this cycle.
    pub events: Events,
    /// What the drive is to do.
    pub command: Command,
}

/// How the reference moves to its goal.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Move {
    /// By at most this much a cycle, in m.
    Ramp(f32),
    /// Along the envelope of kicks.
    Envelope,
    /// At once.
    At,
}

/// Cycles at the setpoint before the controller takes parts that are not heard in lock for not locked.
const PATIENCE: u32 = 40;
/// Confidence from which a lock is believed, and below which it is no longer.
const BELIEVED: f32 = 0.9;
const DOUBTED: f32 = 0.6;
/// Cycles from one look at the regime to the next: its search for periods is the costliest part of a cycle.
const LOOK: u32 = 8;
/// Confidence from which a regime that is heard is believed.
const SURE: f32 = 0.5;
/// Cycles in which the amplitude glides from a lock to chaos: slow enough that each doubling is followed.
const GLIDE: f32 = 150.0;
/// Cycles in lock before the glide begins.
const SETTLED: u32 = 50;

/// Where the way to chaos stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Glide {
    /// Chaos is not wanted.
    Unwanted,
    /// First the lock.
    Ahead,
    /// On the way.
    Going,
    /// At the amplitude; whether chaos was heard.
    There {
        /// Whether it was heard.
        heard: bool,
    },
}

/// Cycles after which a suspicion is a fault.
#[derive(Clone, Copy, Debug, Default)]
struct Suspicion(u8);

impl Suspicion {
    /// Whether `present` has been true for `cycles` cycles in a row.
    fn lasts(&mut self, present: bool, cycles: u8) -> bool {
        self.0 = if present { self.0.saturating_add(1) } else { 0 };
        self.0 >= cycles
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Suspicions {
    still: Suspicion,
    saturated: Suspicion,
    inverted: Suspicion,
    unanswered: Suspicion,
    excessive: Suspicion,
}

/// The controller of one drive.
///
/// [`Controller::cycle`] runs once per drive cycle, at the latest before the next one ends: its
/// command is latched at the next wrap of the phase. [`Controller::plan_step`] does one bounded slice
/// of planning and belongs in idle time.
#[derive(Clone, Debug)]
pub struct Controller {
    settings: Settings,
    /// Square of the angular frequency, in 1/s^2.
    square: f32,
    /// Advance of the phase per sample.
    step: u32,
    /// g cos(alpha) in m/s^2.
    pull: f32,
    /// Largest amplitude that both hard limits allow, in m, and the limit that it is.
    ceiling: f32,
    ceiling_limit: Limits,
    resonance: Resonance,
    amplitude: AmplitudeLoop,
    target: Target,
    level: Level,
    setpoint: f32,
    lock: Option<LockAt>,
    glide: Glide,
    speed: Option<SpeedSearch>,
    chaos: Option<ChaosSearch>,
    /// Falls out of chaos since the target was set.
    falls: u8,
    classifier: Classifier<64>,
    regime: Option<Verdict>,
    hearing: Hearing,
    capture: Capture,
    search: Search,
    identifier: Identifier,
    /// Amplitude commanded for the last cycle of a kick, in m.
    commanded: f32,
    /// Lead of the track at the last cycle that could be trusted, in rad.
    lead: f32,
    /// Events that happened between two cycles.
    news: Events,
    state: State,
    fault: Option<Fault>,
    /// Whether the enable input must be withdrawn before the drive may start.
    latched: bool,
    limits: Limits,
    reference: f32,
    output: f32,
    /// Envelope that nominal gain would give, in m.
    expected: f32,
    /// Share of it that a cycle leaves.
    keep: f32,
    in_state: u32,
    arrived: u8,
    /// Cycles that the output has stood at its limit.
    strained: u32,
    doubts: u8,
    /// Whether every kick allowed has failed for the present target.
    given_up: bool,
    link_silence: u32,
    link_known: bool,
    suspicions: Suspicions,
    count: u32,
    regime_watched: bool,
    seen: Seen,
}

/// What was seen in a cycle.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    /// Amplitude in m.
    amplitude: f32,
    /// Phase lead of the track before the output.
    lead: Phase,
    events: Events,
}

impl Controller {
    /// The controller for these settings and this target; the refusal names the parameter.
    pub fn build(settings: &Settings, target: Target, start: Start) -> Result<Self, OutOfRange> {
        let amplitude = AmplitudeLoop::build(settings)?;
        let fault = match start {
            Start::Ordinary => None,
            Start::Reset => Some(Fault::WatchdogReset),
            Start::Refused => Some(Fault::SettingsInvalid),
        };
        let mut controller = Self {
            settings: *settings,
            square: 0.0,
            step: 0,
            pull: settings.gravity * libm::cosf(settings.incline * (PI / 180.0)),
            ceiling: 0.0,
            ceiling_limit: Limits::AMPLITUDE,
            resonance: Resonance::new(settings),
            amplitude,
            target,
            level: Level::Amplitude(0.0),
            setpoint: 0.0,
            lock: None,
            glide: Glide::Unwanted,
            speed: None,
            chaos: None,
            falls: 0,
            classifier: Classifier::build(HearingSettings::EAR)?,
            regime: None,
            hearing: Hearing::default(),
            capture: Capture::new(settings.capture_attempts as u8),
            search: Search::default(),
            identifier: Identifier::new(),
            commanded: 0.0,
            lead: 0.0,
            news: Events::default(),
            state: if fault.is_some() {
                State::Fault
            } else {
                State::Off
            },
            fault,
            latched: fault.is_some(),
            limits: Limits::default(),
            reference: 0.0,
            output: 0.0,
            expected: 0.0,
            keep: libm::expf(-PI / settings.quality),
            in_state: 0,
            arrived: 0,
            strained: 0,
            doubts: 0,
            given_up: false,
            link_silence: 0,
            link_known: false,
            suspicions: Suspicions::default(),
            count: 0,
            regime_watched: true,
            seen: Seen::default(),
        };
        controller.retune();
        controller.set_target(target)?;
        // A controller that starts with its target has not been given one.
        controller.news = Events::default();
        if controller.no_setpoint().is_some() {
            controller.news.push(Event::NoSetpoint);
        }
        Ok(controller)
    }

    /// A controller that only reports refused settings, off until settings are accepted.
    #[must_use]
    pub fn refused() -> Option<Self> {
        Self::build(&Settings::default(), Target::Amplitude(0.0), Start::Refused).ok()
    }

    /// Takes a new target; refused, with the old one kept, where its number is out of range.
    ///
    /// The lock for a speed is searched for by [`Controller::plan_step`]: until it is
    /// [chosen](Controller::chosen) a running drive keeps its amplitude, and one that is off does not start.
    pub fn set_target(&mut self, target: Target) -> Result<(), OutOfRange> {
        let choice = Choice::of(target, &self.settings)?;
        let search = self.search(&choice)?;
        let chaotic = target == Target::Chaotic && choice.lock.is_some();
        self.chaos = if chaotic {
            Some(ChaosSearch::begin(&self.settings)?)
        } else {
            None
        };
        self.glide = if chaotic {
            Glide::Ahead
        } else {
            Glide::Unwanted
        };
        self.speed = match target {
            Target::Speed(speed) => Some(SpeedSearch::begin(speed)),
            _ => None,
        };
        self.falls = 0;
        self.target = target;
        self.arrived = 0;
        self.given_up = false;
        self.forget_parts();
        self.capture.stop();
        if target == Target::Identify {
            self.identifier.begin();
        } else {
            self.identifier.stop();
        }
        self.news.push(Event::TargetSet);
        self.choose(choice, search);
        if self.settled_state() {
            self.enter(State::Starting);
        }
        Ok(())
    }

    /// The search for the kicks that a choice needs.
    fn search(&self, choice: &Choice) -> Result<Search, OutOfRange> {
        match choice.lock {
            Some(lock) => {
                let reserve = self.reserve(self.amplitude_of(lock.k as f32));
                Search::begin(&self.settings, &lock, reserve)
            }
            None => Ok(Search::default()),
        }
    }

    /// Takes the choice for the target, with the search for its kicks.
    fn choose(&mut self, choice: Choice, search: Search) {
        self.lock = choice.lock;
        self.search = search;
        self.set_level(choice.level);
        if matches!(choice.level, Level::None(_)) {
            self.news.push(Event::NoSetpoint);
        }
    }

    /// Whether the setpoint for the target is known, or that it has none: the lock for a speed is searched for.
    #[must_use]
    pub fn chosen(&self) -> bool {
        self.level != Level::Sought
    }

    /// Why the target has no setpoint, and what would allow one.
    #[must_use]
    pub fn no_setpoint(&self) -> Option<NoSetpoint> {
        match self.level {
            Level::None(why) => Some(why),
            _ => None,
        }
    }

    fn set_level(&mut self, level: Level) {
        self.level = level;
        self.setpoint = match level {
            Level::K(k) => self.amplitude_of(k as f32),
            Level::Amplitude(amplitude) => amplitude,
            Level::Sought | Level::None(_) => 0.0,
        };
    }

    /// What depends on the drive's frequency.
    fn retune(&mut self) {
        let angular = TAU * self.resonance.frequency();
        self.square = angular * angular;
        self.step = phase_step(self.resonance.frequency());
        let by_acceleration = self.settings.acceleration_limit / self.square;
        let by_amplitude = self.settings.amplitude_limit * 1e-3;
        self.ceiling = by_acceleration.min(by_amplitude);
        self.ceiling_limit = if by_acceleration < by_amplitude {
            Limits::ACCELERATION
        } else {
            Limits::AMPLITUDE
        };
        self.set_level(self.level);
    }

    /// Forgets what the parts were heard to do.
    fn forget_parts(&mut self) {
        self.hearing.reset();
        self.classifier.forget();
        self.regime = None;
    }

    fn settled_state(&self) -> bool {
        matches!(
            self.state,
            State::Holding | State::Capturing | State::Locked | State::Lost | State::Limiting
        )
    }

    /// Amplitude chosen for the target in m, before any limit; 0 where there is none.
    #[must_use]
    pub fn setpoint(&self) -> f32 {
        self.setpoint
    }

    /// Largest amplitude in m that the settings let the drive reach.
    #[must_use]
    pub fn reach(&self) -> f32 {
        let settings = &self.settings;
        // Response of the resonance at the drive's frequency over the one at resonance.
        let x = settings.frequency / settings.resonance;
        let (detuned, damped) = (1.0 - x * x, x / settings.quality);
        let response = 1.0 / (settings.quality * libm::sqrtf(detuned * detuned + damped * damped));
        (settings.output_maximum * settings.gain * 1e-3 * response).min(self.ceiling)
    }

    /// k at a normal amplitude in m.
    #[must_use]
    pub fn k(&self, amplitude: f32) -> f32 {
        self.pull / (amplitude * self.square)
    }

    /// Order of the lock that is wanted, also as the way to chaos or for a speed.
    #[must_use]
    pub fn order(&self) -> Option<u8> {
        self.lock.map(|lock| lock.order)
    }

    /// How far the identification of the parts' restitution has come ([`Target::Identify`]). A result is
    /// offered here and applied nowhere; it stays until the next identification.
    #[must_use]
    pub fn identification(&self) -> Identification {
        self.identifier.result()
    }

    /// The target.
    #[must_use]
    pub fn target(&self) -> Target {
        self.target
    }

    /// The settings in use.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Takes a cycle of the signal path and the board's inputs; what was seen, and what the drive is to do.
    pub fn cycle(&mut self, cycle: &Cycle, inputs: &Inputs) -> Report {
        self.advance(cycle, inputs);
        self.report()
    }

    /// As [`Controller::cycle`], for who does not read each report.
    pub fn advance(&mut self, cycle: &Cycle, inputs: &Inputs) {
        let mut events = core::mem::take(&mut self.news);
        self.count = self.count.wrapping_add(1);
        // After 99 days at 500 Hz the count begins anew, and with it the classifier's time.
        if let (0, Ok(fresh)) = (self.count, Classifier::build(HearingSettings::EAR)) {
            self.classifier = fresh;
        }
        self.in_state = self.in_state.saturating_add(1);
        let sine = -cycle.quadrature / self.square;
        let cosine = -cycle.in_phase / self.square;
        let measured = libm::sqrtf(sine * sine + cosine * cosine);
        let lead = phase_of(libm::atan2f(cosine, sine));
        let held_back = !self.limits.is_empty();
        let blind = self.watch(cycle, inputs, measured, radians_of(lead), &mut events);
        self.obey(inputs, measured, &mut events);
        if !blind {
            self.lead = radians_of(lead);
        }
        self.limit(inputs);
        let goal = self.move_reference();
        if !self.running() {
            self.rest();
        } else if self.resonance.sweeps() {
            self.sweep(measured, &mut events);
        } else {
            // A sensor that may be lost is not followed: the output waits for the verdict.
            if !blind {
                self.output = self.amplitude.cycle(measured, self.reference);
                self.hear(cycle, lead);
                self.follow_resonance(measured);
            }
            self.progress(goal, measured, &mut events);
            self.identify(cycle, goal, measured, &mut events);
        }
        if !held_back && !self.limits.is_empty() {
            events.push(Event::Limited);
        } else if held_back && self.limits.is_empty() && self.running() {
            events.push(Event::Freed);
        }
        let keep = self.keep;
        self.expected =
            keep * self.expected + (1.0 - keep) * self.output * self.settings.gain * 1e-3;
        self.seen = Seen {
            amplitude: measured,
            lead,
            events,
        };
    }

    /// What was seen and done in the last cycle.
    #[must_use]
    pub fn report(&self) -> Report {
        let seen = &self.seen;
        Report {
            cycle: self.count,
            k: self.k(seen.amplitude),
            amplitude: seen.amplitude,
            lead: radians_of(seen.lead),
            reference: self.reference,
            setpoint: self.setpoint,
            rate: self.hearing.rate(),
            phase: self.hearing.phase(),
            concentration: self.hearing.concentration(),
            confidence: self.confidence(),
            attempts: self.capture.attempts(),
            identification: self.identifier.result(),
            regime: self.regime,
            frequency: self.resonance.frequency(),
            state: self.state,
            fault: self.fault,
            limits: self.limits,
            events: seen.events,
            command: self.command(),
        }
    }

    /// What the drive is to do.
    #[must_use]
    pub fn command(&self) -> Command {
        Command {
            amplitude: self.output,
            step: self.step,
            immediate: !self.running(),
            fold: self.identifier.fold(),
        }
    }

    /// What the controller is doing.
    #[must_use]
    pub fn state(&self) -> State {
        self.state
    }

    /// What happened in the last cycle.
    #[must_use]
    pub fn events(&self) -> Events {
        self.seen.events
    }

    /// Normal amplitude of the track (symbol b) measured in the last cycle, in m.
    #[must_use]
    pub fn amplitude(&self) -> f32 {
        self.seen.amplitude
    }

    /// Amplitude that the loop follows at the end of the next cycle but one, in m.
    #[must_use]
    pub fn reference(&self) -> f32 {
        self.reference
    }

    /// Whether the regime is judged where the controller does not act on it, for [`Report::regime`]: it is,
    /// unless this says otherwise.
    pub fn watch_regime(&mut self, watched: bool) {
        self.regime_watched = watched;
    }

    /// One bounded slice of planning; whether more is to be done. Call it in idle time, at most
    /// as often per cycle as it says that there is more.
    pub fn plan_step(&mut self) -> bool {
        if self.speed.is_some() {
            self.seek_speed();
            return true;
        }
        if self.search.step() {
            return true;
        }
        self.chaos.as_mut().is_some_and(ChaosSearch::step) || self.identifier.step()
    }

    /// One slice of the search for the lock of a speed.
    fn seek_speed(&mut self) {
        let Some(choice) = (self.speed.as_mut()).and_then(|search| search.step(&self.settings))
        else {
            return;
        };
        self.speed = None;
        match self.search(&choice) {
            Ok(search) => self.choose(choice, search),
            // A lock whose kicks cannot be planned is none to go to.
            Err(_) => {
                let none = Level::None(NoSetpoint::Speed(None));
                self.choose(Choice::level(none), Search::default());
            }
        }
    }

    /// The kicks that [`Controller::plan_step`] is searching for; `None` where there is nothing to search.
    #[must_use]
    pub fn planning(&self) -> Option<&PlanSettings> {
        self.search.asked()
    }

    /// Spares the search that [`Controller::planning`] tells of, where another controller has done it.
    pub fn plan_known(&mut self, known: Planned) {
        self.search.know(known);
    }

    /// The search that has come to its end for the present target.
    #[must_use]
    pub fn planned(&self) -> Option<Planned> {
        self.search.planned()
    }

    /// The lot whose chaos [`Controller::plan_step`] is searching for; `None` where there is nothing to search.
    #[must_use]
    pub fn chaos_asked(&self) -> Option<[f32; 2]> {
        self.chaos.as_ref().and_then(ChaosSearch::asked)
    }

    /// Spares the search that [`Controller::chaos_asked`] tells of, where another controller has done it.
    pub fn chaos_known(&mut self, known: Chaos) {
        if let Some(chaos) = &mut self.chaos {
            chaos.know(known);
        }
    }

    /// The search for chaos that has come to its end for the present target.
    #[must_use]
    pub fn chaos_found(&self) -> Option<Chaos> {
        self.chaos.as_ref().and_then(ChaosSearch::found)
    }

    /// Everything at rest, drive off.
    fn rest(&mut self) {
        self.output = 0.0;
        self.reference = 0.0;
        self.strained = 0;
        self.amplitude.reset();
        self.forget_parts();
        self.capture.stop();
        self.limits = Limits::default();
        self.back_to_lock();
        self.identifier.interrupt();
    }

    /// A cycle of the search for the resonance, at the output that gives the safe amplitude there.
    fn sweep(&mut self, measured: f32, events: &mut Events) {
        let output = self.settings.safe_amplitude / self.settings.gain;
        self.output = output.min(self.settings.output_maximum);
        self.reference = measured;
        let ended = self.resonance.swept(measured);
        self.retune();
        if ended {
            self.amplitude.resume(measured, self.output);
            events.push(Event::ResonanceFound);
        }
    }

    fn follow_resonance(&mut self, measured: f32) {
        if self.resonance.tracks() && measured > 0.3e-3 * self.settings.safe_amplitude {
            self.resonance.follow(self.lead);
            self.retune();
        }
    }

    /// Takes what was heard in a cycle.
    fn hear(&mut self, cycle: &Cycle, lead: Phase) {
        let lock = self.lock.map(|lock| (lock.phase, lock.width));
        self.hearing.cycle(cycle, lead, lock);
        for heard in cycle.impacts() {
            let time = (u64::from(self.count) << 32 | u64::from(heard.phase.bits()))
                .wrapping_add_signed(i64::from(lead.bits() as i32));
            self.classifier
                .impact((time >> 32) as u32, Phase::from_bits(time as u32));
        }
        self.classifier.cycle(self.count);
        if self.count.is_multiple_of(LOOK) && (self.regime_watched || self.gliding()) {
            self.regime = Some(self.classifier.verdict());
        }
    }

    /// How far a kick may go over an amplitude within the drive's output and hard limits.
    fn reserve(&self, amplitude: f32) -> f32 {
        // The first cycle of a step of the command from 1 to f needs an output of 1 + s (f - 1), with s
        // the step of the reference over the step of the drive's own envelope.
        let steeper = (1.0 - libm::expf(-1.0 / self.settings.envelope)) / (1.0 - self.keep);
        let strength = self.settings.output_maximum * self.settings.gain * 1e-3 / amplitude;
        (1.0 + (strength - 1.0) / steeper.max(1.0)).min(self.ceiling / amplitude)
    }

    fn amplitude_of(&self, k: f32) -> f32 {
        self.pull / (k * self.square)
    }

    fn running(&self) -> bool {
        !matches!(self.state, State::Off | State::Fault)
    }

    fn enter(&mut self, state: State) {
        self.state = state;
        self.in_state = 0;
    }

    fn fail(&mut self, fault: Fault, events: &mut Events) {
        if self.fault.is_none() {
            self.fault = Some(fault);
            self.latched = true;
            self.enter(State::Fault);
            events.push(Event::Faulted);
        }
    }

    /// Looks for faults; whether this cycle's reading may not be trusted.
    fn watch(
        &mut self,
        cycle: &Cycle,
        inputs: &Inputs,
        measured: f32,
        lead: f32,
        events: &mut Events,
    ) -> bool {
        if inputs.stack_low {
            self.fail(Fault::StackLow, events);
        }
        if inputs.over_temperature && self.running() {
            self.fail(Fault::OverTemperature, events);
        }
        let moving = self.running() && self.expected > 0.02e-3;
        let still = moving && cycle.high <= cycle.low.saturating_add(1);
        let saturated = self.running() && !still && cycle.saturated >= 4;
        let unanswered = moving && !still && measured < 0.15 * self.expected;
        let inverted = moving && !unanswered && lead > 0.4 && lead < PI - 0.4;
        let excessive = self.running() && measured > 1.15 * self.ceiling;
        if self.suspicions.still.lasts(still, 3) {
            self.fail(Fault::SensorLost, events);
        }
        if self.suspicions.saturated.lasts(saturated, 5) {
            self.fail(Fault::SensorSaturated, events);
        }
        if self.suspicions.inverted.lasts(inverted, 5) {
            self.fail(Fault::SensorInverted, events);
        }
        if self.suspicions.unanswered.lasts(unanswered, 15) {
            self.fail(Fault::NoResponse, events);
        }
        if self.suspicions.excessive.lasts(excessive, 2) {
            self.fail(Fault::OverAmplitude, events);
        }
        still || saturated || unanswered
    }

    /// Follows the enable input.
    fn obey(&mut self, inputs: &Inputs, measured: f32, events: &mut Events) {
        if !inputs.enable {
            match self.state {
                State::Off | State::Stopping => {}
                State::Fault => {
                    // Each fault is reported for a cycle at least, and stays while its cause does: refused
                    // settings until others are accepted.
                    let stays = match self.fault {
                        Some(Fault::SettingsInvalid) => true,
                        Some(Fault::OverTemperature) => inputs.over_temperature,
                        Some(Fault::StackLow) => inputs.stack_low,
                        _ => false,
                    };
                    if self.in_state > 0 && !stays {
                        self.fault = None;
                        self.latched = false;
                        self.suspicions = Suspicions::default();
                        self.enter(State::Off);
                        events.push(Event::Acknowledged);
                    }
                }
                _ => {
                    if self.resonance.sweeps() {
                        self.resonance.stop();
                        self.amplitude.resume(measured, self.output);
                    }
                    self.enter(State::Stopping);
                    events.push(Event::Stopping);
                }
            }
        }
        match self.state {
            State::Off if inputs.enable && !self.latched && self.chosen() => {
                self.enter(State::Starting);
                self.arrived = 0;
                self.expected = 0.0;
                events.push(Event::Started);
                if self.target == Target::Identify {
                    self.identifier.begin();
                    self.set_level(Level::K(identify::FIRST));
                }
                if self.resonance.tracks() {
                    self.resonance.begin();
                    self.retune();
                }
            }
            State::Stopping if self.in_state > 0 => {
                let patience = 4.0 * self.settings.soft_stop * self.settings.frequency;
                let at_rest = self.reference <= 0.0 && measured < 0.02 * self.ceiling;
                if at_rest || self.in_state as f32 > patience {
                    self.enter(State::Off);
                    events.push(Event::Stopped);
                }
            }
            _ => {}
        }
    }

    /// What holds the drive back in this cycle.
    fn limit(&mut self, inputs: &Inputs) {
        if inputs.link_heard {
            self.link_known = true;
            self.link_silence = 0;
        } else {
            self.link_silence = self.link_silence.saturating_add(1);
        }
        let timeout = self.settings.link_timeout;
        let lost = self.link_known
            && timeout > 0.0
            && self.link_silence as f32 > timeout * self.settings.frequency;
        // Short stays at the limit belong to every start and kick.
        self.strained = if self.amplitude.saturated() {
            self.strained.saturating_add(1)
        } else {
            0
        };
        let running = self.running();
        self.limits.set(Limits::LINK_LOST, running && lost);
        self.limits
            .set(Limits::NO_SETPOINT, running && self.no_setpoint().is_some());
        // The frequencies of a sweep are not those of the setpoint.
        let cut = running && !self.resonance.sweeps() && self.setpoint > self.ceiling;
        self.limits.set(self.ceiling_limit, cut);
        self.limits
            .set(Limits::OUTPUT, running && self.strained > 25);
    }

    /// Moves the reference by one cycle; where it goes, in m.
    fn move_reference(&mut self) -> f32 {
        let safe = self.settings.safe_amplitude * 1e-3;
        let scale = self.setpoint.max(safe) / self.settings.frequency;
        let up = Move::Ramp(scale / self.settings.soft_start);
        let down = Move::Ramp(scale / self.settings.soft_stop);
        let (goal, pace) = match self.state {
            State::Off | State::Fault => (0.0, Move::At),
            State::Stopping => (0.0, down),
            _ if self.limits.contains(Limits::LINK_LOST) => (safe, down),
            _ if self.limits.contains(Limits::NO_SETPOINT) => (safe, up),
            _ if !self.chosen() => (self.reference, Move::At),
            State::Capturing => (self.setpoint * self.capture.command(), Move::Envelope),
            State::Holding if self.glide == Glide::Going => {
                (self.setpoint, Move::Ramp(self.setpoint * (0.25 / GLIDE)))
            }
            _ => (self.setpoint, up),
        };
        let goal = goal.min(self.ceiling);
        self.reference = match pace {
            Move::At => goal,
            Move::Ramp(rate) => self.reference + held(goal - self.reference, -rate, rate),
            Move::Envelope => self.after_a_cycle(goal),
        };
        self.commanded = goal;
        goal
    }

    /// The reference a cycle on, along the envelope of kicks. A kick's cycles begin at phase 0 of the
    /// track, where the plan has them, so the first part of the output's cycle still belongs to the
    /// command before.
    fn after_a_cycle(&self, goal: f32) -> f32 {
        let before = -self.lead * (1.0 / TAU);
        let before = before - libm::floorf(before);
        let along = |from: f32, to: f32, cycles: f32| {
            to + (from - to) * libm::expf(-cycles / self.settings.envelope)
        };
        let next = along(
            along(self.reference, self.commanded, before),
            goal,
            1.0 - before,
        );
        // The last thousandth is no use to the parts.
        if (next - goal).abs() < 1e-3 * goal {
            goal
        } else {
            next
        }
    }

    fn confidence(&self) -> f32 {
        match self.lock {
            Some(lock) => self.hearing.lock_confidence(lock.order),
            None => 0.0,
        }
    }

    /// A cycle of the identification, where one is under way.
    fn identify(&mut self, cycle: &Cycle, goal: f32, measured: f32, events: &mut Events) {
        if !self.identifier.listens() {
            return;
        }
        if self.state != State::Holding {
            self.identifier.interrupt();
            return;
        }
        let off = if self.reference == goal {
            (measured - goal).abs() / goal
        } else {
            f32::INFINITY
        };
        let driven = Driven {
            off,
            k: f64::from(self.k(measured)),
            lead: phase_of(self.lead),
            least: f64::from(self.k(self.reach())),
            pull: self.pull,
            step: phase_step(self.resonance.frequency()),
        };
        let step = self.identifier.cycle(&driven, cycle);
        match step {
            Step::Going => {}
            Step::At(k) => {
                self.forget_parts();
                self.set_level(Level::K(k));
            }
            Step::Done(true) => events.push(Event::Identified),
            Step::Done(false) => events.push(Event::NotIdentified),
        }
    }

    /// Moves between the states of a running drive.
    fn progress(&mut self, goal: f32, measured: f32, events: &mut Events) {
        let near = self.chosen() && self.reference == goal && (measured - goal).abs() < 0.01 * goal;
        let confidence = self.confidence();
        let locked = confidence >= BELIEVED;
        if self.settled_state() && self.state != State::Limiting && !self.limits.is_empty() {
            self.capture.stop();
            self.enter(State::Limiting);
            return;
        }
        match self.state {
            State::Starting => {
                self.arrived = if near {
                    self.arrived.saturating_add(1)
                } else {
                    0
                };
                let strained = self.limits.contains(Limits::OUTPUT);
                if self.arrived >= 3 || strained {
                    self.forget_parts();
                    if self.limits.is_empty() {
                        self.enter(State::Holding);
                        events.push(Event::SetpointReached);
                    } else {
                        self.enter(State::Limiting);
                    }
                }
            }
            State::Limiting if self.limits.is_empty() => {
                self.arrived = 0;
                self.enter(State::Starting);
            }
            State::Holding if self.gliding() => self.glide_on(near, events),
            State::Holding if self.lock.is_some() => {
                if locked {
                    self.enter(State::Locked);
                    events.push(Event::Locked);
                } else if self.in_state >= PATIENCE && !self.given_up {
                    self.capture.begin();
                    self.enter(State::Capturing);
                }
            }
            State::Capturing => match self.capture.cycle(&self.search, locked, near) {
                Progress::Going => {}
                Progress::Planned { sure: true } => events.push(Event::KickPlanned),
                Progress::Planned { sure: false } => events.push(Event::KickUncertain),
                Progress::Begun => {
                    events.push(Event::KickBegun);
                    self.forget_parts();
                }
                Progress::Ended => events.push(Event::KickEnded),
                Progress::Captured => {
                    self.enter(State::Locked);
                    events.push(Event::Locked);
                }
                Progress::Failed => {
                    self.given_up = true;
                    self.enter(State::Holding);
                    events.push(Event::NotCaptured);
                }
            },
            State::Locked => {
                self.doubts = if confidence < DOUBTED {
                    self.doubts.saturating_add(1)
                } else {
                    0
                };
                if self.doubts >= 10 {
                    self.doubts = 0;
                    self.enter(State::Lost);
                    events.push(Event::LockLost);
                } else if self.glide == Glide::Ahead && self.in_state >= SETTLED {
                    self.leave_lock(events);
                }
            }
            State::Lost => {
                if locked {
                    self.enter(State::Locked);
                    events.push(Event::Locked);
                } else if self.in_state >= PATIENCE {
                    self.capture.begin();
                    self.enter(State::Capturing);
                }
            }
            _ => {}
        }
    }
}

impl Controller {
    fn gliding(&self) -> bool {
        matches!(self.glide, Glide::Going | Glide::There { .. })
    }

    /// Leaves the lock for chaos, once the search for it is over.
    fn leave_lock(&mut self, events: &mut Events) {
        match self.chaos.filter(ChaosSearch::done).map(|chaos| chaos.k()) {
            None => {}
            Some(Some(k)) => {
                self.glide = Glide::Going;
                self.set_level(Level::K(k));
                self.enter(State::Holding);
            }
            Some(None) => {
                self.glide = Glide::Unwanted;
                self.lock = None;
                self.set_level(Level::None(NoSetpoint::Chaos));
                events.push(Event::NoSetpoint);
            }
        }
    }

    /// Goes back to the amplitude of the lock, from which chaos is reached.
    fn back_to_lock(&mut self) {
        if let (true, Some(lock)) = (self.gliding(), self.lock) {
            self.glide = Glide::Ahead;
            self.set_level(Level::K(lock.k));
        }
    }

    /// On the way to chaos, and there: listens whether the parts are in it.
    fn glide_on(&mut self, near: bool, events: &mut Events) {
        match self.glide {
            Glide::Going if near => {
                self.glide = Glide::There { heard: false };
                self.forget_parts();
            }
            Glide::There { heard } => {
                let sure = self.regime.filter(|verdict| verdict.confidence >= SURE);
                match sure.map(|verdict| verdict.regime) {
                    Some(Regime::Chaotic) if !heard => {
                        self.glide = Glide::There { heard: true };
                        events.push(Event::Chaotic);
                    }
                    Some(Regime::Rest | Regime::HopAndRest { .. }) => self.fall(events),
                    _ => {}
                }
            }
            _ => {}
        }
    }

    /// The parts fell out of chaos to rest: the way begins anew, as often as kicks are allowed.
    fn fall(&mut self, events: &mut Events) {
        self.falls = self.falls.saturating_add(1);
        self.back_to_lock();
        if f32::from(self.falls) > self.settings.capture_attempts {
            self.given_up = true;
            self.glide = Glide::Unwanted;
            self.enter(State::Holding);
            events.push(Event::NotCaptured);
        } else {
            self.arrived = 0;
            self.enter(State::Starting);
            events.push(Event::LockLost);
        }
    }
}

impl Signal {
    /// Hands the command of a report to the signal path.
    pub fn obey(&mut self, report: &Report) {
        self.command(report.command);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Heard;

    #[test]
    fn the_parts_are_heard_beyond_the_last_count_of_cycles() {
        let target = Target::Locked { order: 1 };
        let mut controller =
            Controller::build(&Settings::default(), target, Start::Ordinary).unwrap();
        controller.count = u32::MAX - 150;
        let inputs = Inputs {
            enable: true,
            ..Inputs::default()
        };
        let mut cycle = Cycle {
            samples: 400,
            low: 1500,
            high: 2500,
            heard_count: 1,
            ..Cycle::default()
        };
        cycle.heard[0] = Heard {
            phase: Phase::from_radians(0.445),
            strength: 5.0,
        };
        let mut heard = |silent: bool| {
            cycle.heard_count = u8::from(!silent);
            let mut report = Report::default();
            for _ in 0..120 {
                report = controller.cycle(&cycle, &inputs);
                cycle.quadrature = -report.reference * controller.square;
            }
            (report.cycle, report.regime.map(|verdict| verdict.regime))
        };
        let locked = Some(Regime::Locked { order: 1 });
        assert_eq!(heard(false), (u32::MAX - 30, locked));
        assert_eq!(heard(false), (89, locked));
        assert_eq!(heard(true), (209, Some(Regime::Rest)));
    }

    /// A controller at a target, with its drive following, and what it reports.
    fn driven(target: Target) -> (Controller, Report) {
        let settings = Settings {
            restitution_low: 0.199,
            restitution_high: 0.201,
            ..Settings::default()
        };
        let mut controller = Controller::build(&settings, target, Start::Ordinary).unwrap();
        let mut report = Report::default();
        for _ in 0..60 {
            report = follow(&mut controller, true, 1);
        }
        (controller, report)
    }

    /// A cycle of a drive that does as it is told, and some slices.
    fn follow(controller: &mut Controller, enable: bool, slices: usize) -> Report {
        let cycle = Cycle {
            samples: 400,
            quadrature: -controller.reference() * controller.square,
            low: 1500,
            high: 2500,
            ..Cycle::default()
        };
        let inputs = Inputs {
            enable,
            ..Inputs::default()
        };
        let report = controller.cycle(&cycle, &inputs);
        for _ in 0..slices {
            controller.plan_step();
        }
        report
    }

    #[test]
    fn the_amplitude_stays_while_the_lock_for_a_speed_is_sought() {
        let (mut controller, before) = driven(Target::K(0.5));
        assert_eq!(before.state, State::Holding);
        controller.set_target(Target::Speed(180.0)).unwrap();
        for _ in 0..7 {
            let report = follow(&mut controller, true, 1);
            assert!(!controller.chosen());
            assert_eq!(report.state, State::Starting);
            assert_eq!(report.reference, before.reference);
            assert_eq!(report.setpoint, 0.0);
        }
        follow(&mut controller, true, 1);
        let (other, _) = driven(Target::Speed(180.0));
        assert!(controller.chosen() && controller.order() == Some(2));
        assert_eq!(controller.setpoint(), other.setpoint());
        assert_eq!(controller.planning(), other.planning());
        assert!(follow(&mut controller, true, 1).reference > before.reference);
    }

    #[test]
    fn a_drive_starts_once_the_lock_for_a_speed_is_chosen() {
        let target = Target::Speed(40.0);
        let mut controller =
            Controller::build(&Settings::default(), target, Start::Ordinary).unwrap();
        for _ in 0..8 {
            assert_eq!(follow(&mut controller, true, 1).state, State::Off);
        }
        let report = follow(&mut controller, true, 1);
        assert_eq!(report.state, State::Starting);
        let events: std::vec::Vec<_> = report.events.iter().collect();
        assert_eq!(events, [Event::NoSetpoint, Event::Started, Event::Limited]);
    }

    #[test]
    fn whatever_comes_between_the_slices_of_a_search_the_lock_is_that_of_the_last_target() {
        let wanted = driven(Target::Speed(180.0)).0;
        for slices in 0..8 {
            for trouble in 0..4 {
                let (mut controller, _) = driven(Target::Locked { order: 1 });
                controller.set_target(Target::Speed(90.0)).unwrap();
                follow(&mut controller, true, slices);
                match trouble {
                    // Another speed, another target, a stop, a fault.
                    0 => controller.set_target(Target::Speed(268.0)).unwrap(),
                    1 => {
                        controller.set_target(Target::K(0.5)).unwrap();
                        assert!(controller.chosen() && controller.order().is_none());
                    }
                    2 => {
                        let report = follow(&mut controller, false, 0);
                        assert_eq!(report.state, State::Stopping);
                    }
                    _ => {
                        let inputs = Inputs {
                            enable: true,
                            over_temperature: true,
                            ..Inputs::default()
                        };
                        let report = controller.cycle(&Cycle::default(), &inputs);
                        assert_eq!(report.state, State::Fault);
                    }
                }
                follow(&mut controller, trouble < 2, slices);
                controller.set_target(Target::Speed(180.0)).unwrap();
                for enable in [false, true] {
                    for _ in 0..200 {
                        follow(&mut controller, enable, 1);
                    }
                }
                assert_eq!(controller.setpoint(), wanted.setpoint());
                assert_eq!(controller.order(), Some(2));
                assert!(controller.running(), "{slices} {trouble}");
            }
        }
    }
}
