//! Scenes with a fault injected into their controller: into its configuration, inputs or outputs.
//!
//! The product contains no injection. The loop of [`kband_plant::ClosedLoop`] is rebuilt here from
//! its public parts, with one fault between two of them.

use kband_control::{
    Controller, Cycle, PLAN_SLICES, Report, SAMPLE_RATE, Signal, StartCause, State, Target,
};
use kband_plant::{Bench, Change, Moment, Scene};
use kband_scene::{Outcome, SceneFile, Watch};

/// The injected fault.
#[derive(Clone, Copy, Debug)]
pub enum Break {
    /// No fault.
    Nothing,
    /// This change of state never happens: the controller keeps its previous state.
    Never(State, State),
    /// The controller's feeder ignores these changes; the real feeder follows them.
    Hidden(fn(&Change) -> bool),
    /// The controller's configuration differs from the scene.
    Told(fn(&mut Scene)),
    /// The measured cycle is falsified.
    Seen(fn(&mut Cycle)),
    /// The controller's output to the drive is falsified.
    Done(fn(&mut Report)),
    /// After a brown-out the controller starts with this cause.
    Restarted(StartCause),
}

/// The closed loop of a scene with an injected fault.
struct Broken {
    signal: Signal,
    controller: Controller,
    /// The driven feeder.
    bench: Bench,
    /// The feeder that the controller measures, if different.
    shown: Option<Bench>,
    /// The initial target.
    target: Target,
    how: Break,
    last: Report,
}

impl Broken {
    /// The loop of a scene at time 0.
    fn build(scene: &Scene, how: Break) -> Self {
        let mut told = scene.clone();
        if let Break::Told(tell) = how {
            tell(&mut told);
        }
        let mut shown = None;
        if let Break::Hidden(hidden) = how {
            let mut other = scene.clone();
            other.disturbances.retain(|d| !hidden(&d.change));
            shown = Some(Bench::build(&other).expect("a scene"));
        }
        Self {
            signal: Signal::build(&told.settings).expect("settings"),
            controller: Controller::build(&told.settings, told.target, told.start)
                .expect("settings and a target"),
            bench: Bench::build(scene).expect("a scene"),
            shown,
            target: told.target,
            how,
            last: Report::default(),
        }
    }

    /// Runs to the end of the next drive cycle.
    fn cycle(&mut self) -> Moment {
        self.bench.forget_strikes();
        self.samples();
        let shown = self.shown.as_mut().unwrap_or(&mut self.bench);
        if shown.sagged() {
            let start = match self.how {
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
        for _ in 0..PLAN_SLICES {
            if !self.controller.plan_step() {
                break;
            }
        }
        self.bench.moment(self.last)
    }

    /// The samples of one cycle.
    fn samples(&mut self) {
        for _ in 0..2 * SAMPLE_RATE {
            let mut code = self.bench.sample();
            if let Some(shown) = &mut self.shown {
                code = shown.sample();
            }
            let before = self.signal.phase();
            let sampled = self.signal.sample(code);
            let step = (self.signal.phase() - before).bits();
            self.bench.hold(sampled.output, step);
            if let Some(shown) = &mut self.shown {
                shown.forget_strikes();
                shown.hold(sampled.output, step);
            }
            if sampled.wrapped {
                break;
            }
        }
    }

    fn control(&mut self) -> Report {
        let told = self.shown.as_mut().unwrap_or(&mut self.bench);
        let (target, inputs) = (told.new_target(), told.inputs());
        let mut cycle = self.signal.cycle().clone();
        if let Break::Seen(falsify) = self.how {
            falsify(&mut cycle);
        }
        let before = self.controller.clone();
        if let Some(target) = target {
            // A target out of range is refused; the old one stays.
            let _ = self.controller.set_target(target);
        }
        let mut report = self.controller.cycle(&cycle, &inputs);
        if let Break::Done(falsify) = self.how {
            falsify(&mut report);
        }
        match self.how {
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

/// Outcome of a scene with an injected fault.
///
/// # Panics
/// Where the scene is refused.
pub fn run(file: &SceneFile, how: Break) -> Outcome {
    let mut closed = Broken::build(&file.scene, how);
    let cycle = || {
        let moment = closed.cycle();
        Ok((moment, closed.bench.strikes().to_vec()))
    };
    Outcome::of(file, cycle, Watch::KEPT, &mut |_| Ok(()))
        .unwrap_or_else(|refusal| panic!("{refusal}"))
}
