//! The one closed loop that desk and emulated CPU run: sample, control once a cycle, plan in slices.

use super::feeder::Plant;
use super::scene::{Change, Scene};
use crate::control::{Controller, Inputs, Report, SAMPLE_RATE, Signal, Start};
use crate::feeder::OutOfRange;

/// Slices of planning that a cycle gets: as many as a board has time for.
const PLAN_SLICES: usize = 8;

/// One cycle of the closed loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Time at the end of the cycle in s.
    pub time: f32,
    /// What the controller saw and did.
    pub report: Report,
    /// Impacts of all parts in this cycle.
    pub strikes: u32,
}

/// Controller, signal path and plant, joined.
#[derive(Clone, Debug)]
pub struct ClosedLoop {
    signal: Signal,
    controller: Controller,
    plant: Plant,
    inputs: Inputs,
    linked: bool,
    scene: Scene,
    disturbance: usize,
    samples: u64,
}

impl ClosedLoop {
    /// The loop of a scene at time 0: parts at rest, drive off, enable input given.
    pub fn build(scene: &Scene) -> Result<Self, OutOfRange> {
        Ok(Self {
            signal: Signal::build(&scene.settings)?,
            controller: Controller::build(&scene.settings, scene.target, Start::Ordinary)?,
            plant: Plant::build(scene)?,
            inputs: Inputs {
                enable: true,
                ..Inputs::default()
            },
            linked: true,
            scene: *scene,
            disturbance: 0,
            samples: 0,
        })
    }

    /// Runs to the end of the next drive cycle.
    pub fn cycle(&mut self) -> Moment {
        let struck = self.plant.strikes();
        // The slowest drive has 4000 samples a cycle; the bound only keeps a broken step from hanging.
        for _ in 0..2 * SAMPLE_RATE {
            if self.sample() {
                break;
            }
        }
        self.inputs.link_heard = self.linked;
        let report = self.controller.cycle(self.signal.cycle(), &self.inputs);
        self.signal.command(report.command);
        for _ in 0..PLAN_SLICES {
            if !self.controller.plan_step() {
                break;
            }
        }
        Moment {
            time: self.samples as f32 / SAMPLE_RATE as f32,
            report,
            strikes: self.plant.strikes().wrapping_sub(struck),
        }
    }

    fn sample(&mut self) -> bool {
        while let Some(Some(disturbance)) = self.scene.disturbances.get(self.disturbance) {
            if (f64::from(disturbance.at) * f64::from(SAMPLE_RATE)) as u64 > self.samples {
                break;
            }
            self.apply(disturbance.change);
            self.disturbance += 1;
        }
        self.samples += 1;
        let code = self.plant.sample();
        let before = self.signal.phase();
        let sampled = self.signal.sample(code);
        let step = (self.signal.phase() - before).bits();
        self.plant.hold(sampled.output, step);
        sampled.wrapped
    }

    fn apply(&mut self, change: Change) {
        match change {
            Change::Enable(enable) => self.inputs.enable = enable,
            Change::Target(target) => {
                // A target out of range is refused, as over the link; the old one stays.
                let _ = self.controller.set_target(target);
            }
            Change::Gain(gain) => self.plant.set_gain(gain),
            Change::Restitution(restitution) => self.plant.set_restitution(restitution),
            Change::Noise(noise) => self.plant.set_noise(noise),
            Change::SensorLost(lost) => self.plant.set_sensor_lost(lost),
            Change::SensorInverted(inverted) => self.plant.set_sensor_inverted(inverted),
            Change::Sensitivity(sensitivity) => self.plant.set_sensitivity(sensitivity),
            Change::OverTemperature(hot) => self.inputs.over_temperature = hot,
            Change::Link(linked) => self.linked = linked,
            Change::StackLow(low) => self.inputs.stack_low = low,
        }
    }

    /// The controller.
    #[must_use]
    pub fn controller(&self) -> &Controller {
        &self.controller
    }

    /// The plant.
    #[must_use]
    pub fn plant(&self) -> &Plant {
        &self.plant
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{State, Target};

    #[test]
    fn the_default_plant_reaches_k_without_overshoot() {
        let mut closed = ClosedLoop::build(&Scene {
            target: Target::K(0.41),
            ..Scene::default()
        })
        .unwrap();
        let mut lowest = f32::INFINITY;
        let mut settled = None;
        for _ in 0..100 {
            let moment = closed.cycle();
            lowest = lowest.min(moment.report.k);
            if moment.report.state == State::Holding && settled.is_none() {
                settled = Some(moment.time);
            }
        }
        assert!(lowest > 0.41 * 0.95, "{lowest}");
        assert!(settled.unwrap() < 1.0);
    }
}
