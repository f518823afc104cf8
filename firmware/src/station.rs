//! What the control of the cycles and the link to the desk share: the controller and what is known of it.

use core::cell::{Cell, RefCell};

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal as Mailbox;
use kband::control::{
    Controller, Cycle, Event, Fault, Identification, Inputs, Interlock, Report, SAMPLE_RATE,
    Settings, Signal, StartCause, State, Target,
};
use kband::feeder::OutOfRange;
use kband::wire::{Access, KeptFault, Record, Status};

use crate::exchange::Exchange;
use crate::last_words::LastWords;
use crate::store::{Condition, Found};

/// Records that the event log keeps: 20 bytes each.
const LOG: usize = 64;

/// The fault that a cause of the start counts as, to be kept.
fn fault_of(start: StartCause) -> Option<KeptFault> {
    let fault = match start {
        StartCause::Ordinary | StartCause::PowerOn => return None,
        StartCause::Reset => Fault::WatchdogReset,
        StartCause::Repeated => Fault::RepeatedResets,
        StartCause::ImageDamaged => Fault::ImageDamaged,
        StartCause::Refused => Fault::SettingsInvalid,
    };
    Some(KeptFault {
        fault: fault.number(),
        state: State::Fault.number(),
        ..KeptFault::default()
    })
}

/// How the controller begins with what was found.
fn start_with(found: &Found, start: StartCause) -> StartCause {
    match (found.condition, start) {
        (Condition::Whole, _) | (_, StartCause::ImageDamaged) => start,
        (Condition::Never | Condition::Lost, _) => StartCause::Refused,
    }
}

/// Seconds of silence after which a simulation by the desk is over.
const SIMULATION_LASTS: u32 = 10;

/// Why settings were not taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NotTaken {
    /// The drive runs, or a fault waits to be acknowledged.
    Running,
    /// A value is out of range, alone or against its partners.
    OutOfRange(OutOfRange),
}

/// The last events, each with its number.
struct Log {
    records: [Option<Record>; LOG],
    next: u32,
}

impl Log {
    fn push(&mut self, report: &Report, event: Event) {
        let number = self.next;
        let load = report.load.filter(|_| event == Event::Weighed);
        let load = load.unwrap_or_default();
        self.next = number.wrapping_add(1);
        self.records[number as usize % LOG] = Some(Record {
            number,
            cycle: report.cycle,
            event: event.number(),
            fault: report.fault.map_or(0, Fault::number),
            mass: load.mass,
            flow: load.flow,
        });
    }

    fn from(&self, number: u32) -> Option<Record> {
        let oldest = self.next.saturating_sub(LOG as u32);
        let number = number.max(oldest);
        self.records[number as usize % LOG].filter(|record| record.number == number)
    }
}

/// Time since the start, counted in samples.
#[derive(Clone, Copy, Debug, Default)]
struct Uptime {
    seconds: u32,
    samples: u32,
}

impl Uptime {
    fn after(self, samples: u16) -> Self {
        let samples = self.samples + u32::from(samples);
        Self {
            seconds: self.seconds.wrapping_add(samples / SAMPLE_RATE),
            samples: samples % SAMPLE_RATE,
        }
    }
}

/// The controller and what is known of it, for tasks of one executor.
pub struct Station {
    controller: RefCell<Controller>,
    settings: Cell<Settings>,
    report: Cell<Report>,
    mean: Cell<f32>,
    log: RefCell<Log>,
    heard: Cell<bool>,
    /// Whether the link withholds the drive.
    withheld: Cell<bool>,
    /// Time in s since the start of the desk's last request for the plant that it simulates.
    simulated: Cell<Option<u32>>,
    /// The board's own interlock and target while the desk simulates a plant.
    held: RefCell<Option<(Interlock, Target)>>,
    /// The board's inputs as they were last seen; before the first cycle nothing can have been started by them.
    inputs: Cell<Inputs>,
    /// Most cycles of the core that the control of a drive cycle took.
    longest: Cell<u32>,
    tick: Mailbox<NoopRawMutex, ()>,
    uptime: Cell<Uptime>,
    /// A fault that is not kept yet.
    fresh: Cell<Option<KeptFault>>,
    exchange: &'static Exchange,
    last_words: LastWords,
}

impl Station {
    /// The controller for what was found in the memory; large, made in a call of its own.
    ///
    /// Settings that were not saved by this board, or not whole, start the controller in its fault: the defaults in
    /// their place belong to no machine.
    #[inline(never)]
    pub fn controller(found: &Found, start: StartCause) -> Result<Controller, OutOfRange> {
        Controller::build(&found.settings, found.target, start_with(found, start))
    }

    /// The station for what was found in the memory, with the controller for it ([`Self::controller`]): given, so that
    /// the station is made where it is to lie, and not copied there over a stack that has no room for two.
    #[inline(always)]
    #[must_use]
    pub fn new(
        found: &Found,
        start: StartCause,
        controller: &Controller,
        exchange: &'static Exchange,
        last_words: LastWords,
    ) -> Self {
        Self {
            controller: RefCell::new(controller.clone()),
            settings: Cell::new(found.settings),
            report: Cell::new(Report::default()),
            mean: Cell::new(0.0),
            log: RefCell::new(Log {
                records: [None; LOG],
                next: 0,
            }),
            heard: Cell::new(false),
            withheld: Cell::new(false),
            simulated: Cell::new(None),
            held: RefCell::new(None),
            inputs: Cell::new(Inputs::default()),
            longest: Cell::new(0),
            tick: Mailbox::new(),
            uptime: Cell::new(Uptime::default()),
            fresh: Cell::new(fault_of(start_with(found, start))),
            exchange,
            last_words,
        }
    }

    /// Takes a cycle and the board's inputs; what the controller makes of it. While the desk simulates
    /// the plant, the board's own cycle is only counted, until the desk falls silent.
    pub fn cycle(&self, cycle: &Cycle, inputs: Inputs) -> Option<Report> {
        self.tick.signal(());
        self.uptime.set(self.uptime.get().after(cycle.samples));
        self.inputs.set(inputs);
        if let Some(heard) = self.simulated.get() {
            if self.seconds().wrapping_sub(heard) <= SIMULATION_LASTS {
                return None;
            }
            self.end_simulation();
        }
        Some(self.control(
            cycle,
            Inputs {
                withheld: self.withheld.get(),
                link_heard: self.heard.take() || inputs.link_heard,
                ..inputs
            },
        ))
    }

    /// Takes a cycle of a simulated plant with its inputs; what the controller makes of it.
    pub fn simulated_cycle(&self, cycle: &Cycle, inputs: Inputs) -> Report {
        if self.simulated.get().is_some() {
            self.simulated.set(Some(self.seconds()));
        }
        self.control(cycle, inputs)
    }

    /// Starts a controller for a simulated plant, and the signal path that goes with it; the drive
    /// stays off while the desk goes on. Refused while the drive runs or its enable input is on: a
    /// simulation must not take a machine out of service.
    pub fn simulate(&self, target: Target, start: StartCause) -> Result<Signal, NotTaken> {
        if self.simulated.get().is_none() && (!self.at_rest() || self.inputs.get().enable) {
            return Err(NotTaken::Running);
        }
        let settings = self.settings.get();
        let interlock = Interlock::begin(start, settings.frequency);
        let own = (self.interlock(), self.target());
        self.renew_controller(&settings, target, &interlock)?;
        self.held.borrow_mut().get_or_insert(own);
        self.simulated.set(Some(self.seconds()));
        // Last, as it is large: settings in use have a signal path.
        Signal::build(&settings).map_err(NotTaken::OutOfRange)
    }

    /// Ends a simulation: the board has its interlock and its target back, and waits for an edge of
    /// the enable input.
    #[inline(never)]
    fn end_simulation(&self) {
        self.simulated.set(None);
        if let Some((interlock, target)) = self.held.borrow_mut().take() {
            // Settings that were accepted once are accepted again.
            let _ = self.renew_controller(&self.settings.get(), target, &interlock.latched());
        }
        self.report.set(self.controller.borrow().report());
    }

    fn interlock(&self) -> Interlock {
        self.controller.borrow().interlock().clone()
    }

    /// Puts another controller in the place of the present one; refused, with that one kept.
    ///
    /// Controller and signal path are large: each is made in a call of its own, on a stack that is
    /// empty again before the next.
    #[inline(never)]
    fn renew_controller(
        &self,
        settings: &Settings,
        target: Target,
        interlock: &Interlock,
    ) -> Result<(), NotTaken> {
        match Controller::resume(settings, target, interlock) {
            Ok(controller) => {
                *self.controller.borrow_mut() = controller;
                Ok(())
            }
            Err(refused) => Err(NotTaken::OutOfRange(refused)),
        }
    }

    /// A signal path begun anew for the sample interrupt.
    #[inline(never)]
    fn renew_signal(&self, settings: &Settings) -> Result<(), NotTaken> {
        let signal = Signal::build(settings).map_err(NotTaken::OutOfRange)?;
        self.exchange.replace_signal(signal);
        Ok(())
    }

    /// Refused where there is no signal path for these settings.
    #[inline(never)]
    fn check_signal(settings: &Settings) -> Result<(), NotTaken> {
        match Signal::build(settings) {
            Ok(_) => Ok(()),
            Err(refused) => Err(NotTaken::OutOfRange(refused)),
        }
    }

    fn control(&self, cycle: &Cycle, inputs: Inputs) -> Report {
        let report = self.controller.borrow_mut().cycle(cycle, &inputs);
        let before = self.report.replace(report);
        self.mean.set(cycle.mean);
        if let Some(fault) = report.fault
            && before.fault.is_none()
            && self.simulated.get().is_none()
        {
            self.fresh.set(Some(KeptFault {
                number: 0,
                seconds: self.uptime.get().seconds,
                fault: fault.number(),
                state: before.state.number(),
                amplitude: report.amplitude,
                expected: self.controller.borrow().expected(),
                output: before.command.amplitude,
                low: cycle.low,
                high: cycle.high,
            }));
        }
        for event in report.events.iter() {
            self.log.borrow_mut().push(&report, event);
        }
        report
    }

    /// One slice of planning; whether more is to be done.
    pub fn plan_step(&self) -> bool {
        self.controller.borrow_mut().plan_step()
    }

    /// Whether the target is met.
    #[must_use]
    pub fn ready(&self) -> bool {
        self.controller.borrow().ready()
    }

    /// The control of a drive cycle took so many cycles of the core.
    pub fn took(&self, cycles: u32) {
        self.longest.set(self.longest.get().max(cycles));
    }

    /// The most that it ever took.
    #[must_use]
    pub fn longest(&self) -> u32 {
        self.longest.get()
    }

    /// The end of the next drive cycle.
    pub async fn tick(&self) {
        self.tick.wait().await;
    }

    /// What the controller saw and did last.
    #[must_use]
    pub fn report(&self) -> Report {
        self.report.get()
    }

    /// Mean acceleration of the last cycle in m/s^2.
    #[must_use]
    pub fn mean(&self) -> f32 {
        self.mean.get()
    }

    /// The board's inputs and outputs in the last cycle, for a desk that may do what `access` says.
    #[must_use]
    pub fn status(&self, access: Access) -> Status {
        Status {
            inputs: self.inputs.get().into(),
            permitted: !self.withheld.get(),
            access,
            ready: self.ready(),
            mean: self.mean.get(),
            seconds: self.seconds(),
        }
    }

    /// Whether the drive is at rest and may be worked on.
    #[must_use]
    pub fn at_rest(&self) -> bool {
        matches!(self.report.get().state, State::Off | State::Fault)
    }

    /// A valid frame came.
    pub fn hear(&self) {
        self.heard.set(true);
    }

    /// Withholds the drive, or gives back what was withheld.
    pub fn withhold(&self, withheld: bool) {
        self.withheld.set(withheld);
    }

    /// Takes a new target; refused, with the old one kept, where its number is out of range.
    pub fn set_target(&self, target: Target) -> Result<(), OutOfRange> {
        self.controller.borrow_mut().set_target(target)
    }

    /// The target that is held.
    #[must_use]
    pub fn target(&self) -> Target {
        self.controller.borrow().target()
    }

    /// How far the identification of the parts' restitution has come.
    #[must_use]
    pub fn identification(&self) -> Identification {
        self.controller.borrow().identification()
    }

    /// The settings in use.
    #[must_use]
    pub fn settings(&self) -> Settings {
        self.settings.get()
    }

    /// Takes new settings for controller and signal path; refused, with nothing changed, while the
    /// drive runs and where they do not go together. It ends a simulation.
    pub fn set_settings(&self, settings: &Settings) -> Result<(), NotTaken> {
        self.take_settings(settings, Interlock::clone)
    }

    /// Takes the defaults, as [`Station::set_settings`]. They belong to no machine: the drive stays
    /// off, with the fault for invalid settings, until settings are saved.
    pub fn restore_defaults(&self) -> Result<(), NotTaken> {
        self.take_settings(&Settings::default(), Interlock::without_settings)
    }

    fn take_settings(
        &self,
        settings: &Settings,
        keep: fn(&Interlock) -> Interlock,
    ) -> Result<(), NotTaken> {
        if self.simulated.get().is_some() && self.at_rest() {
            self.end_simulation();
        }
        let report = self.report.get();
        match (report.state, report.fault) {
            // They come one by one; the fault is acknowledged once all of them are saved.
            (State::Off, _) | (State::Fault, Some(Fault::SettingsInvalid)) => {}
            _ => return Err(NotTaken::Running),
        }
        settings.check().map_err(NotTaken::OutOfRange)?;
        Self::check_signal(settings)?;
        self.renew_controller(settings, self.target(), &keep(&self.interlock()))?;
        self.settings.set(*settings);
        self.renew_signal(settings)
    }

    /// The settings in use were saved: a fault for invalid settings may be acknowledged.
    pub fn saved(&self) {
        if self.simulated.get().is_some() {
            self.end_simulation();
        }
        self.controller.borrow_mut().settings_saved();
    }

    /// Seconds since the start.
    #[must_use]
    pub fn seconds(&self) -> u32 {
        self.uptime.get().seconds
    }

    /// A fault that is to be kept, while the drive is at rest.
    pub fn fresh_fault(&self) -> Option<KeptFault> {
        self.at_rest().then(|| self.fresh.take()).flatten()
    }

    /// The first record of the event log from this number on.
    #[must_use]
    pub fn event(&self, number: u32) -> Option<Record> {
        self.log.borrow().from(number)
    }

    /// What the firmware said last before its last reset.
    #[must_use]
    pub fn last_words(&self) -> Option<&str> {
        self.last_words.read()
    }

    /// Drive cycles whose control came too late.
    #[must_use]
    pub fn missed(&self) -> u32 {
        self.exchange.missed()
    }
}
