//! Plant and disturbances of a scene, without a controller.

use super::plant::Plant;
use crate::model::scene::{Change, Scene};
use crate::model::timeline::Timeline;
use kband::feeder::OutOfRange;
use kband_control::{AdcCode, Inputs, SAMPLE_RATE, Target};

/// The plant of a scene with its disturbances, for any controller.
///
/// Each sample is [`Bench::sample`], then [`Bench::hold`] with the drive's output. At the end of a
/// cycle the controller reads [`Bench::inputs`] and [`Bench::new_target`].
#[derive(Clone, Debug)]
pub struct Bench {
    plant: Plant,
    timeline: Timeline,
    samples: u64,
}

impl Bench {
    /// The bench of a scene at time 0: parts at rest, drive off, enable input on.
    pub fn build(scene: &Scene) -> Result<Self, OutOfRange> {
        Ok(Self {
            plant: Plant::build(scene)?,
            timeline: Timeline::new(scene),
            samples: 0,
        })
    }

    /// Converter reading of the next sample, after the disturbances due before it.
    #[inline]
    pub fn sample(&mut self) -> AdcCode {
        while let Some(change) = self.timeline.due(self.samples) {
            self.apply(change);
        }
        self.samples += 1;
        self.plant.sample()
    }

    /// Reading of the current sensor at that sample.
    pub fn current(&self) -> AdcCode {
        self.plant.current()
    }

    /// Holds an output (-1..1) until the next sample; `step` is the advance of the drive's phase.
    #[inline]
    pub fn hold(&mut self, output: f32, step: u32) {
        self.plant.hold(output, step);
    }

    /// Present inputs of the board.
    pub fn inputs(&self) -> Inputs {
        self.timeline.inputs()
    }

    /// New target of the scene, returned once.
    pub fn new_target(&mut self) -> Option<Target> {
        self.timeline.new_target()
    }

    /// Whether the board's supply sagged in this cycle, returned once; controller and cycle must
    /// restart.
    pub fn sagged(&mut self) -> bool {
        self.timeline.sagged()
    }

    /// Clears the stored impacts ([`Plant::strikes`]).
    pub fn forget_strikes(&mut self) {
        self.plant.forget_strikes();
    }

    /// The plant.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Time since the start in s.
    pub fn time(&self) -> f64 {
        self.samples as f64 / f64::from(SAMPLE_RATE)
    }

    /// Applies a change beside those of the scene.
    pub fn apply(&mut self, change: Change) {
        if let Some(change) = self.timeline.take(change) {
            self.plant.apply(change);
        }
    }
}
