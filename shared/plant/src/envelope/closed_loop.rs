//! Closed loop in steps of a drive cycle: the controller with the envelope plant.

use super::plant::EnvelopePlant;
use crate::model::Moment;
use crate::model::part::Strike;
use crate::model::scene::{Change, Scene};
use kband::feeder::OutOfRange;
use kband_control::{Command, Controller, Cycle, PLAN_SLICES, StartCause, Target, phase_step};

/// Controller and envelope plant. A command at the end of a cycle acts in the cycle after next.
#[derive(Clone, Debug)]
pub struct EnvelopeLoop {
    controller: Controller,
    plant: EnvelopePlant,
    /// Command of the next cycle, and the latched command of the cycle after it.
    running: Command,
    pending: Command,
    /// Target at the start of the board.
    target: Target,
    watched: bool,
}

impl EnvelopeLoop {
    /// The loop of a scene at time 0: parts at rest, drive off, enable input on.
    pub fn build(scene: &Scene) -> Result<Self, OutOfRange> {
        let still = still(scene.settings.frequency);
        Ok(Self {
            controller: Controller::build(&scene.settings, scene.target, scene.start)?,
            plant: EnvelopePlant::build(scene)?,
            running: still,
            pending: still,
            target: scene.target,
            watched: true,
        })
    }

    /// Simulates the next drive cycle.
    pub fn cycle(&mut self) -> Moment {
        self.advance();
        self.moment()
    }

    /// The last cycle.
    pub fn moment(&self) -> Moment {
        Moment {
            time: self.plant.seconds(),
            report: self.controller.report(),
            strikes: self.plant.strikes.len() as u32,
            displacement: self.plant.displacement(),
            load: self.plant.load(),
        }
    }

    /// As [`EnvelopeLoop::cycle`], without a [moment](EnvelopeLoop::moment).
    pub fn advance(&mut self) {
        self.advance_supplied(|_| {});
    }

    /// As [`EnvelopeLoop::advance`]; `share` can supply stored results for the searches begun here.
    pub fn advance_supplied(&mut self, share: impl FnOnce(&mut Controller)) {
        let mut cycle = self.run();
        if self.plant.timeline.sagged() {
            self.restart();
            cycle = self.run();
        }
        if let Some(target) = self.plant.timeline.new_target() {
            // A target out of range is rejected as over the link, and the old one remains.
            let _ = self.controller.set_target(target);
        }
        self.controller.advance(&cycle, &self.plant.timeline.inputs);
        self.running = self.pending;
        self.pending = self.controller.command();
        if self.pending.immediate {
            self.running.amplitude = self.pending.amplitude;
            self.running.lead = self.pending.lead;
            self.running.overtones = self.pending.overtones;
        }
        share(&mut self.controller);
        (0..PLAN_SLICES).all(|_| self.controller.plan_step());
    }

    fn run(&mut self) -> Cycle {
        let [before, samples] = self.plant.samples();
        // A change in the first half of a cycle affects the whole cycle.
        self.happen(before + samples / 2);
        let cycle = self.plant.cycle(&self.running, &self.pending);
        self.happen(self.plant.samples()[0] - 1);
        cycle
    }

    fn restart(&mut self) {
        let settings = *self.controller.settings();
        // Settings accepted once are accepted again.
        if let Ok(controller) = Controller::build(&settings, self.target, StartCause::Reset) {
            self.controller = controller;
            self.controller.watch_regime(self.watched);
        }
        self.running = still(settings.frequency);
        self.pending = self.running;
    }

    fn happen(&mut self, sample: u64) {
        while let Some(change) = self.plant.timeline.due(sample) {
            self.apply(change);
        }
    }

    /// Applies a change beside those of the scene; a target takes effect at the end of the cycle.
    pub fn apply(&mut self, change: Change) {
        self.plant.apply(change);
    }

    /// Sets whether outputs without effect on the loop are computed: displacement along the track,
    /// and the regime if the controller does not use it. Else they stay constant.
    pub fn watch(&mut self, watched: bool) {
        self.watched = watched;
        self.plant.watched = watched;
        self.controller.watch_regime(watched);
    }

    /// Sets whether the displacement along the track is computed.
    pub fn watch_displacement(&mut self, watched: bool) {
        self.plant.watched = watched;
    }

    /// Sets whether READY is detected, as [`Controller::watch_ready`] does.
    pub fn watch_ready(&mut self, watched: bool) {
        self.controller.watch_ready(watched);
    }

    /// The controller.
    pub fn controller(&self) -> &Controller {
        &self.controller
    }

    /// Impacts of the last cycle.
    pub fn strikes(&self) -> &[Strike] {
        &self.plant.strikes
    }

    /// True normal amplitude of the track (symbol b) at the end of the last cycle, in m.
    pub fn amplitude(&self) -> f64 {
        self.plant.amplitude()
    }

    /// Time since the start in s.
    pub fn seconds(&self) -> f64 {
        self.plant.seconds()
    }
}

fn still(frequency: f32) -> Command {
    Command {
        step: phase_step(frequency),
        ..Command::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::scene::Disturbance;

    #[test]
    fn change_at_the_first_sample_of_a_cycle_is_seen_in_that_cycle() {
        let mut scene = Scene::default();
        let mut board = EnvelopeLoop::build(&scene).unwrap();
        board.cycle();
        let at = (board.plant.samples()[0] as f64 + 0.5) / 20_000.0;
        let change = Change::Enable(false);
        scene.disturbances.extend([Disturbance { at, change }]);
        board = EnvelopeLoop::build(&scene).unwrap();
        for enabled in [true, false] {
            board.cycle();
            assert_eq!(board.plant.timeline.inputs.enable, enabled);
        }
    }
}
