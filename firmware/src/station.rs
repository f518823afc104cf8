//! What the control of the cycles and the link to the desk share: the controller and what is known of it.

use core::cell::{Cell, RefCell};

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal as Mailbox;
use kband::control::{
    Controller, Cycle, Fault, Identification, Inputs, Report, Settings, Signal, Start, State,
    Target,
};
use kband::feeder::OutOfRange;
use kband::wire::Record;

use crate::exchange::Exchange;
use crate::last_words::LastWords;
use crate::store::Found;

/// Records that the event log keeps.
const LOG: usize = 64;

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
    fn push(&mut self, report: &Report, event: u8) {
        let number = self.next;
        self.next = number.wrapping_add(1);
        self.records[number as usize % LOG] = Some(Record {
            number,
            cycle: report.cycle,
            event,
            fault: report.fault.map_or(0, Fault::number),
        });
    }

    fn from(&self, number: u32) -> Option<Record> {
        let oldest = self.next.saturating_sub(LOG as u32);
        let number = number.max(oldest);
        self.records[number as usize % LOG].filter(|record| record.number == number)
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
    enabled: Cell<bool>,
    simulated: Cell<bool>,
    tick: Mailbox<NoopRawMutex, ()>,
    exchange: &'static Exchange,
    last_words: LastWords,
}

impl Station {
    /// The station for what was found in the memory of the settings, and the signal path that goes
    /// with it.
    ///
    /// Refused settings start the controller in its fault, with the accepted ones if they go together
    /// and with the defaults if not.
    pub fn build(
        found: &Found,
        target: Target,
        start: Start,
        exchange: &'static Exchange,
        last_words: LastWords,
    ) -> Result<(Self, Signal), OutOfRange> {
        let sound = found.settings.check().is_ok();
        let settings = if sound {
            found.settings
        } else {
            Settings::default()
        };
        let start = if found.refused > 0 || !sound {
            Start::Refused
        } else {
            start
        };
        let signal = Signal::build(&settings)?;
        let station = Self {
            controller: RefCell::new(Controller::build(&settings, target, start)?),
            settings: Cell::new(settings),
            report: Cell::new(Report::default()),
            mean: Cell::new(0.0),
            log: RefCell::new(Log {
                records: [None; LOG],
                next: 0,
            }),
            heard: Cell::new(false),
            enabled: Cell::new(true),
            simulated: Cell::new(false),
            tick: Mailbox::new(),
            exchange,
            last_words,
        };
        Ok((station, signal))
    }

    /// Takes a cycle and the board's inputs; what the controller makes of it. While the desk simulates
    /// the plant, the board's own cycle is only counted.
    pub fn cycle(&self, cycle: &Cycle, inputs: Inputs) -> Option<Report> {
        self.tick.signal(());
        if self.simulated.get() {
            return None;
        }
        Some(self.control(
            cycle,
            Inputs {
                enable: inputs.enable && self.enabled.get(),
                link_heard: self.heard.take() || inputs.link_heard,
                ..inputs
            },
        ))
    }

    /// Takes a cycle of a simulated plant with its inputs; what the controller makes of it.
    pub fn simulated_cycle(&self, cycle: &Cycle, inputs: Inputs) -> Report {
        self.control(cycle, inputs)
    }

    /// Starts a controller anew for a simulated plant, and the signal path that goes with it; the drive
    /// stays off until the next reset. Refused while the drive runs; a simulated one is none.
    pub fn simulate(&self, target: Target, start: Start) -> Result<Signal, NotTaken> {
        if !self.simulated.get() && !self.at_rest() {
            return Err(NotTaken::Running);
        }
        let settings = self.settings.get();
        let signal = Signal::build(&settings).map_err(NotTaken::OutOfRange)?;
        self.renew_controller(&settings, target, start)?;
        self.simulated.set(true);
        Ok(signal)
    }

    /// A controller begun anew in the place of the one that is there; refused, with that one kept.
    ///
    /// Controller and signal path are large: each is made in a call of its own, on a stack that is empty
    /// again before the next.
    #[inline(never)]
    fn renew_controller(
        &self,
        settings: &Settings,
        target: Target,
        start: Start,
    ) -> Result<(), NotTaken> {
        match Controller::build(settings, target, start) {
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
        self.report.set(report);
        self.mean.set(cycle.mean);
        for event in report.events.iter() {
            self.log.borrow_mut().push(&report, event.number());
        }
        report
    }

    /// One slice of planning; whether more is to be done.
    pub fn plan_step(&self) -> bool {
        self.controller.borrow_mut().plan_step()
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

    /// Whether the drive is at rest and may be worked on.
    #[must_use]
    pub fn at_rest(&self) -> bool {
        matches!(self.report.get().state, State::Off | State::Fault)
    }

    /// A valid frame came.
    pub fn hear(&self) {
        self.heard.set(true);
    }

    /// Withdraws the enable or gives it back.
    pub fn enable(&self, enabled: bool) {
        self.enabled.set(enabled);
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
    /// drive runs and where they do not go together.
    pub fn set_settings(&self, settings: &Settings) -> Result<(), NotTaken> {
        let report = self.report.get();
        let start = match (report.state, report.fault) {
            (State::Off, _) => Start::Ordinary,
            // Accepted settings end this fault, and the drive waits for a new enable.
            (State::Fault, Some(Fault::SettingsInvalid)) => Start::Reset,
            _ => return Err(NotTaken::Running),
        };
        settings.check().map_err(NotTaken::OutOfRange)?;
        Self::check_signal(settings)?;
        self.renew_controller(settings, self.target(), start)?;
        self.settings.set(*settings);
        self.renew_signal(settings)
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
