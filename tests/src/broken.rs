//! Scenes with a fault injected into the controller: into its configuration, inputs or outputs.
//!
//! The product contains no fault injection. This module rebuilds the loop of
//! [`kband_plant::ClosedLoop`] from its public parts, with one fault between two of them.

use kband_control::{
    Controller, Cycle, PLAN_SLICES, Report, SAMPLE_RATE, Signal, StartCause, State, Target,
};
use kband_plant::{Bench, Moment, Scene};
use kband_scene::{Outcome, Plans, SceneFile, Watch};

/// The injected fault.
#[derive(Clone, Copy, Debug)]
pub enum Break {
    /// No fault.
    Nothing,
    /// This change of state never happens: the controller keeps its previous state.
    Never(State, State),
    /// The controller measures a feeder to which nothing happens; the driven feeder changes as in
    /// the scene.
    Hidden,
    /// The controller's configuration differs from the scene.
    Misconfigured(fn(&mut Scene)),
    /// The measured cycle is falsified.
    Measured(fn(&mut Cycle)),
    /// The controller's output to the drive is falsified.
    Commanded(fn(&mut Report)),
    /// After a brown-out the controller starts with this start cause.
    Restarted(StartCause),
}

struct Broken {
    signal: Signal,
    controller: Controller,
    bench: Bench,
    /// The feeder that the controller measures, if different.
    measured: Option<Bench>,
    target: Target,
    injected: Break,
    last: Report,
}

impl Broken {
    fn build(scene: &Scene, injected: Break) -> Self {
        let mut assumed = scene.clone();
        if let Break::Misconfigured(falsify_settings) = injected {
            falsify_settings(&mut assumed);
        }
        let mut measured = None;
        if let Break::Hidden = injected {
            let mut other = scene.clone();
            other.disturbances.clear();
            measured = Some(Bench::build(&other).expect("a scene"));
        }
        Self {
            signal: Signal::build(&assumed.settings).expect("settings"),
            controller: Controller::build(&assumed.settings, assumed.target, assumed.start)
                .expect("settings and a target"),
            bench: Bench::build(scene).expect("a scene"),
            measured,
            target: assumed.target,
            injected,
            last: Report::default(),
        }
    }

    fn cycle(&mut self) -> Moment {
        Plans::share(&mut self.controller);
        self.bench.forget_strikes();
        self.samples();
        let measured = self.measured.as_mut().unwrap_or(&mut self.bench);
        if measured.sagged() {
            let start = match self.injected {
                Break::Restarted(start) => start,
                _ => StartCause::Reset,
            };
            let settings = *self.controller.settings();
            self.signal = Signal::build(&settings).expect("settings");
            self.controller = Controller::build(&settings, self.target, start).expect("a target");
            self.samples();
        }
        self.last = self.control();
        self.signal.command(self.last.command);
        (0..PLAN_SLICES).all(|_| self.controller.plan_step());
        self.bench.moment(self.last)
    }

    fn samples(&mut self) {
        for _ in 0..2 * SAMPLE_RATE {
            let mut code = self.bench.sample();
            if let Some(measured) = &mut self.measured {
                code = measured.sample();
            }
            let before = self.signal.phase();
            let sampled = self.signal.sample(code);
            let step = (self.signal.phase() - before).bits();
            self.bench.hold(sampled.output, step);
            if let Some(measured) = &mut self.measured {
                measured.forget_strikes();
                measured.hold(sampled.output, step);
            }
            if sampled.wrapped {
                break;
            }
        }
    }

    fn control(&mut self) -> Report {
        let assumed = self.measured.as_mut().unwrap_or(&mut self.bench);
        let (target, inputs) = (assumed.new_target(), assumed.inputs());
        let mut cycle = self.signal.cycle().clone();
        if let Break::Measured(falsify) = self.injected {
            falsify(&mut cycle);
        }
        let before = self.controller.clone();
        if let Some(target) = target {
            // A target out of range is refused, and the previous one remains.
            let _ = self.controller.set_target(target);
        }
        let mut report = self.controller.cycle(&cycle, &inputs);
        if let Break::Commanded(falsify) = self.injected {
            falsify(&mut report);
        }
        match self.injected {
            Break::Never(from, to) if (self.last.state, report.state) == (from, to) => {
                self.controller = before;
                Report {
                    events: Default::default(),
                    cycle: report.cycle,
                    ..self.last
                }
            }
            _ => report,
        }
    }
}

impl Drop for Broken {
    /// Keeps the plans for later runs: they depend on their settings alone.
    fn drop(&mut self) {
        Plans::cache(&self.controller);
    }
}

/// Result of a scene with an injected fault.
pub fn run(file: &SceneFile, injected: Break) -> Outcome {
    let mut closed = Broken::build(&file.scene, injected);
    let cycle = || {
        let moment = closed.cycle();
        Ok((moment, closed.bench.strikes().to_vec()))
    };
    Outcome::from_cycles(file, cycle, Watch::ALL_CYCLES, &mut |_| Ok(()))
        .unwrap_or_else(|refusal| panic!("{refusal}"))
}
