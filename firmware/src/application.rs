//! The sample interrupt and the control of each drive cycle.

use embassy_futures::yield_now;
use kband::arithmetic::Phase;
use kband::control::{PLAN_SLICES, Signal};

use crate::board::{Drive, Monitor, Panel, Sense};
use crate::exchange::{COMMAND, Exchange, SIGNAL};
use crate::station::Station;
use crate::watch::{Roll, Watched};

/// The sample interrupt.
///
/// Deadline: one sample, 50 us (8400 cycles of the core at 168 MHz). A sample that comes late shifts
/// the drive's phase, which the demodulation then measures with everything else; a lost one is one
/// sample of drive standing still.
pub struct Sampler<S, D> {
    signal: Signal,
    sense: S,
    drive: D,
    exchange: &'static Exchange,
    roll: &'static Roll,
    on: bool,
}

impl<S: Sense, D: Drive> Sampler<S, D> {
    /// The interrupt's work, with the drive off.
    pub fn new(
        signal: Signal,
        sense: S,
        mut drive: D,
        exchange: &'static Exchange,
        roll: &'static Roll,
    ) -> Self {
        drive.off();
        Self {
            signal,
            sense,
            drive,
            exchange,
            roll,
            on: false,
        }
    }

    /// One sample.
    #[inline]
    pub fn interrupt(&mut self) {
        let news = self.exchange.news();
        if news & SIGNAL != 0
            && let Some(signal) = self.exchange.signal()
        {
            self.signal = signal;
        }
        if news & COMMAND != 0 {
            let command = self.exchange.commanded();
            self.signal.command(command);
            self.on = !command.immediate || command.amplitude > 0.0;
            if !self.on {
                self.drive.off();
            }
        }
        let sampled = self.signal.sample(self.sense.sample());
        if self.on {
            self.drive.set(sampled.output);
        }
        if sampled.wrapped {
            self.roll.check_in(Watched::Samples);
            self.exchange.post(self.signal.cycle().clone());
        }
    }

    /// Phase of the output at the last sample.
    #[inline]
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.signal.phase()
    }
}

/// The control of each drive cycle: control, report, then planning in slices.
///
/// Deadline: one drive cycle (20 ms at 50 Hz), or else the drive keeps its amplitude for another cycle
/// and the miss is counted. Between slices of planning other tasks run; a new cycle ends the planning.
pub async fn control(
    station: &Station,
    exchange: &'static Exchange,
    roll: &'static Roll,
    mut panel: impl Panel,
    mut monitor: impl Monitor,
) -> ! {
    loop {
        let cycle = exchange.next().await;
        roll.check_in(Watched::Cycle);
        if let Some(target) = panel.new_target() {
            // The link answers a refused target; here the old one stays.
            let _ = station.set_target(target);
        }
        let Some(report) = station.cycle(&cycle, panel.inputs()) else {
            continue;
        };
        exchange.command(report.command);
        monitor.report(&report);
        for _ in 0..PLAN_SLICES {
            if exchange.waits() || !station.plan_step() {
                break;
            }
            roll.check_in(Watched::Cycle);
            yield_now().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::last_words::LastWords;
    use crate::store::{Condition, Found};
    use core::future::Future;
    use core::pin::pin;
    use core::task::{Context, Waker};
    use kband::control::{AdcCode, Inputs, Report, Start, State, Target};
    use kband::plant::{Bench, Change, ClosedLoop, Disturbance, Scene};
    use std::boxed::Box;
    use std::rc::Rc;
    use std::vec::Vec;

    struct Desk {
        bench: Bench,
        output: f32,
        off: bool,
        reports: Vec<Report>,
    }

    #[derive(Clone)]
    struct Shared(Rc<core::cell::RefCell<Desk>>);

    impl Sense for Shared {
        fn sample(&mut self) -> AdcCode {
            self.0.borrow_mut().bench.sample()
        }
    }

    impl Drive for Shared {
        fn set(&mut self, output: f32) {
            let mut desk = self.0.borrow_mut();
            desk.output = output;
            desk.off = false;
        }

        fn off(&mut self) {
            let mut desk = self.0.borrow_mut();
            desk.output = 0.0;
            desk.off = true;
        }
    }

    impl Panel for Shared {
        fn inputs(&mut self) -> Inputs {
            self.0.borrow().bench.inputs()
        }

        fn new_target(&mut self) -> Option<Target> {
            self.0.borrow_mut().bench.new_target()
        }
    }

    impl Monitor for Shared {
        fn report(&mut self, report: &Report) {
            self.0.borrow_mut().reports.push(*report);
        }
    }

    fn scene() -> Scene {
        let mut scene = Scene::default();
        let changes = [
            (0.615, Change::Target(Target::K(0.5))),
            (1.015, Change::Gain(0.8)),
            (1.515, Change::Enable(false)),
            (2.515, Change::Enable(true)),
            (3.015, Change::SensorLost(true)),
        ];
        let changes = changes.map(|(at, change)| Disturbance { at, change });
        scene.disturbances = changes.into_iter().collect();
        scene
    }

    /// Runs the application over a scene for some cycles; `late` samples pass before each cycle's
    /// control is let run.
    fn run(scene: &Scene, cycles: usize, late: usize) -> (Vec<Report>, Vec<bool>, u32) {
        static ROLL: Roll = Roll::of(&[Watched::Samples, Watched::Cycle]);
        let exchange: &'static Exchange = Box::leak(Box::new(Exchange::new()));
        let desk = Shared(Rc::new(core::cell::RefCell::new(Desk {
            bench: Bench::build(scene).unwrap(),
            output: 0.0,
            off: false,
            reports: Vec::new(),
        })));
        let found = Found {
            settings: scene.settings,
            target: scene.target,
            condition: Condition::Whole,
        };
        let (station, signal) =
            Station::build(&found, Start::Ordinary, exchange, LastWords::EMPTY).unwrap();
        let mut sampler = Sampler::new(signal, desk.clone(), desk.clone(), exchange, &ROLL);
        assert!(desk.0.borrow().off, "the drive starts off");
        let mut task = pin!(control(
            &station,
            exchange,
            &ROLL,
            desk.clone(),
            desk.clone()
        ));
        let mut context = Context::from_waker(Waker::noop());
        let _ = task.as_mut().poll(&mut context);
        let mut off = Vec::new();
        let mut waiting = 0;
        while desk.0.borrow().reports.len() < cycles {
            let before = sampler.phase();
            sampler.interrupt();
            let step = (sampler.phase() - before).bits();
            let output = desk.0.borrow().output;
            desk.0.borrow_mut().bench.hold(output, step);
            if exchange.owed() {
                waiting += 1;
            }
            if waiting > late {
                waiting = 0;
                while exchange.owed() {
                    let _ = task.as_mut().poll(&mut context);
                }
                off.push(desk.0.borrow().off);
            }
        }
        let reports = desk.0.borrow().reports.clone();
        (reports, off, exchange.missed())
    }

    #[test]
    fn the_application_is_the_closed_loop() {
        let scene = scene();
        let (reports, off, missed) = run(&scene, 200, 0);
        let mut closed = ClosedLoop::build(&scene).unwrap();
        for (n, report) in reports.iter().enumerate() {
            assert_eq!(*report, closed.cycle().report, "cycle {n}");
        }
        assert_eq!(missed, 0);
        let fault = reports
            .iter()
            .position(|r| r.state == State::Fault)
            .unwrap();
        // The command is obeyed at the next sample, seen here a cycle later.
        assert!(!off[fault - 1] && off[fault + 1]);
    }

    #[test]
    fn a_control_within_its_deadline_gives_the_same_whenever_it_runs() {
        // The changes lie in the later half of their cycles, so that 100 samples of delay see the same
        // inputs; the sensor is not lost before cycle 150, and only switching off does not wait.
        let scene = scene();
        let (prompt, _, _) = run(&scene, 149, 0);
        let (later, _, missed) = run(&scene, 149, 100);
        assert_eq!(missed, 0);
        for (n, (a, b)) in prompt.iter().zip(&later).enumerate() {
            assert_eq!(a, b, "cycle {n}");
        }
    }

    #[test]
    fn a_control_beyond_its_deadline_is_counted() {
        let (reports, _, missed) = run(&scene(), 50, 450);
        // A cycle has 400 samples: the control of each spans the end of the next one.
        assert!(missed >= 48, "{missed}");
        assert!(reports.iter().all(|report| report.amplitude.is_finite()));
    }
}
