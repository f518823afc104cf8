//! Sampled control of the drive in two tasks: the sample interrupt and the control of each cycle.
//!
//! The interrupt reads the converter's codes and the enable contact once a sample (50 us). It sets
//! the drive signal, -1..1, and demodulates the acceleration at the drive's frequency (lock-in
//! amplifier: Meade 1983). After [`MAX_COMMAND_AGE_CYCLES`] cycles without a command it switches
//! off. The control receives the demodulated cycle and commands the amplitude of the next.

use crate::board::{Drive, Panel, Sense};
use crate::exchange::{COMMAND, Exchange, MAX_COMMAND_AGE_CYCLES, SIGNAL};
use crate::inputs::enable::{Contact, Debounce, EnableCycle};
use crate::station::Station;
use crate::watch::Watched;
use core::cell::Cell;
use embassy_futures::yield_now;
use kband::arithmetic::Phase;
use kband_control::{PLAN_SLICES, Report, Signal};

/// The sample interrupt.
///
/// Deadline: one sample, 50 us (8400 core cycles at 168 MHz). The demodulation also measures the
/// shift of a late sample; a lost sample holds the output.
pub struct Sampler<S, D> {
    signal: Signal,
    sense: S,
    drive: D,
    exchange: &'static Exchange,
    enable: Debounce,
    enable_was_high: bool,
    on: bool,
    cycles_since_command: u8,
    /// Whether the interrupt keeps the drive off until the control has also commanded it off.
    is_forced_off: bool,
    /// Whether the previous sample ended a cycle that is not handed over yet.
    ended: bool,
}

impl<S: Sense, D: Drive> Sampler<S, D> {
    /// Builds the interrupt and switches the drive off.
    pub fn new(signal: Signal, sense: S, mut drive: D, exchange: &'static Exchange) -> Self {
        drive.off();
        Self {
            signal,
            sense,
            drive,
            exchange,
            enable: Debounce::default(),
            enable_was_high: false,
            on: false,
            cycles_since_command: 0,
            is_forced_off: false,
            ended: false,
        }
    }

    /// Takes one sample: reads the inputs, applies new commands, sets the output.
    #[inline]
    pub fn interrupt(&mut self) {
        let contact = self.sense.enable();
        if let Some(contact) = contact {
            self.follow_enable(contact);
        }
        let change_bits = self.exchange.take_change_bits();
        if change_bits & SIGNAL != 0
            && let Some(signal) = self.exchange.signal.lock(Cell::take)
        {
            self.signal = signal.into_inner();
        }
        if change_bits & COMMAND != 0 {
            let command = self.exchange.command.lock(Cell::get);
            self.cycles_since_command = 0;
            self.signal.command(command);
            let off = command.immediate && command.amplitude <= 0.0;
            if off && self.is_forced_off {
                self.is_forced_off = false;
                self.exchange.set_late(false);
            }
            // Only a debounced press of the input starts the drive, whatever the control commands.
            self.is_forced_off |= !off && contact.is_some() && !self.enable.is_on();
            self.on = !off && !self.is_forced_off;
            if !self.on {
                self.drive.off();
            }
        }
        let code = self.sense.sample();
        let sampled = self.signal.sample_with(code, || self.sense.current());
        if self.on {
            // This comparison is false for NaN as well.
            if sampled.output.abs() <= 1.0 {
                self.drive.set(sampled.output);
            } else {
                self.switch_off_late();
            }
        }
        // The sample that ends a cycle takes longest, so the next one hands the cycle over.
        if self.ended {
            self.ended = false;
            let enable = contact.is_some().then(|| EnableCycle {
                given: self.enable_was_high,
                held_off: self.is_forced_off || !self.enable.is_on(),
                chatters: self.enable.take_chatter(),
            });
            self.enable_was_high = false;
            self.exchange.post(self.signal.cycle(), enable);
        }
        if sampled.wrapped {
            self.ended = true;
            if self.on {
                self.cycles_since_command += 1;
                if self.cycles_since_command >= MAX_COMMAND_AGE_CYCLES {
                    self.switch_off_late();
                }
            }
            self.exchange.roll.check_in(Watched::Samples);
        }
    }

    /// Debounces the enable input; a withdrawal switches the drive off in this sample.
    #[inline]
    fn follow_enable(&mut self, contact: Contact) {
        self.enable_was_high |= contact != Contact::Open;
        if !self.enable.sample(contact) && self.on {
            self.switch_off_until_commanded_off();
        }
    }

    /// Switches the drive off because the control missed its deadline.
    #[cold]
    fn switch_off_late(&mut self) {
        self.switch_off_until_commanded_off();
        self.exchange.set_late(true);
    }

    #[cold]
    fn switch_off_until_commanded_off(&mut self) {
        self.on = false;
        self.is_forced_off = true;
        self.signal.off();
        self.drive.off();
    }

    /// Phase of the output at the last sample.
    #[inline]
    pub fn phase(&self) -> Phase {
        self.signal.phase()
    }
}

/// Control task of the drive cycles: control, report, then planning in slices. `observe` receives
/// each report, and whether the target is met.
///
/// Deadline: one drive cycle (20 ms at 50 Hz). A missed deadline is counted, and the drive keeps
/// its amplitude. Other tasks run between slices of planning; a new cycle ends the planning.
pub async fn control(
    station: &Station,
    mut panel: impl Panel,
    mut observe: impl FnMut(&Report, bool),
) -> ! {
    let exchange = station.exchange;
    loop {
        let (cycle, enable) = exchange.next().await;
        exchange.roll.check_in(Watched::Cycle);
        if let Some(target) = panel.new_target() {
            // The link answers a refused target. Here the previous target stays.
            let _ = station.set_target(target);
        }
        if let Some(recipe) = panel.recipe() {
            station.follow_inputs(recipe);
        }
        let began = panel.now();
        let mut inputs = panel.inputs();
        inputs.control_late |= exchange.late();
        if let Some(enable) = enable {
            inputs.enable = enable.given;
            inputs.held_off = enable.held_off;
            inputs.chatters = enable.chatters;
        }
        let Some(report) = station.cycle(&cycle, inputs) else {
            continue;
        };
        exchange.command(report.command);
        let cycles = panel.now().wrapping_sub(began);
        station.longest.set(station.longest.get().max(cycles));
        observe(&report, station.ready());
        exchange.controlled();
        for _ in 0..PLAN_SLICES {
            // A slice takes up to 14 ms, so a request on the bus has priority.
            while exchange.bus.is_waiting() && !exchange.has_waiting_cycle() {
                yield_now().await;
            }
            if exchange.has_waiting_cycle() || !station.plan_own_step() {
                break;
            }
            exchange.roll.check_in(Watched::Cycle);
            yield_now().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::storage::last_words::LastWords;
    use crate::storage::store::LoadedSettings;
    use crate::testing::{exchange, with};
    use core::cell::RefCell;
    use core::pin::pin;
    use core::task::Poll;
    use embassy_futures::poll_once;
    use kband_control::{
        AdcCode, Command, Fault, Inputs, Report, StartCause, State, Target, phase_step,
    };
    use kband_plant::{Bench, Change, ClosedLoop, Disturbance, Scene};
    use std::boxed::Box;
    use std::vec::Vec;

    struct Desk {
        bench: Bench,
        /// The enable input as the sample interrupt reads it; `None` if it is read once a cycle.
        contact: Option<Contact>,
        output: f32,
        off: bool,
        reports: Vec<Report>,
    }

    type Shared = &'static RefCell<Desk>;

    impl Sense for Shared {
        fn sample(&mut self) -> AdcCode {
            self.borrow_mut().bench.sample()
        }

        fn current(&mut self) -> AdcCode {
            self.borrow().bench.current()
        }

        fn enable(&mut self) -> Option<Contact> {
            self.borrow().contact
        }
    }

    impl Drive for Shared {
        fn set(&mut self, output: f32) {
            let mut desk = self.borrow_mut();
            (desk.output, desk.off) = (output, false);
        }

        fn off(&mut self) {
            let mut desk = self.borrow_mut();
            (desk.output, desk.off) = (0.0, true);
        }
    }

    impl Panel for Shared {
        fn inputs(&mut self) -> Inputs {
            self.borrow().bench.inputs()
        }

        fn new_target(&mut self) -> Option<Target> {
            self.borrow_mut().bench.new_target()
        }
    }

    fn scene() -> Scene {
        let changes = [
            (0.615, Change::Target(Target::K(0.5))),
            (1.015, Change::Gain(0.8)),
            (1.515, Change::Enable(false)),
            (2.515, Change::Enable(true)),
            (3.015, Change::SensorLost(true)),
        ];
        let changes = changes.map(|(at, change)| Disturbance { at, change });
        with(Scene::default(), |it| it.disturbances.extend(changes))
    }

    fn desk(scene: &Scene) -> Shared {
        Box::leak(Box::new(RefCell::new(Desk {
            bench: Bench::build(scene).unwrap(),
            contact: None,
            output: 0.0,
            off: false,
            reports: Vec::new(),
        })))
    }

    /// A sampler of the default scene, whose enable input is read once a cycle or shows `contact`.
    fn sampled(contact: Option<Contact>) -> (&'static Exchange, Shared, Sampler<Shared, Shared>) {
        let scene = Scene::default();
        let (exchange, desk) = (exchange(), desk(&scene));
        desk.borrow_mut().contact = contact;
        let signal = Signal::build(&scene.settings).unwrap();
        let sampler = Sampler::new(signal, desk, desk, exchange);
        (exchange, desk, sampler)
    }

    /// A command at 50 Hz; an amplitude of 0 switches off at once.
    fn command(amplitude: f32) -> Command {
        Command {
            amplitude,
            immediate: amplitude <= 0.0,
            step: phase_step(50.0),
            ..Command::default()
        }
    }

    /// Runs the application over a scene; each control comes `late` samples after its cycle.
    fn run(scene: &Scene, cycles: usize, late: usize) -> (Vec<Report>, Vec<bool>, u32) {
        let (exchange, desk) = (exchange(), desk(scene));
        let loaded = LoadedSettings::whole(scene.settings, scene.target);
        let start = StartCause::Ordinary;
        let controller = Station::controller(&loaded, start).unwrap();
        let station = Station::new(&loaded, &controller, exchange, LastWords::EMPTY);
        let signal = Signal::build(&loaded.settings).unwrap();
        let mut sampler = Sampler::new(signal, desk, desk, exchange);
        assert!(desk.borrow().off, "the drive starts off");
        let observe = |report: &Report, _| desk.borrow_mut().reports.push(*report);
        let mut task = pin!(control(&station, desk, observe));
        let _ = poll_once(task.as_mut());
        let mut off = Vec::new();
        let mut waiting = 0;
        while desk.borrow().reports.len() < cycles {
            let before = sampler.phase();
            sampler.interrupt();
            let step = (sampler.phase() - before).bits();
            let output = desk.borrow().output;
            desk.borrow_mut().bench.hold(output, step);
            waiting += usize::from(exchange.is_unfinished());
            if waiting > late {
                waiting = 0;
                while exchange.is_unfinished() {
                    let _ = poll_once(task.as_mut());
                }
                off.push(desk.borrow().off);
            }
        }
        let reports = desk.borrow().reports.clone();
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
        let fault = (reports.iter().position(|r| r.state == State::Fault)).unwrap();
        // The drive follows the command at the next sample; this test observes it a cycle later.
        assert!(!off[fault - 1] && off[fault + 1]);
    }

    /// Runs drive cycles of a sampler, each with a command or without. Returns whether the drive is
    /// then on, and whether a late control is reported.
    fn cycles() -> impl FnMut(Option<f32>) -> (bool, bool) {
        let (exchange, desk, mut sampler) = sampled(None);
        move |amplitude| {
            if let Some(amplitude) = amplitude {
                exchange.command(command(amplitude));
            }
            (0..400).for_each(|_| sampler.interrupt());
            (!desk.borrow().off, exchange.late())
        }
    }

    #[test]
    fn a_forced_off_drive_stays_off_until_commanded_off() {
        let mut cycle = cycles();
        assert_eq!(cycle(Some(0.2)), (true, false));
        for _ in 0..5 {
            cycle(None);
        }
        assert_eq!(cycle(None), (false, true));
        assert!((0..3).all(|_| cycle(Some(0.2)) == (false, true)));
        assert_eq!(cycle(Some(0.0)), (false, false));
        assert_eq!(cycle(Some(0.2)), (true, false));
    }

    /// Runs a sampler with one command a cycle; contact states have times in ms. Returns whether
    /// the drive was off at every sample, and the enable input for the control.
    fn commanded(amplitude: f32, contacts: &[(Contact, u32)]) -> (bool, EnableCycle) {
        let (exchange, desk, mut sampler) = sampled(Some(Contact::Open));
        let mut last = None;
        let mut stays_off = true;
        for &(contact, time) in contacts {
            desk.borrow_mut().contact = Some(contact);
            for _ in 0..20 * time {
                sampler.interrupt();
                stays_off &= desk.borrow().off;
                if exchange.has_waiting_cycle()
                    && let Poll::Ready((_, enable)) = poll_once(exchange.next())
                {
                    last = enable;
                    exchange.command(command(amplitude));
                }
            }
        }
        (stays_off, last.expect("the samples read it"))
    }

    #[test]
    fn only_a_press_lets_the_drive_run() {
        use Contact::{Closed, Moved, Open};
        let given = |given, held_off, chatters| EnableCycle {
            given,
            held_off,
            chatters,
        };
        // The control commands the drive on although the input was never on.
        assert!(commanded(0.2, &[(Open, 300)]).0);
        // The control commands the drive on from the start, but must command it off first.
        let (off, enable) = commanded(0.2, &[(Open, 120), (Closed, 100)]);
        assert!(off && enable == given(true, true, false));
        let (off, enable) = commanded(0.0, &[(Open, 120), (Closed, 100)]);
        assert!(off && enable == given(true, false, false));
        let enable = commanded(0.0, &[(Closed, 1000)]).1;
        assert_eq!(enable, given(true, true, false));
        assert_eq!(commanded(0.0, &[(Open, 100)]).1, given(false, true, false));
        let chatter = [(Open, 120), (Closed, 15), (Moved, 10)];
        assert_eq!(commanded(0.0, &chatter).1, given(true, true, true));
        let chatter = [(Open, 120), (Closed, 15), (Moved, 50)];
        assert_eq!(commanded(0.0, &chatter).1, given(true, true, false), "once");
    }

    #[test]
    fn a_withdrawn_enable_input_switches_off_in_the_interrupt() {
        let (exchange, desk, mut sampler) = sampled(Some(Contact::Open));
        let mut after = |contact: Contact, samples: u32| {
            desk.borrow_mut().contact = Some(contact);
            (0..samples).for_each(|_| sampler.interrupt());
            desk.borrow().off
        };
        after(Contact::Open, 2100);
        after(Contact::Closed, 500);
        exchange.command(command(0.2));
        assert!(!after(Contact::Closed, 10));
        assert!(!after(Contact::Open, 8) && after(Contact::Open, 1));
        // The input returns unread by the control, which must command the drive off first.
        after(Contact::Open, 2100);
        after(Contact::Closed, 500);
        exchange.command(command(0.2));
        assert!(after(Contact::Closed, 10));
        exchange.command(command(0.0));
        after(Contact::Closed, 10);
        exchange.command(command(0.2));
        assert!(!after(Contact::Closed, 10));
    }

    #[test]
    fn a_control_that_comes_too_late_ends_in_its_fault() {
        // 5.5 cycles are beyond [`MAX_COMMAND_AGE_CYCLES`]. The next report carries the fault.
        let (reports, off, _) = run(&scene(), 12, 2200);
        let late = |report: &Report| report.fault == Some(Fault::ControlLate);
        assert!(reports.iter().any(late), "{reports:?}");
        assert_eq!(off.last(), Some(&true));
    }

    #[test]
    fn a_new_signal_path_is_taken_at_the_next_sample() {
        let (exchange, _, mut sampler) = sampled(None);
        let mut settings = Scene::default().settings;
        let mut step = || {
            let before = sampler.phase();
            sampler.interrupt();
            (sampler.phase() - before).bits()
        };
        assert_eq!(step(), phase_step(50.0));
        settings.set("frequency", 60.0).unwrap();
        exchange.replace_signal(Signal::build(&settings).unwrap());
        assert_ne!(step(), phase_step(50.0));
        assert_eq!(step(), phase_step(60.0));
    }

    #[test]
    fn old_commands_and_nan_outputs_switch_off() {
        for command in [None, Some(f32::NAN), Some(f32::INFINITY), Some(1.5)] {
            let mut cycle = cycles();
            assert!((0..40).all(|_| cycle(Some(0.2)) == (true, false)));
            let most = if command.is_none() { 4 } else { 2 };
            assert!(
                (0..most).any(|_| cycle(command) == (false, true)),
                "{command:?}"
            );
        }
    }

    #[test]
    fn a_control_beyond_its_deadline_is_counted() {
        let (reports, _, missed) = run(&scene(), 50, 450);
        // A cycle has 400 samples: each control runs past the end of the next cycle.
        assert!(missed >= 48, "{missed}");
        assert!(reports.iter().all(|report| report.amplitude.is_finite()));
    }
}
