//! Shared state of the control task and the link: the controller, its settings and its last report.

use crate::exchange::Exchange;
use crate::storage::last_words::LastWords;
use crate::storage::recipes::Recipes;
use crate::storage::store::{Condition, LoadedSettings};
use core::cell::{Cell, RefCell};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal as Mailbox;
use kband::feeder::OutOfRange;
use kband_bus::{SaveProgress, Server};
use kband_control::wire::{Access, FaultRecord, Record, Refusal, Status, Stored};
use kband_control::{
    Controller, Cycle, Event, Fault, Identification, Inputs, Interlock, Recipe, RecipeName, Report,
    SAMPLE_RATE, Settings, Signal, StartCause, State, Target,
};

/// Number of records in the event log, 20 bytes each.
const LOG_RECORDS: usize = 64;

/// Result of a request that a station may refuse.
pub(crate) type Result<T = (), E = Refusal<'static>> = core::result::Result<T, E>;

/// Time in s without a request after which a simulation by the desk ends.
const SIMULATION_TIMEOUT_S: u32 = 10;

/// The refusal of a number out of its range.
pub(crate) fn out_of_range(refused: OutOfRange) -> Refusal<'static> {
    Refusal::OutOfRange {
        parameter: refused.parameter,
        accepted: refused.accepted,
    }
}

/// Ring buffer of the last events, each with its number.
pub(crate) struct Log {
    records: [Option<Record>; LOG_RECORDS],
    pub next: u32,
}

impl Log {
    fn push(&mut self, report: &Report, event: Event) {
        let number = self.next;
        let load = report.load.filter(|_| event == Event::Weighed);
        let load = load.unwrap_or_default();
        self.next = number.wrapping_add(1);
        self.records[number as usize % LOG_RECORDS] = Some(Record {
            number,
            cycle: report.cycle,
            event: event.number(),
            fault: report.fault.map_or(0, Fault::number),
            mass: load.mass,
            flow: load.flow,
        });
    }

    fn from(&self, number: u32) -> Option<Record> {
        let oldest = self.next.saturating_sub(LOG_RECORDS as u32);
        let number = number.max(oldest);
        self.records[number as usize % LOG_RECORDS].filter(|record| record.number == number)
    }
}

/// State of the fieldbus.
#[derive(Default)]
pub(crate) struct BusState {
    /// The server, shared by bus line and link: one control word, one set of counters.
    pub server: RefCell<Server>,
    /// Progress of the last save that the fieldbus requested.
    pub save: Cell<SaveProgress>,
    /// Whether neither strap nor PIN protects the settings.
    pub writable: Cell<bool>,
    pub settings_changed: Mailbox<NoopRawMutex, ()>,
}

/// The controller with its settings and last report, for tasks of one executor.
pub struct Station {
    controller: RefCell<Controller>,
    settings: Cell<Settings>,
    report: Cell<Report>,
    /// Mean acceleration over the last cycle, m/s^2.
    pub(crate) mean: Cell<f32>,
    current: Cell<f32>,
    pub(crate) log: RefCell<Log>,
    /// Whether a valid frame of the link arrived since the last cycle.
    pub(crate) frame_received: Cell<bool>,
    /// Whether the desk withholds the drive's enable.
    pub(crate) withheld: Cell<bool>,
    /// Time since the start until which an update keeps the drive off, s.
    off_until: Cell<Option<u32>>,
    pub(crate) bus: BusState,
    pub(crate) recipes: RefCell<Recipes>,
    /// The saved target and its part settings: recipe 0.
    saved_parts: Cell<Recipe>,
    /// Number of the recipe in use, and the number at the inputs.
    recipe: Cell<u8>,
    selected: Cell<u8>,
    /// Whether the recipe at the inputs was refused, so that another target is in use.
    recipe_is_refused: Cell<bool>,
    /// Time of the last request for a simulated plant, s since the start; `None` without one.
    simulated: Cell<Option<u32>>,
    /// The board's own interlock and target while the desk simulates a plant.
    board_interlock_and_target: RefCell<Option<(Interlock, Target)>>,
    /// The board's inputs in the last cycle; all off before the first cycle.
    inputs: Cell<Inputs>,
    /// Longest control of a drive cycle, core cycles.
    pub(crate) longest: Cell<u32>,
    pub(crate) tick: Mailbox<NoopRawMutex, ()>,
    samples: Cell<u64>,
    /// A fault that the store does not hold yet.
    pub(crate) unsaved_fault: Cell<Option<FaultRecord>>,
    pub(crate) exchange: &'static Exchange,
    /// Message of the firmware before its last reset.
    pub(crate) last_words: LastWords,
}

impl Station {
    /// Builds the controller from the stored settings and target, in a separate call to keep the
    /// stack small. With missing or damaged settings it starts in its fault.
    ///
    /// # Errors
    /// A value is out of range.
    #[inline(never)]
    pub fn controller(saved: &LoadedSettings, start: StartCause) -> Result<Controller, OutOfRange> {
        let start = match (saved.condition, start) {
            (Condition::Whole, _) | (_, StartCause::ImageDamaged) => start,
            (Condition::Never | Condition::Lost | Condition::Newer, _) => StartCause::Refused,
        };
        Controller::build(&saved.settings, saved.target, start)
    }

    /// Builds the station with its [controller](Self::controller), inlined to save stack.
    #[inline(always)]
    pub fn new(
        saved: &LoadedSettings,
        controller: &Controller,
        exchange: &'static Exchange,
        last_words: LastWords,
    ) -> Self {
        let start_fault = controller.interlock().fault.map(|fault| FaultRecord {
            fault: fault.number(),
            state: State::Fault.number(),
            ..FaultRecord::default()
        });
        Self {
            controller: RefCell::new(controller.clone()),
            settings: Cell::new(saved.settings),
            report: Cell::new(Report::default()),
            mean: Cell::new(0.0),
            current: Cell::new(0.0),
            log: RefCell::new(Log {
                records: [None; LOG_RECORDS],
                next: 0,
            }),
            frame_received: Cell::new(false),
            withheld: Cell::new(false),
            off_until: Cell::new(None),
            bus: BusState::default(),
            recipes: RefCell::new(Recipes::default()),
            saved_parts: Cell::new(Recipe::of(saved.target, &saved.settings)),
            recipe: Cell::new(0),
            selected: Cell::new(0),
            recipe_is_refused: Cell::new(false),
            simulated: Cell::new(None),
            board_interlock_and_target: RefCell::new(None),
            inputs: Cell::new(Inputs::default()),
            longest: Cell::new(0),
            tick: Mailbox::new(),
            samples: Cell::new(0),
            unsaved_fault: Cell::new(start_fault),
            exchange,
            last_words,
        }
    }

    /// Runs the controller over one cycle with the board's inputs. While the desk simulates the
    /// plant, only the time advances, and the result is `None`.
    pub fn cycle(&self, cycle: &Cycle, inputs: Inputs) -> Option<Report> {
        self.tick.signal(());
        (self.samples).update(|samples| samples + u64::from(cycle.samples));
        self.inputs.set(inputs);
        if let Some(last_received) = self.simulated.get() {
            if self.seconds().wrapping_sub(last_received) <= SIMULATION_TIMEOUT_S {
                return None;
            }
            self.end_simulation();
        }
        let desk_active = self.frame_received.take() || inputs.link_heard;
        let (bus, bus_active) = self.bus.server.borrow_mut().take_command();
        let controls = self.bus_controls();
        Some(self.control(
            cycle,
            Inputs {
                withheld: self.withheld.get() || self.is_disabled(inputs.enable),
                bus: controls.then_some(bus),
                link_heard: if controls { bus_active } else { desk_active },
                ..inputs
            },
        ))
    }

    /// Runs the controller over one cycle of a simulated plant with its inputs.
    pub fn simulated_cycle(&self, cycle: &Cycle, inputs: Inputs) -> Report {
        if self.simulated.get().is_some() {
            self.simulated.set(Some(self.seconds()));
        }
        self.control(cycle, inputs)
    }

    /// Starts a controller for a simulated plant and returns its signal path; the drive stays off.
    ///
    /// # Errors The drive runs or its enable input is on: a machine stays in service.
    pub fn simulate(&self, target: Target, start: StartCause) -> Result<Signal> {
        if self.simulated.get().is_none() && (!self.at_rest() || self.inputs.get().enable) {
            return Err(Refusal::Running);
        }
        let settings = self.settings.get();
        let interlock = Interlock::begin(start, settings.frequency);
        let before = (self.interlock(), self.target());
        self.renew_controller(&settings, target, &interlock)?;
        self.board_interlock_and_target
            .borrow_mut()
            .get_or_insert(before);
        self.simulated.set(Some(self.seconds()));
        // Built last because it is large; it cannot fail with the settings in use.
        Signal::build(&settings).map_err(out_of_range)
    }

    /// Ends a simulation and restores the board's interlock, latched, and its target.
    #[inline(never)]
    fn end_simulation(&self) {
        self.simulated.set(None);
        if let Some((interlock, target)) = self.board_interlock_and_target.borrow_mut().take() {
            // Settings and target were accepted before and are accepted again.
            let _ = self.renew_controller(&self.settings.get(), target, &interlock.latched());
        }
        self.report.set(self.controller.borrow().report());
    }

    fn interlock(&self) -> Interlock {
        self.controller.borrow().interlock().clone()
    }

    /// Replaces the controller; if it is refused, the previous one stays. Controller and signal
    /// path are large: a separate call builds each, so that their stack use does not add up.
    #[inline(never)]
    fn renew_controller(
        &self,
        settings: &Settings,
        target: Target,
        interlock: &Interlock,
    ) -> Result {
        let controller = Controller::resume(settings, target, interlock);
        *self.controller.borrow_mut() = controller.map_err(out_of_range)?;
        Ok(())
    }

    #[inline(never)]
    fn renew_signal(&self, settings: &Settings) -> Result {
        let signal = Signal::build(settings).map_err(out_of_range)?;
        self.exchange.replace_signal(signal);
        Ok(())
    }

    #[inline(never)]
    fn check_signal(settings: &Settings) -> Result {
        Signal::build(settings).map(drop).map_err(out_of_range)
    }

    fn control(&self, cycle: &Cycle, inputs: Inputs) -> Report {
        let report = self.controller.borrow_mut().cycle(cycle, &inputs);
        let before = self.report.replace(report);
        self.mean.set(cycle.mean);
        self.current.set(cycle.current);
        if let Some(fault) = report.fault
            && before.fault.is_none()
            && self.simulated.get().is_none()
        {
            self.unsaved_fault.set(Some(FaultRecord {
                number: 0,
                seconds: self.seconds(),
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

    /// Runs one slice of planning; returns whether more remain.
    pub fn plan_step(&self) -> bool {
        self.controller.borrow_mut().plan_step()
    }

    /// As [`Station::plan_step`], for the board's own cycles; does nothing in a simulation.
    pub fn plan_own_step(&self) -> bool {
        self.simulated.get().is_none() && self.plan_step()
    }

    /// Whether the target is met.
    pub fn ready(&self) -> bool {
        self.controller.borrow().is_ready() && !self.recipe_is_refused.get()
    }

    /// Report of the last drive cycle.
    pub fn report(&self) -> Report {
        self.report.get()
    }

    /// Inputs and outputs of the board in the last cycle, and the access of the desk.
    pub fn status(&self, access: Access) -> Status {
        Status {
            inputs: self.inputs.get(),
            permitted: !self.withheld.get() && self.off_until.get().is_none(),
            access,
            ready: self.ready(),
            mean: self.mean.get(),
            current: self.current.get(),
            seconds: self.seconds(),
            recipe: self.recipe(),
        }
    }

    /// Whether the drive is off or in fault, so that flash and settings may be written.
    pub fn at_rest(&self) -> bool {
        matches!(self.report.get().state, State::Off | State::Fault)
    }

    /// Whether the drive is at rest and cannot start, due to the enable input or an update.
    pub fn is_out_of_use(&self) -> bool {
        let cannot_start = !self.inputs.get().enable || self.off_until.get().is_some();
        self.at_rest() && cannot_start && self.simulated.get().is_none()
    }

    /// Keeps the drive off until this time since the start, s, and the enable input's next low.
    pub fn disable_until(&self, seconds: u32) {
        self.off_until.set(Some(seconds));
    }

    /// Whether an update keeps the drive off, with this level of the enable input.
    fn is_disabled(&self, enable: bool) -> bool {
        let until = self.off_until.get();
        let active = until.filter(|until| enable || self.seconds() < *until);
        self.off_until.set(active);
        active.is_some()
    }

    /// Whether the fieldbus is in control, and the link reads only.
    pub fn bus_controls(&self) -> bool {
        self.settings.get().bus_controls()
    }

    /// Sets a new target.
    ///
    /// # Errors
    /// Its number is out of range; the previous target stays.
    pub fn set_target(&self, target: Target) -> Result {
        let set = self.controller.borrow_mut().set_target(target);
        set.map_err(out_of_range)?;
        self.recipe.set(0);
        self.recipe_is_refused.set(false);
        Ok(())
    }

    /// The recipe of this number.
    pub fn stored_recipe(&self, number: u8) -> Stored {
        self.recipes.borrow().get(number)
    }

    /// Changes or deletes a recipe until the next start, or permanently once the recipes are saved.
    ///
    /// # Errors
    /// The drive runs, or the recipe does not fit the machine; nothing changes.
    pub fn set_recipe(&self, number: u8, recipe: Option<&(RecipeName, Recipe)>) -> Result {
        if !self.at_rest() || self.simulated.get().is_some() {
            return Err(Refusal::Running);
        }
        if let Some((_, recipe)) = recipe {
            let checked = self.controller.borrow().check_recipe(recipe);
            checked.map_err(out_of_range)?;
        }
        let exists = self.recipes.borrow_mut().set(number, recipe);
        exists.then_some(()).ok_or(Refusal::NoRecipe)
    }

    /// Uses a recipe, also while the drive runs; 0 is the saved target with its part settings.
    ///
    /// # Errors
    /// Refused; the previous target stays.
    pub fn use_recipe(&self, number: u8) -> Result {
        if self.simulated.get().is_some() {
            return Err(Refusal::Running);
        }
        let recipe = match (number, self.stored_recipe(number)) {
            (0, _) => self.saved_parts.get(),
            (_, Stored::Recipe(_, recipe)) => recipe,
            (_, Stored::None | Stored::Newer) => return Err(Refusal::NoRecipe),
        };
        let mut controller = self.controller.borrow_mut();
        controller.use_recipe(&recipe).map_err(out_of_range)?;
        self.settings.set(*controller.settings());
        self.recipe.set(number);
        self.recipe_is_refused.set(false);
        Ok(())
    }

    /// Uses the recipe selected by the inputs, when they change and no fieldbus is in control.
    pub fn follow_inputs(&self, number: u8) {
        if self.simulated.get().is_some()
            || self.bus_controls()
            || self.selected.replace(number) == number
        {
            return;
        }
        if self.use_recipe(number).is_err() {
            self.recipe_is_refused.set(true);
            self.controller.borrow_mut().report_refused_recipe();
        }
    }

    /// Number of the recipe in use; 0 without one.
    pub fn recipe(&self) -> u8 {
        self.recipe.get()
    }

    /// Whether settings and target in use equal `saved`, or `saved` with the recipe in use.
    pub fn uses(&self, saved: &LoadedSettings) -> bool {
        let (settings, target) = match self.stored_recipe(self.recipe()) {
            Stored::Recipe(_, recipe) => {
                let settings = recipe.applied_to(&saved.settings);
                (settings.unwrap_or(saved.settings), recipe.target)
            }
            Stored::None | Stored::Newer => (saved.settings, saved.target),
        };
        (settings, target) == (self.settings(), self.target())
    }

    /// The configured target.
    pub fn target(&self) -> Target {
        self.controller.borrow().target()
    }

    /// State of the identification of the parts' restitution.
    pub fn identification(&self) -> Identification {
        self.controller.borrow().identification()
    }

    /// The settings in use.
    pub fn settings(&self) -> Settings {
        self.settings.get()
    }

    /// Sets new settings for controller and signal path, and ends a simulation.
    ///
    /// # Errors
    /// The drive runs, or the settings do not fit together; nothing changes.
    pub fn set_settings(&self, settings: &Settings) -> Result {
        self.take_settings(settings, Interlock::clone)
    }

    /// Sets the defaults, as [`Station::set_settings`]. They fit no machine, so the drive stays off
    /// until settings are saved.
    pub fn restore_defaults(&self) -> Result {
        self.take_settings(&Settings::default(), Interlock::without_settings)
    }

    fn take_settings(&self, settings: &Settings, keep: fn(&Interlock) -> Interlock) -> Result {
        // A refused value does not end a simulation.
        settings.check().map_err(out_of_range)?;
        Self::check_signal(settings)?;
        let report = self.report.get();
        let (mut state, mut fault) = (report.state, report.fault);
        let ends_simulation = self.simulated.get().is_some() && self.at_rest();
        if ends_simulation && let Some((interlock, _)) = &*self.board_interlock_and_target.borrow()
        {
            // The end of the simulation restores the board's own fault.
            fault = interlock.fault;
            state = fault.map_or(State::Off, |_| State::Fault);
        }
        match (state, fault) {
            // The desk sets one value at a time; saving them acknowledges the fault.
            (State::Off, _) | (State::Fault, Some(Fault::SettingsInvalid)) => {}
            _ => return Err(Refusal::Running),
        }
        if ends_simulation {
            self.end_simulation();
        }
        self.renew_controller(settings, self.target(), &keep(&self.interlock()))?;
        self.settings.set(*settings);
        self.bus.settings_changed.signal(());
        self.renew_signal(settings)
    }

    /// Records that the settings in use were saved; their fault can then be acknowledged.
    pub fn saved(&self) {
        if self.simulated.get().is_some() {
            self.end_simulation();
        }
        self.controller.borrow_mut().settings_saved();
        self.saved_parts
            .set(Recipe::of(self.target(), &self.settings()));
    }

    /// Time since the start, s.
    pub fn seconds(&self) -> u32 {
        (self.samples.get() / u64::from(SAMPLE_RATE)) as u32
    }

    /// The first record of the event log whose number is at least `number`.
    pub fn event(&self, number: u32) -> Option<Record> {
        self.log.borrow().from(number)
    }
}
