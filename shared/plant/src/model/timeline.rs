//! Disturbances of a scene over time: the resulting inputs of the board, drive and sensor.

use super::scene::{Change, Disturbances, Scene, SensorModel};
use kband_control::{Inputs, SAMPLE_RATE, Target};

#[derive(Clone, Debug, Default)]
pub struct Timeline {
    /// Present inputs of the board.
    pub inputs: Inputs,
    /// Gain of the drive over its initial gain, and ripple of its bus over the mean.
    pub gain: f32,
    pub ripple: f32,
    /// The accelerometer, and whether its reading is stuck or inverted.
    pub sensor: SensorModel,
    pub lost: bool,
    pub inverted: bool,
    target: Option<Target>,
    sagged: bool,
    disturbances: Disturbances,
    next: usize,
    /// Sample before which the next disturbance happens.
    due: u64,
}

impl Timeline {
    /// Timeline of a scene at time 0: enable input on, link active.
    pub fn new(scene: &Scene) -> Self {
        let mut timeline = Self {
            inputs: Inputs {
                enable: true,
                link_heard: true,
                ..Inputs::default()
            },
            gain: 1.0,
            ripple: scene.drive.ripple,
            sensor: scene.effective_sensor(),
            disturbances: scene.disturbances.clone(),
            ..Self::default()
        };
        timeline.find_due();
        timeline
    }

    fn find_due(&mut self) {
        let next = self.disturbances.get(self.next);
        self.due = next.map_or(u64::MAX, |next| (next.at * f64::from(SAMPLE_RATE)) as u64);
    }

    /// Next change due before sample `sample`, counted from 0; call until `None`.
    #[inline]
    pub fn due(&mut self, sample: u64) -> Option<Change> {
        if self.due > sample {
            return None;
        }
        let change = self.disturbances.get(self.next)?.change;
        self.next += 1;
        self.find_due();
        Some(change)
    }

    /// Applies a change of an input, target, drive or sensor; returns a change of the parts.
    pub fn take(&mut self, change: Change) -> Option<Change> {
        match change {
            Change::Enable(enable) => self.inputs.enable = enable,
            Change::Target(target) => self.target = Some(target),
            Change::OverTemperature(hot) => self.inputs.over_temperature = hot,
            Change::Link(linked) => self.inputs.link_heard = linked,
            Change::StackLow(low) => self.inputs.stack_low = low,
            Change::OverCurrent(open) => self.inputs.over_current = open,
            Change::SupplyLow(low) => self.inputs.supply_low = low,
            Change::ClockFailed(failed) => self.inputs.clock_failed = failed,
            Change::ControlLate(late) => self.inputs.control_late = late,
            Change::BrownOut(sagged) => self.sagged |= sagged,
            Change::Gain(gain) => self.gain = gain,
            Change::Noise(noise) => self.sensor.noise = noise,
            Change::SensorLost(lost) => self.lost = lost,
            Change::SensorInverted(inverted) => self.inverted = inverted,
            Change::Sensitivity(sensitivity) => self.sensor.sensitivity = sensitivity,
            Change::Ripple(ripple) => self.ripple = ripple,
            Change::Hum(hum) => self.sensor.hum = hum,
            change => return Some(change),
        }
        None
    }

    /// New target of the scene, returned once.
    pub fn new_target(&mut self) -> Option<Target> {
        self.target.take()
    }

    /// Whether the board's supply sagged, returned once.
    pub fn sagged(&mut self) -> bool {
        core::mem::take(&mut self.sagged)
    }
}
