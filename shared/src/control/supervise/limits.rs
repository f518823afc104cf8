//! The limit monitor: what holds the drive back, and since when.

use crate::control::state::Limits;

/// Cycles that the output may stand at its limit: short stays there belong to every start and kick, whose default
/// time constant is a fifth of this. Tuned: with 10 and with 60 the scene `output_limit` fails.
const SATURATION: u32 = 25;

/// What the limits depend on in a cycle.
#[derive(Clone, Copy, Debug)]
pub struct LimitInputs {
    /// Whether the drive runs.
    pub running: bool,
    /// Whether the link brought a valid frame.
    pub link_heard: bool,
    /// Cycles for which the link may be silent, where its silence counts.
    pub link_timeout: Option<f32>,
    /// Whether there is no setpoint.
    pub no_setpoint: bool,
    /// Whether the setpoint is beyond a hard limit.
    pub cut: bool,
    /// That hard limit.
    pub ceiling_limit: Limits,
    /// Whether the output stands at its limit.
    pub saturated: bool,
    /// Whether nothing is heard where parts must be heard.
    pub deaf: bool,
    /// Whether less is made of a tone above the first than is wanted.
    pub tones: bool,
}

/// The limits that hold the drive back, and how long their causes have lasted.
#[derive(Clone, Copy, Debug, Default)]
pub struct LimitMonitor {
    limits: Limits,
    /// Cycles that the output has stood at its limit.
    saturated_for: u32,
    link_silence: u32,
    link_known: bool,
}

impl LimitMonitor {
    /// What holds the drive back.
    pub fn limits(&self) -> Limits {
        self.limits
    }

    /// Takes a cycle.
    pub fn cycle(&mut self, inputs: &LimitInputs) {
        if inputs.link_heard {
            self.link_known = true;
            self.link_silence = 0;
        } else {
            self.link_silence = self.link_silence.saturating_add(1);
        }
        let lost = self.link_known
            && (inputs.link_timeout).is_some_and(|timeout| self.link_silence as f32 > timeout);
        self.saturated_for = if inputs.saturated {
            self.saturated_for.saturating_add(1)
        } else {
            0
        };
        let running = inputs.running;
        self.limits.set(Limits::LINK_LOST, running && lost);
        self.limits
            .set(Limits::NO_SETPOINT, running && inputs.no_setpoint);
        self.limits.set(inputs.ceiling_limit, running && inputs.cut);
        self.limits.set(Limits::DEAF, running && inputs.deaf);
        self.limits
            .set(Limits::SECOND_TONE, running && inputs.tones);
        self.limits
            .set(Limits::OUTPUT, running && self.saturated_for > SATURATION);
    }

    /// The drive is off: nothing holds it back.
    pub fn rest(&mut self) {
        self.saturated_for = 0;
        self.limits = Limits::default();
    }
}
