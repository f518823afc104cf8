//! The state machine of a drive: one cycle's observations in, next state and decision out.
//!
//! A finite-state machine (Mealy 1955) with hysteresis; its transitions are in `transition.rs`.

use super::capture::Capture;
use super::interlock::Interlock;
use crate::saturate::consecutive;
use crate::{Event, Events, Fault, Inputs, Limits, State};
use kband::regime::capture::Plan;
use kband::regime::classify::{Regime, Verdict};

/// Cycles at the setpoint before a missing lock triggers a capture: five rise times.
const CAPTURE_DELAY_CYCLES: u32 = 40;
/// Confidence, 0..1, at which a lock is detected: one of 16 cycles may lack its impact.
pub(super) const LOCK_CONFIDENCE: f32 = 0.9;
/// Confidence, 0..1, below which a lock is doubted: period-doubled parts miss half of its window.
pub(super) const LOST_CONFIDENCE: f32 = 0.6;
/// Cycles of doubt in a row that lose the lock, so that no single gap counts twice.
const LOST_CYCLES: u32 = 10;
/// Consecutive cycles near the setpoint that reach it: more than the dead time of two.
const SETPOINT_CYCLES: u32 = 3;
/// Confidence, 0..1, at which a regime is detected: more likely than not.
const REGIME_CONFIDENCE: f32 = 0.5;
/// Cycles in lock before the glide to chaos: three times the memory of the phase statistics.
const LOCK_CYCLES_BEFORE_GLIDE: u32 = 50;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Glide {
    None,
    Lock,
    Gliding,
    Arrived { detected: bool },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clearance {
    Pending,
    Granted,
    Refused(Fault),
}

#[derive(Clone, Copy, Debug)]
pub struct Observation<'a> {
    pub at_setpoint: bool,
    pub limits: Limits,
    /// Confidence that the parts are in the requested lock, 0..1; `None` if no lock is requested.
    pub lock: Option<f32>,
    pub regime: Option<&'a Verdict>,
    pub plan: Option<&'a Plan>,
    /// k of chaos, if the lot has one; `None` before the search is over.
    pub chaos: Option<Option<f64>>,
}

/// Decision that the state machine leaves to the controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decision {
    Stay,
    /// Forget the impacts so far: they are of an earlier setpoint.
    ForgetImpacts,
    /// Set the setpoint to this k, in the lot's chaos.
    GoToChaos(f64),
    /// Set the setpoint back to the lock, from which chaos is reached.
    GoToLock,
    /// The lot has no chaos, hence no setpoint.
    NoChaos,
}

#[derive(Clone, Debug)]
pub struct StateMachine {
    pub state: State,
    pub interlock: Interlock,
    in_state: u32,
    /// Cycles in a row at the setpoint, and in a row with a doubted lock.
    setpoint_cycles: u32,
    doubt_cycles: u32,
    /// Whether every permitted kick has failed for the present target.
    given_up: bool,
    glide: Glide,
    /// Falls out of chaos since the target was set, and the largest permitted number.
    falls: u8,
    max_falls: f32,
    pub capture: Capture,
}

impl StateMachine {
    /// The state machine of a drive at rest: `rate` in cycles per second, `attempts` kicks.
    pub fn begin(interlock: Interlock, rate: f32, attempts: f32) -> Self {
        let has_fault = interlock.fault.is_some();
        Self {
            state: if has_fault { State::Fault } else { State::Off },
            interlock,
            in_state: 0,
            setpoint_cycles: 0,
            doubt_cycles: 0,
            given_up: false,
            glide: Glide::None,
            falls: 0,
            max_falls: attempts,
            capture: Capture::new(attempts as u8, rate),
        }
    }

    pub fn running(&self) -> bool {
        !matches!(self.state, State::Off | State::Fault)
    }

    /// Whether the detected regime decides the next step.
    pub fn detects_chaos(&self) -> bool {
        matches!(self.glide, Glide::Gliding | Glide::Arrived { .. })
    }

    pub fn in_chaos(&self) -> bool {
        self.state == State::Holding && self.glide == Glide::Arrived { detected: true }
    }

    pub fn glides(&self) -> bool {
        self.state == State::Holding && self.glide == Glide::Gliding
    }

    /// Amplitude of a kick over the setpoint, during a capture.
    pub fn kick(&self) -> Option<f32> {
        (self.state == State::Capturing).then(|| self.capture.command())
    }

    /// Restarts the sequence for a new target. `chaotic`: it passes through a lock to chaos.
    pub fn set_chaotic(&mut self, chaotic: bool) {
        self.glide = if chaotic { Glide::Lock } else { Glide::None };
        self.falls = 0;
        self.setpoint_cycles = 0;
        self.given_up = false;
        self.capture.stop();
        if self.settled() {
            self.enter(State::Starting);
        }
    }

    pub fn count(&mut self) {
        self.in_state = self.in_state.saturating_add(1);
        self.interlock.count();
        self.capture.count();
    }

    /// Whether the setpoint was reached since the start.
    pub fn settled(&self) -> bool {
        self.running() && !matches!(self.state, State::Starting | State::Stopping)
    }

    fn enter(&mut self, state: State) {
        self.state = state;
        self.in_state = 0;
    }

    /// Stops the drive with a fault; an earlier fault stays.
    pub fn fail(&mut self, fault: Fault, events: &mut Events) {
        if self.interlock.fail(fault, events) {
            self.enter(State::Fault);
        }
    }

    /// The drive is off and everything at rest; the sequence to chaos restarts.
    pub fn rest(&mut self) -> Decision {
        self.capture.stop();
        self.back_to_lock()
    }

    /// Follows the enable input, to an event. A drive that stops is off at rest, or after
    /// `stop_timeout` cycles.
    pub fn follow_enable_input(
        &mut self,
        inputs: &Inputs,
        clearance: Clearance,
        (at_rest, stop_timeout): (bool, f32),
        events: &mut Events,
    ) -> Option<Event> {
        self.interlock.watch(inputs);
        match self.state {
            State::Fault => {
                if !self.interlock.acknowledges(inputs) {
                    return None;
                }
                self.enter(State::Off);
                Some(Event::Acknowledged)
            }
            State::Off => {
                if !self.interlock.may_start(inputs) {
                    return None;
                }
                if let Clearance::Refused(fault) = clearance {
                    self.fail(fault, events);
                }
                if clearance != Clearance::Granted {
                    return None;
                }
                self.enter(State::Starting);
                self.setpoint_cycles = 0;
                Some(Event::Started)
            }
            State::Stopping => {
                if self.in_state > 0 && (at_rest || self.in_state as f32 > stop_timeout) {
                    self.enter(State::Off);
                    return Some(Event::Stopped);
                }
                None
            }
            _ if !inputs.enable
                || inputs.held_off
                || inputs.withheld
                || inputs.bus.is_some_and(|bus| !bus.runs()) =>
            {
                self.interlock.stopping(inputs);
                self.enter(State::Stopping);
                Some(Event::Stopping)
            }
            _ => None,
        }
    }

    #[inline(always)]
    pub fn advance(&mut self, observation: &Observation<'_>, events: &mut Events) -> Decision {
        let (at_setpoint, limits) = (observation.at_setpoint, observation.limits);
        let confidence = observation.lock.unwrap_or(0.0);
        let locked = confidence >= LOCK_CONFIDENCE;
        if self.settled() && self.state != State::Limiting && !limits.is_empty() {
            self.capture.stop();
            self.enter(State::Limiting);
            return Decision::Stay;
        }
        match self.state {
            // The setpoint on the way is not permitted.
            State::Starting
                if limits.contains(Limits::LINK_LOST) || limits.contains(Limits::NO_SETPOINT) =>
            {
                self.enter(State::Limiting);
                return Decision::ForgetImpacts;
            }
            State::Starting => {
                self.setpoint_cycles = consecutive(self.setpoint_cycles, at_setpoint);
                if self.setpoint_cycles >= SETPOINT_CYCLES || limits.contains(Limits::OUTPUT) {
                    if limits.is_empty() {
                        self.enter(State::Holding);
                        events.push(Event::SetpointReached);
                    } else {
                        self.enter(State::Limiting);
                    }
                    return Decision::ForgetImpacts;
                }
            }
            State::Limiting if limits.is_empty() => {
                self.setpoint_cycles = 0;
                self.enter(State::Starting);
            }
            State::Holding if self.detects_chaos() => {
                return self.continue_glide(observation, events);
            }
            State::Holding | State::Lost if observation.lock.is_some() => {
                let may_capture = self.state == State::Lost || !self.given_up;
                if locked {
                    self.enter(State::Locked);
                    events.push(Event::Locked);
                } else if self.in_state >= CAPTURE_DELAY_CYCLES && may_capture {
                    self.capture.begin();
                    self.enter(State::Capturing);
                }
            }
            State::Capturing => {
                let event = (self.capture).cycle(observation.plan, confidence, at_setpoint);
                event.into_iter().for_each(|event| events.push(event));
                match event {
                    Some(Event::KickBegun) => return Decision::ForgetImpacts,
                    Some(Event::Locked) => self.enter(State::Locked),
                    Some(Event::NotCaptured) => {
                        self.given_up = true;
                        self.enter(State::Holding);
                    }
                    _ => {}
                }
            }
            State::Locked => {
                let doubted = confidence < LOST_CONFIDENCE;
                self.doubt_cycles = consecutive(self.doubt_cycles, doubted);
                if self.doubt_cycles >= LOST_CYCLES {
                    self.doubt_cycles = 0;
                    self.enter(State::Lost);
                    events.push(Event::LockLost);
                } else if self.glide == Glide::Lock && self.in_state >= LOCK_CYCLES_BEFORE_GLIDE {
                    return self.leave_lock(observation.chaos, events);
                }
            }
            _ => {}
        }
        Decision::Stay
    }

    fn leave_lock(&mut self, chaos: Option<Option<f64>>, events: &mut Events) -> Decision {
        match chaos {
            None => Decision::Stay,
            Some(Some(k)) => {
                self.glide = Glide::Gliding;
                self.enter(State::Holding);
                Decision::GoToChaos(k)
            }
            Some(None) => {
                self.glide = Glide::None;
                events.push(Event::NoSetpoint);
                Decision::NoChaos
            }
        }
    }

    /// Returns to the amplitude of the lock, from which chaos is reached.
    fn back_to_lock(&mut self) -> Decision {
        if !self.detects_chaos() {
            return Decision::Stay;
        }
        self.glide = Glide::Lock;
        Decision::GoToLock
    }

    /// During the glide and in chaos: tests whether the parts are chaotic.
    fn continue_glide(&mut self, observation: &Observation<'_>, events: &mut Events) -> Decision {
        match self.glide {
            Glide::Gliding if observation.at_setpoint => {
                self.glide = Glide::Arrived { detected: false };
                return Decision::ForgetImpacts;
            }
            Glide::Arrived { detected } => {
                let sure =
                    (observation.regime).filter(|verdict| verdict.confidence >= REGIME_CONFIDENCE);
                match sure.map(|verdict| verdict.regime) {
                    Some(Regime::Chaotic) if !detected => {
                        self.glide = Glide::Arrived { detected: true };
                        events.push(Event::Chaotic);
                    }
                    Some(Regime::Rest | Regime::HopAndRest { .. }) => {
                        return self.restart_chaos(events);
                    }
                    _ => {}
                }
            }
            _ => {}
        }
        Decision::Stay
    }

    /// The parts fell out of chaos to rest. The sequence restarts, as often as kicks are permitted.
    fn restart_chaos(&mut self, events: &mut Events) -> Decision {
        self.falls = self.falls.saturating_add(1);
        let decision = self.back_to_lock();
        if f32::from(self.falls) > self.max_falls {
            self.given_up = true;
            self.glide = Glide::None;
            self.enter(State::Holding);
            events.push(Event::NotCaptured);
        } else {
            self.setpoint_cycles = 0;
            self.enter(State::Starting);
            events.push(Event::LockLost);
        }
        decision
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inputs::StartCause;
    use crate::testing::seeded;
    use proptest::collection::vec;
    use proptest::prelude::*;

    const PACE: f32 = 50.0;

    /// The state after a number of cycles with these inputs.
    fn after(machine: &mut StateMachine, cycles: u32, inputs: &Inputs) -> State {
        for _ in 0..cycles {
            machine.count();
            let events = &mut Events::default();
            machine.follow_enable_input(inputs, Clearance::Granted, (true, 0.0), events);
        }
        machine.state
    }

    type Cause = fn(&mut Inputs) -> &mut bool;

    /// Faults with a lasting cause, and the input that shows it.
    const CAUSES: [(Fault, Cause); 5] = [
        (Fault::OverTemperature, |it| &mut it.over_temperature),
        (Fault::StackLow, |it| &mut it.stack_low),
        (Fault::OverCurrent, |it| &mut it.over_current),
        (Fault::SupplyLow, |it| &mut it.supply_low),
        (Fault::ClockFailed, |it| &mut it.clock_failed),
    ];

    proptest! {
        #![proptest_config(seeded())]
        /// The input must be off for half a second, or for a minute after the third fault in one.
        #[test]
        fn a_fault_stays_until_the_input_is_withdrawn(
            steps in vec(
                (0..4_u8, prop_oneof![4 => 0..60_u32, 1 => 2900..3100_u32], 0..12_usize),
                40,
            ),
            power_on: bool,
        ) {
            let start = if power_on { StartCause::PowerOn } else { StartCause::Ordinary };
            let interlock = Interlock::begin(start, PACE);
            let mut machine = StateMachine::begin(interlock, PACE, 8.0);
            let mut events = Events::default();
            // Cycles, those for which the input is off, the cycles of the faults, the least off.
            let (mut now, mut off, mut faults, mut min_off_cycles) = (0, 0, std::vec![], 0);
            let mut released = !power_on;
            for (flags, cycles, what) in steps {
                let fault = CAUSES.get(what).map_or(Fault::SensorLost, |(fault, _)| *fault);
                let free = machine.interlock.fault.is_none();
                if what < 7 {
                    machine.fail(fault, &mut events);
                }
                if what < 7 && free {
                    faults.push(now);
                    let third = faults.iter().rev().nth(2);
                    min_off_cycles = if third.is_some_and(|then| now - then < 3000) { 3000 } else { 25 };
                    (off, released) = (0, true);
                }
                let mut inputs = Inputs { enable: flags & 1 == 1, ..Inputs::default() };
                let cause = CAUSES.iter().find(|(fault, _)| machine.interlock.fault == Some(*fault));
                let lasts = flags & 2 == 2 && cause.is_some();
                if let Some((_, cause)) = cause {
                    *cause(&mut inputs) = lasts;
                }
                for _ in 0..cycles {
                    now += 1;
                    off = if inputs.enable { 0 } else { off + 1 };
                    released |= !inputs.enable;
                    let (fault, running) = (machine.interlock.fault, machine.running());
                    let state = after(&mut machine, 1, &inputs);
                    if fault.is_some() {
                        let is_locked_out = off < min_off_cycles || lasts;
                        prop_assert_eq!(machine.interlock.fault, fault.filter(|_| is_locked_out));
                        prop_assert_eq!(state, if is_locked_out { State::Fault } else { State::Off });
                    } else if !running {
                        let starts = inputs.enable && released;
                        prop_assert_eq!(state == State::Starting, starts);
                    }
                }
            }
        }
    }
}
