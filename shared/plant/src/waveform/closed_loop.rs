//! Closed loop of the waveform plant: sampling, control once a cycle, planning in slices.

use super::bench::Bench;
use crate::model::Moment;
use crate::model::scene::{Change, Scene};
use kband::feeder::OutOfRange;
use kband_control::{
    BusCommand, Controller, PLAN_SLICES, SAMPLE_RATE, Settings, Signal, StartCause, Target,
};

/// One sample of the closed loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time in s.
    pub time: f64,
    /// Output of the drive over full output, -1..1, held since the sample before.
    pub output: f32,
    /// Reading of the converter.
    pub code: u16,
    /// Displacement of the track in m.
    pub displacement: f32,
    /// Velocity of the track in m/s.
    pub velocity: f32,
}

/// Controller, signal path and plant, joined.
///
/// ```
/// use kband_control::State;
/// use kband_plant::{ClosedLoop, Scene};
/// let mut closed = ClosedLoop::build(&Scene::default())?;
/// let locked = (0..250).any(|_| closed.cycle().report.state == State::Locked);
/// assert!(locked, "within five seconds");
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct ClosedLoop {
    signal: Signal,
    controller: Controller,
    bench: Bench,
    /// Target at the start of the board.
    target: Target,
    /// Commands of a fieldbus in the next cycle, and whether a request arrived.
    bus: Option<(BusCommand, bool)>,
}

impl ClosedLoop {
    /// The loop of a scene at time 0: parts at rest, drive off, enable input on.
    pub fn build(scene: &Scene) -> Result<Self, OutOfRange> {
        Ok(Self {
            signal: Signal::build(&scene.settings)?,
            controller: Controller::build(&scene.settings, scene.target, scene.start)?,
            bench: Bench::build(scene)?,
            target: scene.target,
            bus: None,
        })
    }

    /// Simulates the next drive cycle.
    pub fn cycle(&mut self) -> Moment {
        self.trace_cycle(|_| ())
    }

    /// As [`ClosedLoop::cycle`]; passes each sample to a callback.
    #[inline]
    pub fn trace_cycle(&mut self, mut observe: impl FnMut(Sample)) -> Moment {
        self.bench.forget_strikes();
        self.samples(&mut observe);
        if self.bench.sagged() {
            self.restart();
            self.samples(&mut observe);
        }
        if let Some(target) = self.bench.new_target() {
            let _ = self.controller.set_target(target);
        }
        let mut inputs = self.bench.inputs();
        if let Some((command, request_received)) = self.bus.take() {
            (inputs.bus, inputs.link_heard) = (Some(command), request_received);
        }
        let report = self.controller.cycle(self.signal.cycle(), &inputs);
        self.signal.command(report.command);
        (0..PLAN_SLICES).all(|_| self.controller.plan_step());
        self.bench.moment(report)
    }

    #[inline]
    fn samples(&mut self, observe: &mut impl FnMut(Sample)) {
        // The longest cycle has 4000 samples; the bound ends a loop with a wrong step.
        for _ in 0..2 * SAMPLE_RATE {
            let code = self.bench.sample();
            let before = self.signal.phase();
            let sampled = self.signal.sample_with(code, || self.bench.current());
            let step = (self.signal.phase() - before).bits();
            self.bench.hold(sampled.output, step);
            let [displacement, velocity] = self.bench.motion();
            observe(Sample {
                time: self.bench.time(),
                output: sampled.output,
                code: code.0,
                displacement,
                velocity,
            });
            if sampled.wrapped {
                break;
            }
        }
    }

    fn restart(&mut self) {
        let settings = *self.controller.settings();
        if let Ok(signal) = Signal::build(&settings)
            && let Ok(controller) = Controller::build(&settings, self.target, StartCause::Reset)
        {
            (self.signal, self.controller) = (signal, controller);
        }
    }

    /// Sets a fieldbus's commands for the next cycle, and whether a request arrived since the last.
    pub fn command(&mut self, command: BusCommand, request_received: bool) {
        self.bus = Some((command, request_received));
    }

    /// Sets new settings, as on a board at rest. After an error the old settings stay.
    pub fn configure(&mut self, settings: &Settings) -> Result<(), OutOfRange> {
        let signal = Signal::build(settings)?;
        let (target, interlock) = (self.controller.target(), self.controller.interlock());
        self.controller = Controller::resume(settings, target, interlock)?;
        self.signal = signal;
        Ok(())
    }

    /// The controller, for setting stored plans.
    pub fn controller_mut(&mut self) -> &mut Controller {
        &mut self.controller
    }

    /// Applies a change beside those of the scene; a target takes effect at the end of the cycle.
    pub fn apply(&mut self, change: Change) {
        self.bench.apply(change);
    }

    /// The controller.
    pub fn controller(&self) -> &Controller {
        &self.controller
    }

    /// The plant.
    pub fn plant(&self) -> &Bench {
        &self.bench
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::EnvelopeLoop;
    use kband_control::State;

    /// Without blanking, 24 parts add 4.7 % of amplitude at 800 Hz, 1.5 % at 2.4 kHz.
    #[test]
    fn ringing_of_many_parts_adds_no_amplitude() {
        for (frequency, count) in [(800.0, 1), (800.0, 6), (800.0, 24), (2400.0, 24)] {
            let mut scene = Scene::default();
            scene.sensor.ringing_frequency = frequency;
            let restitution = |n| 0.18 + 0.04 * (n as f32 % 24.0) / 23.0;
            scene.parts = (0..count).map(restitution).collect();
            let mut closed = ClosedLoop::build(&scene).unwrap();
            let mut envelope = EnvelopeLoop::build(&scene).unwrap();
            for _ in 0..500 {
                closed.cycle();
                envelope.advance();
            }
            assert_eq!(closed.controller().state(), State::Locked);
            let (mut measured, mut moved, mut outputs) = (0.0, 0.0, [0.0; 2]);
            for _ in 0..100 {
                let report = closed.cycle().report;
                let [x, v] = closed.plant().motion();
                moved += libm::hypotf(x, v / (core::f32::consts::TAU * 50.0));
                measured += report.amplitude;
                outputs[0] += report.command.amplitude;
                outputs[1] += envelope.cycle().report.command.amplitude;
            }
            // Bias from late detections and from a short memory.
            let bias = measured / moved - 1.0;
            assert!(bias.abs() < 4e-3, "{count} parts, {frequency} Hz: {bias}");
            let error = outputs[1] / outputs[0] - 1.0;
            assert!(error.abs() < 5e-3, "{count} parts, {frequency} Hz: {error}");
        }
    }
}
