//! The plant and what happens to it in time: everything of a scene but the controller.

use super::feeder::Plant;
use super::scene::{Change, Scene};
use crate::control::{AdcCode, Inputs, SAMPLE_RATE, Target};
use crate::feeder::OutOfRange;

/// The plant of a scene with the scene's disturbances, for any controller to be tried on.
///
/// Each sample is [`Bench::sample`], then [`Bench::hold`] with what the drive was given; where a cycle
/// ends, [`Bench::inputs`] and [`Bench::new_target`] are what the controller is told.
#[derive(Clone, Debug)]
pub struct Bench {
    plant: Plant,
    inputs: Inputs,
    target: Option<Target>,
    scene: Scene,
    disturbance: usize,
    samples: u64,
}

impl Bench {
    /// The bench of a scene at time 0: parts at rest, drive off, enable input given.
    pub fn build(scene: &Scene) -> Result<Self, OutOfRange> {
        Ok(Self {
            plant: Plant::build(scene)?,
            inputs: Inputs {
                enable: true,
                link_heard: true,
                ..Inputs::default()
            },
            target: None,
            scene: *scene,
            disturbance: 0,
            samples: 0,
        })
    }

    /// The converter's reading at the next sample, after what is due to happen before it.
    #[inline]
    pub fn sample(&mut self) -> AdcCode {
        while let Some(Some(disturbance)) = self.scene.disturbances.get(self.disturbance) {
            if (f64::from(disturbance.at) * f64::from(SAMPLE_RATE)) as u64 > self.samples {
                break;
            }
            self.apply(disturbance.change);
            self.disturbance += 1;
        }
        self.samples += 1;
        self.plant.sample()
    }

    /// Holds an output (-1..1) until the next sample, `step` being the advance of the drive's phase.
    #[inline]
    pub fn hold(&mut self, output: f32, step: u32) {
        self.plant.hold(output, step);
    }

    /// What the board's inputs say now.
    #[must_use]
    pub fn inputs(&self) -> Inputs {
        self.inputs
    }

    /// A target that the scene sets, once.
    pub fn new_target(&mut self) -> Option<Target> {
        self.target.take()
    }

    /// Forgets the impacts so far ([`Plant::strikes`]).
    pub fn forget_strikes(&mut self) {
        self.plant.forget_strikes();
    }

    /// The plant.
    #[must_use]
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Time since the start in s.
    #[must_use]
    pub fn time(&self) -> f32 {
        self.samples as f32 / SAMPLE_RATE as f32
    }

    /// Makes a change now, beside those of the scene.
    pub fn apply(&mut self, change: Change) {
        match change {
            Change::Enable(enable) => self.inputs.enable = enable,
            Change::Target(target) => self.target = Some(target),
            Change::Gain(gain) => self.plant.set_gain(gain),
            Change::Restitution(restitution) => self.plant.set_restitution(restitution),
            Change::Noise(noise) => self.plant.set_noise(noise),
            Change::SensorLost(lost) => self.plant.set_sensor_lost(lost),
            Change::SensorInverted(inverted) => self.plant.set_sensor_inverted(inverted),
            Change::Sensitivity(sensitivity) => self.plant.set_sensitivity(sensitivity),
            Change::OverTemperature(hot) => self.inputs.over_temperature = hot,
            Change::Link(linked) => self.inputs.link_heard = linked,
            Change::StackLow(low) => self.inputs.stack_low = low,
        }
    }
}
