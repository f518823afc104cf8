//! What passes between the sample interrupt and the control of the cycles.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal as Mailbox;
use kband::arithmetic::Phase;
use kband::control::{Command, Cycle, Overtone, Signal, UPPER};

use crate::enable::EnableCycle;

/// Cycles up, commands down.
pub struct Exchange {
    cycle: Mailbox<CriticalSectionRawMutex, (Cycle, Option<EnableCycle>)>,
    command: Mutex<CriticalSectionRawMutex, Cell<Command>>,
    signal: Mutex<CriticalSectionRawMutex, Cell<Option<Signal>>>,
    news: AtomicU8,
    /// The last cycle has no command yet.
    due: AtomicBool,
    /// The last cycle has not been followed to the end of its planning yet.
    owed: AtomicBool,
    late: AtomicBool,
    missed: AtomicU32,
}

impl Default for Exchange {
    fn default() -> Self {
        Self::new()
    }
}

impl Exchange {
    /// An exchange with nothing in it.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            cycle: Mailbox::new(),
            command: Mutex::new(Cell::new(Command {
                amplitude: 0.0,
                lead: Phase::ZERO,
                overtones: [Overtone::NONE; UPPER],
                step: 0,
                immediate: true,
                fold: None,
                whole: false,
            })),
            signal: Mutex::new(Cell::new(None)),
            news: AtomicU8::new(0),
            due: AtomicBool::new(false),
            owed: AtomicBool::new(false),
            late: AtomicBool::new(false),
            missed: AtomicU32::new(0),
        }
    }

    /// Whether the control task has not yet done with the last cycle, the planning in the rest of it included.
    #[must_use]
    pub fn owed(&self) -> bool {
        self.owed.load(Ordering::Acquire)
    }

    /// Cycles that ended before the control of the one before was done.
    #[must_use]
    pub fn missed(&self) -> u32 {
        self.missed.load(Ordering::Relaxed)
    }

    /// Whether the drive was switched off because no command came for [`COMMANDS_LAST`] cycles.
    #[must_use]
    pub fn late(&self) -> bool {
        self.late.load(Ordering::Acquire)
    }

    pub(crate) fn set_late(&self, late: bool) {
        self.late.store(late, Ordering::Release);
    }

    #[inline(always)]
    pub(crate) fn post(&self, cycle: &Cycle, enable: Option<EnableCycle>) {
        self.owed.store(true, Ordering::Release);
        if self.due.swap(true, Ordering::AcqRel) {
            self.missed.fetch_add(1, Ordering::Relaxed);
        }
        self.cycle.signal((cycle.clone(), enable));
    }

    /// The control of the last cycle is done; what is planned after it makes nothing late.
    pub(crate) fn controlled(&self) {
        if !self.cycle.signaled() {
            self.due.store(false, Ordering::Release);
        }
    }

    pub(crate) async fn next(&self) -> (Cycle, Option<EnableCycle>) {
        self.controlled();
        if !self.cycle.signaled() {
            self.owed.store(false, Ordering::Release);
        }
        self.cycle.wait().await
    }

    /// A command that is new, as [`Self::news`] said.
    #[inline]
    pub(crate) fn commanded(&self) -> Command {
        self.command.lock(Cell::get)
    }

    /// A signal path that is new, as [`Self::news`] said.
    #[inline]
    pub(crate) fn signal(&self) -> Option<Signal> {
        self.signal.lock(Cell::take)
    }

    /// Whether a cycle waits for its control.
    pub(crate) fn waits(&self) -> bool {
        self.cycle.signaled()
    }

    /// What the drive is to do from the next cycle on.
    pub fn command(&self, command: Command) {
        self.command.lock(|cell| cell.set(command));
        self.news.fetch_or(COMMAND, Ordering::Release);
    }

    /// The signal path for new settings, drive off, from the next sample on.
    pub fn replace_signal(&self, signal: Signal) {
        self.signal.lock(|cell| cell.set(Some(signal)));
        self.news.fetch_or(SIGNAL, Ordering::Release);
    }

    /// What is new for the sample interrupt.
    #[inline]
    pub(crate) fn news(&self) -> u8 {
        match self.news.load(Ordering::Acquire) {
            0 => 0,
            _ => self.news.swap(0, Ordering::AcqRel),
        }
    }
}

/// Cycles that the drive goes on with the last command: half the time constant of the envelope at Q = 25, so that the amplitude
/// goes two fifths of its way at most to where an output that nobody follows leads.
pub const COMMANDS_LAST: u8 = 4;
/// News of [`Exchange::news`]: a command.
pub(crate) const COMMAND: u8 = 1;
/// News of [`Exchange::news`]: a signal path.
pub(crate) const SIGNAL: u8 = 2;
