//! The controller: one call per drive cycle decides what the drive does next.

use core::f32::consts::{PI, TAU};

use super::amplitude::AmplitudeLoop;
use super::settings::Settings;
use super::signal::{Command, Cycle, Signal, phase_step};
use super::supervise::{Event, Events, Fault, Limits, State};
use crate::feeder::OutOfRange;

/// Slices of planning ([`Controller::plan_step`]) that a drive cycle gets.
pub const PLAN_SLICES: usize = 8;

/// What the user wants of the parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// Parts locked to the drive, one impact every `order` cycles.
    Locked {
        /// Drive cycles per impact (symbol r), 1..=8.
        order: u8,
    },
    /// Parts in chaotic motion.
    Chaotic,
    /// A value of k, 0.02..10.
    K(f32),
    /// A normal amplitude b in mm.
    Amplitude(f32),
    /// A conveying speed in mm/s.
    Speed(f32),
}

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
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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
    /// By this share of the distance each cycle.
    Envelope(f32),
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
    /// g cos(alpha) in m/s^2.
    pull: f32,
    /// Largest amplitude that both hard limits allow, in m, and the limit that it is.
    ceiling: f32,
    ceiling_limit: Limits,
    step: u32,
    amplitude: AmplitudeLoop,
    target: Target,
    setpoint: f32,
    state: State,
    fault: Option<Fault>,
    /// Whether the enable input must be withdrawn before the drive may start.
    latched: bool,
    limits: Limits,
    reference: f32,
    output: f32,
    /// Envelope that nominal gain would give, in m.
    expected: f32,
    in_state: u32,
    arrived: u8,
    link_silence: u32,
    link_known: bool,
    suspicions: Suspicions,
    count: u32,
}

impl Controller {
    /// The controller for these settings and this target; the refusal names the parameter.
    pub fn build(settings: &Settings, target: Target, start: Start) -> Result<Self, OutOfRange> {
        let amplitude = AmplitudeLoop::build(settings)?;
        let angular = TAU * settings.frequency;
        let square = angular * angular;
        let by_acceleration = settings.acceleration_limit / square;
        let by_amplitude = settings.amplitude_limit * 1e-3;
        let fault = match start {
            Start::Ordinary => None,
            Start::Reset => Some(Fault::WatchdogReset),
            Start::Refused => Some(Fault::SettingsInvalid),
        };
        let mut controller = Self {
            settings: *settings,
            square,
            pull: settings.gravity * libm::cosf(settings.incline * (PI / 180.0)),
            ceiling: by_acceleration.min(by_amplitude),
            ceiling_limit: if by_acceleration < by_amplitude {
                Limits::ACCELERATION
            } else {
                Limits::AMPLITUDE
            },
            step: phase_step(settings.frequency),
            amplitude,
            target,
            setpoint: 0.0,
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
            in_state: 0,
            arrived: 0,
            link_silence: 0,
            link_known: false,
            suspicions: Suspicions::default(),
            count: 0,
        };
        controller.set_target(target)?;
        Ok(controller)
    }

    /// A controller that only reports refused settings, off until settings are accepted.
    #[must_use]
    pub fn refused() -> Option<Self> {
        Self::build(&Settings::default(), Target::Amplitude(0.0), Start::Refused).ok()
    }

    /// Takes a new target; refused, with the old one kept, where its number is out of range.
    pub fn set_target(&mut self, target: Target) -> Result<(), OutOfRange> {
        let refuse = |parameter, value: f32, accepted| {
            Err(OutOfRange {
                parameter,
                value: f64::from(value),
                accepted,
            })
        };
        let setpoint = match target {
            Target::Locked { order } => {
                if !(1..=8).contains(&order) {
                    return refuse("target locked order", f32::from(order), "1..8");
                }
                let r = 0.5 * (self.settings.restitution_low + self.settings.restitution_high);
                let (low, high) = band(r, f32::from(order));
                self.amplitude_of(0.5 * (low + high))
            }
            Target::Chaotic => self.amplitude_of(0.34),
            Target::K(k) => {
                if !(0.02..=10.0).contains(&k) {
                    return refuse("target k", k, "0.02..10");
                }
                self.amplitude_of(k)
            }
            Target::Amplitude(b) => {
                if !(0.0..=self.settings.amplitude_limit).contains(&b) {
                    return refuse("target amplitude", b, "0..amplitude_limit mm");
                }
                b * 1e-3
            }
            Target::Speed(speed) => {
                if !speed.is_finite() {
                    return refuse("target speed", speed, "a finite speed in mm/s");
                }
                self.settings.safe_amplitude * 1e-3
            }
        };
        self.target = target;
        self.setpoint = setpoint;
        self.arrived = 0;
        if matches!(
            self.state,
            State::Holding | State::Capturing | State::Locked | State::Lost | State::Limiting
        ) {
            self.enter(State::Starting);
        }
        Ok(())
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
        let mut events = Events::default();
        self.count = self.count.wrapping_add(1);
        self.in_state = self.in_state.saturating_add(1);
        let sine = -cycle.quadrature / self.square;
        let cosine = -cycle.in_phase / self.square;
        let measured = libm::sqrtf(sine * sine + cosine * cosine);
        let lead = libm::atan2f(cosine, sine);
        let blind = self.watch(cycle, inputs, measured, lead, &mut events);
        self.obey(inputs, measured, &mut events);
        self.follow_link(inputs, &mut events);
        let limits_before = self.limits;
        let (goal, pace) = self.goal();
        let goal = self.within_limits(goal);
        self.reference = match pace {
            Move::Ramp(rate) => self.reference + (goal - self.reference).clamp(-rate, rate),
            Move::Envelope(share) => self.reference + share * (goal - self.reference),
        };
        if self.running() {
            // A sensor that may be lost is not followed: the output waits for the verdict.
            if !blind {
                self.output = self.amplitude.cycle(measured, self.reference);
            }
            self.limits.set(Limits::OUTPUT, self.amplitude.saturated());
            self.progress(goal, measured, &mut events);
        } else {
            self.output = 0.0;
            self.reference = 0.0;
            self.amplitude.reset();
            self.limits = Limits::default();
        }
        if limits_before.is_empty() && !self.limits.is_empty() {
            events.push(Event::Limited);
        } else if !limits_before.is_empty() && self.limits.is_empty() {
            events.push(Event::Freed);
        }
        let keep = libm::expf(-PI / self.settings.quality);
        self.expected =
            keep * self.expected + (1.0 - keep) * self.output * self.settings.gain * 1e-3;
        Report {
            cycle: self.count,
            k: self.pull / (measured * self.square),
            amplitude: measured,
            lead,
            reference: self.reference,
            setpoint: self.setpoint,
            state: self.state,
            fault: self.fault,
            limits: self.limits,
            events,
            command: Command {
                amplitude: self.output,
                step: self.step,
                immediate: !self.running(),
            },
        }
    }

    /// One bounded slice of planning; whether more is to be done. Call it in idle time, at most
    /// as often per cycle as it says that there is more.
    pub fn plan_step(&mut self) -> bool {
        false
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
                    // Refused settings stay refused until others are accepted.
                    if self.fault != Some(Fault::SettingsInvalid) {
                        self.fault = None;
                        self.latched = false;
                        self.suspicions = Suspicions::default();
                        self.enter(State::Off);
                        events.push(Event::Acknowledged);
                    }
                }
                _ => {
                    self.enter(State::Stopping);
                    events.push(Event::Stopping);
                }
            }
        }
        match self.state {
            State::Off if inputs.enable && !self.latched => {
                self.enter(State::Starting);
                self.arrived = 0;
                self.expected = 0.0;
                events.push(Event::Started);
            }
            State::Stopping => {
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

    fn follow_link(&mut self, inputs: &Inputs, _events: &mut Events) {
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
        self.limits.set(Limits::LINK_LOST, lost && self.running());
    }

    /// Where the reference is to go, in m, and how.
    fn goal(&self) -> (f32, Move) {
        let setpoint = self.setpoint.max(self.settings.safe_amplitude * 1e-3);
        let up = Move::Ramp(setpoint / (self.settings.soft_start * self.settings.frequency));
        let down = Move::Ramp(setpoint / (self.settings.soft_stop * self.settings.frequency));
        if self.limits.contains(Limits::LINK_LOST) {
            return (self.settings.safe_amplitude * 1e-3, down);
        }
        match self.state {
            State::Off | State::Fault => (0.0, Move::Envelope(1.0)),
            State::Stopping => (0.0, down),
            _ => (self.setpoint, up),
        }
    }

    fn within_limits(&mut self, goal: f32) -> f32 {
        let cut = goal > self.ceiling;
        self.limits.set(self.ceiling_limit, cut);
        goal.min(self.ceiling)
    }

    /// Moves between the states of a running drive.
    fn progress(&mut self, goal: f32, measured: f32, events: &mut Events) {
        let near = (measured - goal).abs() < 0.01 * goal && self.reference == goal;
        match self.state {
            State::Starting => {
                self.arrived = if near { self.arrived + 1 } else { 0 };
                if self.arrived >= 3 {
                    self.enter(State::Holding);
                    events.push(Event::SetpointReached);
                }
            }
            State::Holding if !self.limits.is_empty() && self.in_state > 10 => {
                self.enter(State::Limiting);
            }
            State::Limiting if self.limits.is_empty() => self.enter(State::Starting),
            _ => {}
        }
    }
}

/// Band of the period-1 orbit of order r: (k2, k1), physics section 5.
fn band(restitution: f32, order: f32) -> (f32, f32) {
    let ratio = (1.0 - restitution) / (1.0 + restitution);
    let a = PI * order * ratio;
    let b = 2.0 * (1.0 + restitution * restitution) / ((1.0 + restitution) * (1.0 + restitution));
    (1.0 / libm::sqrtf(a * a + b * b), 1.0 / a)
}

impl Signal {
    /// Hands the command of a report to the signal path.
    pub fn obey(&mut self, report: &Report) {
        self.command(report.command);
    }
}
