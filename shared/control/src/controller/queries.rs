//! Queries of a controller: its report, its readiness, its estimates.

use super::Controller;
use crate::angle::radians_of;
use crate::drive::absolute;
use crate::{
    Command, Events, GearShare, Identification, Interlock, Limits, Load, NoSetpoint, Report,
    Settings, State, Target, phase_of,
};

impl Controller {
    /// Report of the last cycle.
    pub fn report(&self) -> Report {
        let (measured, phases) = (&self.measured, &self.listener.phases);
        let margin = self.listener.margin().or(self.listener.share.margin);
        let plan = self.selection.plan;
        Report {
            cycle: self.count,
            k: self.k(measured.amplitude),
            amplitude: measured.amplitude,
            lead: radians_of(measured.lead),
            shape: measured.shape,
            reference: self.reference.value,
            setpoint: self.setpoint(),
            rate: phases.rate(),
            phase: phases.phase(),
            concentration: phases.concentration(),
            confidence: self.confidence(),
            in_gear: self.in_gear(),
            in_gear_error: self.in_gear_error(),
            gear: self.order().unwrap_or(1),
            to_loss: self.listener.time_to_loss(),
            margin: margin.filter(|_| !self.is_estimate_invalid()),
            expected_in_gear: plan.map_or(0.0, |plan| plan.share),
            target_band: self.selection.target_band(),
            load: self.load(),
            attempts: self.machine.capture.attempts,
            identification: self.identifier.result,
            regime: self.listener.regime,
            frequency: self.resonance.frequency,
            state: self.machine.state,
            fault: self.machine.interlock.fault,
            limits: self.limits.limits,
            events: measured.events,
            command: self.command(),
        }
    }

    /// The next command.
    pub fn command(&self) -> Command {
        Command {
            amplitude: self.output,
            lead: phase_of(self.output_lead),
            overtones: self.tones.output(),
            step: self.scale.step,
            immediate: !self.machine.running() || self.amplitude.is_immediate(),
            average_from: self.identifier.average_from(),
            whole: self.identifier.is_running(),
        }
    }

    /// Whether the target is met (lock, chaos, half of the time in gear, amplitude) and steady.
    pub fn is_ready(&self) -> bool {
        let is_target_met = match (self.machine.state, self.selection.target) {
            (State::Holding, Target::K(_) | Target::Tones { .. } | Target::Amplitude(_)) => true,
            (State::Holding, Target::Gear { .. } | Target::Flow(_)) => {
                self.listener.in_gear_detected
            }
            (State::Holding, Target::Chaotic) => self.machine.in_chaos(),
            (State::Locked, target) => target != Target::Chaotic,
            _ => false,
        };
        self.faults.is_steady() && is_target_met
    }

    /// State of the controller.
    pub fn state(&self) -> State {
        self.machine.state
    }

    /// The causes that keep the drive off, for [`Controller::resume`].
    pub fn interlock(&self) -> &Interlock {
        &self.machine.interlock
    }

    /// Events of the last cycle.
    pub fn events(&self) -> Events {
        self.measured.events
    }

    /// Predicted normal amplitude of the track under the outputs so far, in m.
    pub fn expected(&self) -> f32 {
        0.5 * self.scale.full_amplitude
            * absolute(self.predicted_envelopes[1] + self.predicted_envelopes[2])
    }

    /// Estimated share of the parts' time in gear ([`Report::in_gear`]), 0..=1.
    pub fn in_gear(&self) -> f32 {
        if self.is_estimate_invalid() {
            return 0.0;
        }
        self.listener.in_gear_at_least()
    }

    /// Whether impacts would not be detected. Then nothing is reported of the parts.
    fn misses_impacts(&self) -> bool {
        self.limits.limits.contains(Limits::DEAF)
    }

    /// Whether no share is reported: impacts are missed, or the lot is wrong or being identified.
    fn is_estimate_invalid(&self) -> bool {
        self.misses_impacts() || self.selection.misfit || self.identifier.is_running()
    }

    /// The estimated share, also while [`Limits::DEAF`] hides it in the report.
    pub fn estimated_share(&self) -> Option<GearShare> {
        self.listener.in_gear()
    }

    /// Standard error of the share; infinite for a lower bound ([`Report::in_gear_error`]).
    pub fn in_gear_error(&self) -> f32 {
        let share = (self.estimated_share()).filter(|_| !self.is_estimate_invalid());
        share.map_or(f32::INFINITY, |estimate| estimate.error)
    }

    /// Estimated load of the parts on the track ([`Report::load`]).
    pub fn load(&self) -> Option<Load> {
        let weighs = !self.misses_impacts() && !self.listener.empty;
        self.meter.as_ref().filter(|_| weighs)?.load
    }

    /// Normal amplitude of the track (symbol b) measured in the last cycle, in m.
    pub fn amplitude(&self) -> f32 {
        self.measured.amplitude
    }

    /// Reference amplitude at the end of the cycle after next, in m.
    pub fn reference(&self) -> f32 {
        self.reference.value
    }

    /// The settings in use.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The target.
    pub fn target(&self) -> Target {
        self.selection.target
    }

    /// Order of the requested gear or lock, also of a lock on the way to chaos or for a speed.
    pub fn order(&self) -> Option<u8> {
        (self.selection.gear_order()).or_else(|| self.selection.lock().map(|lock| lock.order))
    }

    /// Amplitude of the target's setpoint in m, before any limit; 0 if there is none.
    pub fn setpoint(&self) -> f32 {
        self.selection.setpoint(&self.scale)
    }

    /// Whether the search for the setpoint is over, with or without a result.
    pub fn is_setpoint_found(&self) -> bool {
        self.selection.chosen()
    }

    /// The reason for having no setpoint, and a remedy.
    pub fn no_setpoint(&self) -> Option<NoSetpoint> {
        self.selection.no_setpoint()
    }

    /// Largest amplitude in m that the settings allow the drive.
    pub fn reach(&self) -> f32 {
        self.scale.reach(&self.settings)
    }

    /// k at a normal amplitude in m.
    pub fn k(&self, amplitude: f32) -> f32 {
        self.scale.k(amplitude)
    }

    /// Progress of the identification ([`Target::Identify`]). Its result stays until the next one.
    pub fn identification(&self) -> Identification {
        self.identifier.result
    }

    /// Sets whether gear is detected for [`Controller::is_ready`]. Default: yes.
    pub fn watch_ready(&mut self, watched: bool) {
        self.watches_ready = watched;
    }

    /// Sets whether the regime is classified even if no decision needs it. Default: yes.
    pub fn watch_regime(&mut self, watched: bool) {
        self.listener.always_classifies = watched;
    }
}
