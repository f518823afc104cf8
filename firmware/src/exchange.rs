//! Data exchange between the sample interrupt and the control task.
//!
//! Mailboxes carry one cycle up and one command down; the newest value replaces an older one.

use crate::bus::line::BusLine;
use crate::inputs::enable::EnableCycle;
use crate::watch::Roll;
use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal as Mailbox;
use kband::arithmetic::Phase;
use kband_control::{Command, Cycle, Signal, UPPER};

/// Mailboxes: cycles to the control, commands and signal paths to the interrupt.
///
/// The compiler cannot encode `None` in a value within a [`Cell`]. So an empty exchange is all
/// zeros, which take no flash.
pub struct Exchange {
    cycle: Mailbox<CriticalSectionRawMutex, Cell<(Cycle, Option<EnableCycle>)>>,
    /// The newest command; new if [`Self::take_change_bits`] has the bit [`COMMAND`].
    pub(crate) command: Mutex<CriticalSectionRawMutex, Cell<Command>>,
    /// The new signal path, if [`Self::take_change_bits`] has the bit [`SIGNAL`].
    pub(crate) signal: Mutex<CriticalSectionRawMutex, Cell<Option<Cell<Signal>>>>,
    change_bits: AtomicU8,
    command_due: AtomicBool,
    cycle_unfinished: AtomicBool,
    late: AtomicBool,
    missed: AtomicU32,
    /// The fieldbus's line.
    pub bus: BusLine,
    /// Tasks that have checked in.
    pub roll: Roll,
}

impl Exchange {
    /// Builds an empty exchange.
    pub const fn empty() -> Self {
        Self {
            cycle: Mailbox::new(),
            command: Mutex::new(Cell::new(Command {
                amplitude: 0.0,
                lead: Phase::ZERO,
                overtones: [[0.0; 2]; UPPER],
                step: 0,
                immediate: false,
                average_from: None,
                whole: false,
            })),
            signal: Mutex::new(Cell::new(None)),
            change_bits: AtomicU8::new(0),
            command_due: AtomicBool::new(false),
            cycle_unfinished: AtomicBool::new(false),
            late: AtomicBool::new(false),
            missed: AtomicU32::new(0),
            bus: BusLine::listening(),
            roll: Roll::new(),
        }
    }

    /// Whether control or planning of the last cycle is unfinished.
    pub fn is_unfinished(&self) -> bool {
        self.cycle_unfinished.load(Ordering::Acquire)
    }

    /// Number of cycles that ended before the control of the previous one was finished.
    pub fn missed(&self) -> u32 {
        self.missed.load(Ordering::Relaxed)
    }

    /// Whether the drive went off after [`MAX_COMMAND_AGE_CYCLES`] cycles without a command.
    pub fn late(&self) -> bool {
        self.late.load(Ordering::Acquire)
    }

    pub(crate) fn set_late(&self, late: bool) {
        self.late.store(late, Ordering::Release);
    }

    #[inline(always)]
    pub(crate) fn post(&self, cycle: &Cycle, enable: Option<EnableCycle>) {
        self.cycle_unfinished.store(true, Ordering::Release);
        if self.command_due.swap(true, Ordering::AcqRel) {
            self.missed.fetch_add(1, Ordering::Relaxed);
        }
        self.cycle.signal(Cell::new((cycle.clone(), enable)));
    }

    /// Marks the control of the last cycle as finished. Planning after it does not count as late.
    pub(crate) fn controlled(&self) {
        if !self.cycle.signaled() {
            self.command_due.store(false, Ordering::Release);
        }
    }

    pub(crate) async fn next(&self) -> (Cycle, Option<EnableCycle>) {
        self.controlled();
        if !self.cycle.signaled() {
            self.cycle_unfinished.store(false, Ordering::Release);
        }
        self.cycle.wait().await.into_inner()
    }

    /// Whether a cycle waits for its control.
    pub(crate) fn has_waiting_cycle(&self) -> bool {
        self.cycle.signaled()
    }

    /// Hands a command to the sample interrupt. It takes effect in the next cycle, an immediate one
    /// at the next sample.
    pub fn command(&self, command: Command) {
        self.command.lock(|cell| cell.set(command));
        self.change_bits.fetch_or(COMMAND, Ordering::Release);
    }

    /// Replaces the signal path for new settings at the next sample. The drive is off then.
    pub fn replace_signal(&self, signal: Signal) {
        self.signal.lock(|cell| cell.set(Some(Cell::new(signal))));
        self.change_bits.fetch_or(SIGNAL, Ordering::Release);
    }

    /// Takes the flags of new data for the sample interrupt.
    #[inline]
    pub(crate) fn take_change_bits(&self) -> u8 {
        match self.change_bits.load(Ordering::Acquire) {
            0 => 0,
            _ => self.change_bits.swap(0, Ordering::AcqRel),
        }
    }
}

/// Number of drive cycles for which a command remains valid: half the envelope's time constant at Q
/// = 25. The amplitude covers at most 40 % of the way to its end value.
pub const MAX_COMMAND_AGE_CYCLES: u8 = 4;
/// Bit of [`Exchange::change_bits`]: a new command.
pub(crate) const COMMAND: u8 = 1;
/// Bit of [`Exchange::change_bits`]: a new signal path.
pub(crate) const SIGNAL: u8 = 2;
