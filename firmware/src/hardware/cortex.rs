//! Faults, panics and the stack of a Cortex-M image.
//!
//! An image defines two functions that need no initialised state: `kband_drive_off` switches the
//! drive off by register writes only, `kband_halt` ends the run.

use crate::storage::last_words::LastWords;
use crate::storage::waiting::Waiting;
use core::arch::naked_asm;
use core::cell::{Cell, UnsafeCell};
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use cortex_m::peripheral::{SCB, SYST};
use cortex_m_rt::exception;

unsafe extern "Rust" {
    /// Switches the drive off; sound at any time, in any context.
    safe fn kband_drive_off();
    /// Ends the run after the last words are stored; sound at any time, in any context.
    safe fn kband_halt() -> !;
}

/// Version of the image and the commit it was built from.
pub const IDENTITY: &str = concat!(env!("CARGO_PKG_VERSION"), "+", env!("KBAND_BUILD"));

#[repr(transparent)]
struct Retained<T>(UnsafeCell<T>);

// SAFETY: one core. Interrupts are off while the last words are written, by a handler that never
// returns or by `take`. The waiting faults are given away once.
unsafe impl<T> Sync for Retained<T> {}

#[unsafe(link_section = ".uninit.last_words")]
static LAST_WORDS: Retained<LastWords> = Retained(UnsafeCell::new(LastWords::EMPTY));

#[unsafe(link_section = ".uninit.waiting")]
static WAITING_FAULTS: Retained<Waiting> = Retained(UnsafeCell::new(Waiting::EMPTY));

/// Queue of the faults that are not in the flash yet; `None` a second time.
pub fn waiting_faults() -> Option<&'static mut Waiting> {
    static TAKEN: AtomicBool = AtomicBool::new(false);
    if TAKEN.swap(true, Ordering::Relaxed) {
        return None;
    }
    // SAFETY: no other reference lives. Any bytes are a valid `Waiting`, which holds integers only
    // and validates its content by checksums.
    Some(unsafe { &mut *WAITING_FAULTS.0.get() })
}

/// Message of the image before this reset; the call clears it.
pub fn take_last_words() -> LastWords {
    cortex_m::interrupt::free(|_| {
        // SAFETY: interrupts are off and no other reference lives. Any bytes are a valid
        // `LastWords`, which holds integers only and validates its content by a checksum.
        core::mem::replace(unsafe { &mut *LAST_WORDS.0.get() }, LastWords::EMPTY)
    })
}

/// Number of periods of SysTick since the start.
static MILLISECONDS: AtomicU32 = AtomicU32::new(0);

/// Counts a period of SysTick, 1 ms, and returns the time in us, wrapping; for its handler.
#[inline(always)]
pub fn count_millisecond() -> u32 {
    let milliseconds = MILLISECONDS.load(Ordering::Relaxed).wrapping_add(1);
    MILLISECONDS.store(milliseconds, Ordering::Relaxed);
    milliseconds.wrapping_mul(1_000)
}

/// Time since the start in us, wrapping, also while the core sleeps; for handlers that SysTick does
/// not preempt. `core_clock` in Hz.
#[inline(always)]
pub fn microseconds(core_clock: u32) -> u32 {
    let mut milliseconds = MILLISECONDS.load(Ordering::Relaxed);
    let mut remaining = SYST::get_current();
    // A period that ended during this handler is not counted yet.
    if SCB::is_pendst_pending() {
        milliseconds = milliseconds.wrapping_add(1);
        remaining = SYST::get_current();
    }
    let passed = 999_u32.saturating_sub(remaining / (core_clock / 1_000_000));
    milliseconds.wrapping_mul(1_000).wrapping_add(passed)
}

/// Marks the RAM while the board has power; after power-on its content is arbitrary.
#[unsafe(link_section = ".uninit.running")]
static RUNNING: [AtomicU32; 4] = [const { AtomicU32::new(0) }; 4];
/// Value of the mark: 128 arbitrary bits.
const RUNNING_MARK: [u32; 4] = [0x6b62_616e, 0x9d8a_2e51, 0x1f3c_77e0, 0xc4d1_05b9];

/// Whether the RAM kept its mark from before this start; sets the mark.
pub fn remembers_running() -> bool {
    let mut was_running = true;
    for (word, mark) in RUNNING.iter().zip(RUNNING_MARK) {
        was_running &= word.load(Ordering::Relaxed) == mark;
        word.store(mark, Ordering::Relaxed);
    }
    was_running
}

fn keep(words: core::fmt::Arguments<'_>) {
    // SAFETY: only called with interrupts off by handlers that never return.
    unsafe { &mut *LAST_WORDS.0.get() }.keep(words);
}

#[panic_handler]
fn panic(information: &PanicInfo<'_>) -> ! {
    // Interrupts are switched off first: a sample in between could switch the drive on again.
    cortex_m::interrupt::disable();
    kband_drive_off();
    match information.location() {
        Some(place) => keep(format_args!(
            "{IDENTITY}: panic at {}:{}: {}",
            place.file(),
            place.line(),
            information.message()
        )),
        None => keep(format_args!("{IDENTITY}: panic: {}", information.message())),
    }
    kband_halt()
}

/// Hard fault, and every fault without its own handler. The stack may be the cause. So the handler
/// starts on a fresh stack and switches the drive off before it reads the old one.
#[unsafe(naked)]
#[unsafe(no_mangle)]
unsafe extern "C" fn HardFault() {
    naked_asm!(
        "mrs r4, MSP",
        "ldr r0, =_stack_start",
        "msr MSP, r0",
        "bl {off}",
        "mov r0, r4",
        "b {report}",
        off = sym hard_fault_off,
        report = sym hard_fault_report,
    )
}

extern "C" fn hard_fault_off() {
    kband_drive_off();
}

extern "C" fn hard_fault_report(stack: u32) -> ! {
    cortex_m::interrupt::disable();
    let (bottom, top) = stack_bounds();
    // SAFETY: reads of the fault status register have no effect.
    let status = unsafe { (*cortex_m::peripheral::SCB::PTR).cfsr.read() };
    if (bottom..top - 32).contains(&stack) && stack.is_multiple_of(4) {
        // SAFETY: within the stack and aligned. The core stacked eight words; the seventh is pc.
        let counter = unsafe { *((stack + 24) as *const u32) };
        keep(format_args!(
            "{IDENTITY}: hard fault at {counter:#010x}, status {status:#010x}"
        ));
    } else {
        keep(format_args!(
            "{IDENTITY}: hard fault with the stack at {stack:#010x}, status {status:#010x}"
        ));
    }
    kband_halt()
}

#[exception]
unsafe fn DefaultHandler(number: i16) -> ! {
    unexpected(number)
}

/// Switches the drive off, stores the exception's number as last words and ends the run.
pub fn unexpected(number: i16) -> ! {
    cortex_m::interrupt::disable();
    kband_drive_off();
    keep(format_args!("{IDENTITY}: unexpected interrupt {number}"));
    kband_halt()
}

/// Size of the guarded area below the RAM, bytes; writes there may be ignored without a fault.
const GUARDED: u32 = 64 * 1024;
/// Enable bit of a region's attributes (ARM DDI 0403E, B3.5.9); alone it permits no access.
const REGION_ON: u32 = 1;
/// Size field of the region's attributes: 2^(size + 1) bytes.
const REGION_SIZE: u32 = (GUARDED.trailing_zeros() - 1) << 1;
const NEVER_EXECUTED: u32 = 1 << 28;
/// Enables the protection and, outside its regions, the default memory map (B3.5.5).
const PROTECTION_ON: u32 = 1 | 1 << 2;

/// Forbids every access below the stack, so that a stack overflow faults at once.
pub fn guard_stack(protection: &cortex_m::peripheral::MPU) {
    let (bottom, _) = stack_bounds();
    // SAFETY: nothing of the program lies below the stack, which begins where the RAM does.
    unsafe {
        protection.rnr.write(0);
        protection.rbar.write(bottom - GUARDED);
        (protection.rasr).write(NEVER_EXECUTED | REGION_SIZE | REGION_ON);
        protection.ctrl.write(PROTECTION_ON);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

fn stack_bounds() -> (u32, u32) {
    unsafe extern "C" {
        static _stack_end: u32;
        static _stack_start: u32;
    }
    (&raw const _stack_end as u32, &raw const _stack_start as u32)
}

/// Largest use of the stack since the start, by its overwritten paint, and its size, bytes.
pub fn stack_use() -> (u32, u32) {
    let (bottom, top) = stack_bounds();
    let mut clean = bottom;
    while clean < top {
        // SAFETY: aligned words between the linker's bounds of the stack, down from its far end.
        let word = unsafe { (clean as *const u32).read_volatile() };
        if word != cortex_m_rt::STACK_PAINT_VALUE {
            break;
        }
        clean += 4;
    }
    (top - clean, top - bottom)
}

/// Number of stack bytes that were never used.
pub fn stack_free() -> u32 {
    let (used, size) = stack_use();
    size - used
}

/// Number of stack words that [`stack_low`] checks in a call.
const WORDS_PER_CHECK: u32 = 16;

/// Whether the stack's last eighth was ever used; 80 calls cover all of its words.
pub fn stack_low() -> bool {
    static NEXT_WORD: AtomicU32 = AtomicU32::new(0);
    static LOW: AtomicU32 = AtomicU32::new(0);
    let (bottom, top) = stack_bounds();
    let words = (top - bottom) / 8 / 4;
    let mut next = NEXT_WORD.load(Ordering::Relaxed);
    let mut low = LOW.load(Ordering::Relaxed);
    for _ in 0..WORDS_PER_CHECK {
        next = if next + 1 < words { next + 1 } else { 0 };
        // SAFETY: an aligned word between the linker's bounds of the stack, in its farthest eighth.
        let word = unsafe { ((bottom + 4 * next) as *const u32).read_volatile() };
        low |= word ^ cortex_m_rt::STACK_PAINT_VALUE;
    }
    NEXT_WORD.store(next, Ordering::Relaxed);
    LOW.store(low, Ordering::Relaxed);
    low != 0
}

/// State of one interrupt handler, stored before the interrupt is unmasked. The compiler cannot
/// encode `None` in a value within a [`Cell`]. So an empty one is all zeros, which take no flash.
pub struct Owned<T>(UnsafeCell<Option<Cell<T>>>);

// SAFETY: `put` and `get` require that only the handler uses it once it is unmasked.
unsafe impl<T: Send> Sync for Owned<T> {}

impl<T> Owned<T> {
    /// Builds it empty.
    pub const fn empty() -> Self {
        Self(UnsafeCell::new(None))
    }

    /// Stores `value` for the handler.
    ///
    /// # Safety
    /// The interrupt of the handler must be masked.
    pub unsafe fn put(&self, value: T) {
        // SAFETY: the handler cannot run, as the caller guarantees.
        unsafe { *self.0.get() = Some(Cell::new(value)) };
    }

    /// The handler's state.
    ///
    /// # Safety
    /// For one interrupt handler only, which must not hold it twice.
    #[allow(clippy::mut_from_ref)]
    #[inline]
    pub unsafe fn get(&self) -> Option<&mut T> {
        // SAFETY: no other reference exists, as the caller guarantees.
        unsafe { (*self.0.get()).as_mut().map(Cell::get_mut) }
    }
}
