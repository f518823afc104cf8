//! The emulated board: semihosting in place of pins.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use cortex_m::peripheral::{NVIC, SCB};
use cortex_m_rt::exception;
use cortex_m_semihosting::{debug, hio, hprintln, syscall1};
use embassy_executor::Spawner;
use embassy_stm32::interrupt;
use embassy_stm32::pac;
use embassy_time::Timer;
use kband_firmware::board::Watchdog;
use kband_firmware::cortex::{IDENTITY, stack_use, take_last_words};
use kband_firmware::start::Cause;
use kband_firmware::watch::{Roll, Watched};
use systick_timer::SystickDriver;

/// QEMU clocks the machine's SysTick at 168 MHz.
const CORE_CLOCK: u64 = 168_000_000;
/// Samples after which the emulated watchdog bites.
const WATCHDOG_SAMPLES: u32 = 5_000;

embassy_time_driver::time_driver_impl!(static TIME: SystickDriver<4> =
    SystickDriver::new(CORE_CLOCK, (CORE_CLOCK / 1_000 - 1) as u32));

static ROLL: Roll = Roll::of(&[Watched::Samples, Watched::Cycle]);
static HUNGRY: AtomicU32 = AtomicU32::new(0);
static HANG: AtomicBool = AtomicBool::new(false);

/// The emulated reset cause, in RAM that a reset leaves alone as the chip's register would be.
#[unsafe(link_section = ".uninit.cause")]
static CAUSE: AtomicU32 = AtomicU32::new(0);
/// Semihosting operation that gives the command line.
const GET_CMDLINE: usize = 0x15;
const CAUSE_WATCHDOG: u32 = 0x5744_4f47;
const CAUSE_SOFTWARE: u32 = 0x534f_4654;

#[unsafe(no_mangle)]
extern "Rust" fn kband_drive_off() {
    // A stream of its own: the one of `hprintln` has state that a fault may have left half-way.
    if let Ok(mut stream) = hio::hstdout() {
        // Nothing can be done about an emulator that does not listen.
        let _ = stream.write_all(b"drive off\n");
    }
}

#[unsafe(no_mangle)]
extern "Rust" fn kband_halt() -> ! {
    CAUSE.store(CAUSE_SOFTWARE, Ordering::Relaxed);
    SCB::sys_reset()
}

/// The watchdog as samples count it.
struct SampleWatchdog;

impl Watchdog for SampleWatchdog {
    fn feed(&mut self) {
        HUNGRY.store(0, Ordering::Relaxed);
    }
}

/// Time counted in samples; deadline in the emulator: none, for the next one waits.
#[interrupt]
fn TIM3() {
    pac::TIM3.sr().modify(|status| status.set_uif(false));
    ROLL.check_in(Watched::Samples);
    if HUNGRY.fetch_add(1, Ordering::Relaxed) >= WATCHDOG_SAMPLES {
        kband_drive_off();
        hprintln!("watchdog bites");
        CAUSE.store(CAUSE_WATCHDOG, Ordering::Relaxed);
        SCB::sys_reset();
    }
}

/// Counts milliseconds for the time driver.
#[exception]
fn SysTick() {
    TIME.systick_interrupt();
}

#[embassy_executor::task]
async fn cycle() {
    while !HANG.load(Ordering::Relaxed) {
        ROLL.check_in(Watched::Cycle);
        Timer::after_millis(1).await;
    }
    core::future::pending::<()>().await;
}

#[embassy_executor::task]
async fn supervise() {
    let mut watchdog = SampleWatchdog;
    let mut fed = 0;
    loop {
        if ROLL.complete() {
            watchdog.feed();
            fed += 1;
            if fed == 20 && !HANG.load(Ordering::Relaxed) {
                finish(true);
            }
        }
        Timer::after_millis(1).await;
    }
}

/// Recurses until the stack has left the RAM.
#[allow(unconditional_recursion)]
fn deepen(depth: u32) -> u32 {
    let room = core::hint::black_box([depth; 64]);
    deepen(depth + 1).wrapping_add(core::hint::black_box(room)[7])
}

fn finish(good: bool) -> ! {
    let (used, size) = stack_use();
    hprintln!("stack {} of {} bytes", used, size);
    debug::exit(if good {
        debug::EXIT_SUCCESS
    } else {
        debug::EXIT_FAILURE
    });
    loop {
        cortex_m::asm::wfi();
    }
}

/// The words after the image's name on the semihosting command line.
fn arguments(buffer: &mut [u8; 256]) -> &str {
    let mut request = [buffer.as_mut_ptr() as usize, buffer.len()];
    // SAFETY: SYS_GET_CMDLINE takes the address and length of a buffer that outlives the call, and
    // returns the length written in the second word.
    let failed = unsafe { syscall1(GET_CMDLINE, request.as_mut_ptr() as usize) } != 0;
    let length = if failed {
        0
    } else {
        request[1].min(buffer.len())
    };
    let line = core::str::from_utf8(&buffer[..length]).unwrap_or_default();
    line.split_once(' ').map_or("", |(_, rest)| rest.trim())
}

fn reset_cause() -> Cause {
    let cause = match CAUSE.load(Ordering::Relaxed) {
        CAUSE_WATCHDOG => Cause::Watchdog,
        CAUSE_SOFTWARE => Cause::Software,
        _ => Cause::Power,
    };
    CAUSE.store(0, Ordering::Relaxed);
    cause
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let mut buffer = [0; 256];
    let words = arguments(&mut buffer);
    let cause = reset_cause();
    hprintln!("kband {} {:?}", IDENTITY, cause);
    if cause != Cause::Power {
        take_last_words(|words| hprintln!("last words: {}", words.unwrap_or("none")));
        finish(false);
    }
    match words {
        "identity" => finish(true),
        "panic" => panic!("asked to"),
        "fault" => {
            // SAFETY: nothing is there: the read is meant to fault.
            let _ = unsafe { (0xF000_0000 as *const u32).read_volatile() };
        }
        "overflow" => {
            hprintln!("{}", deepen(0));
        }
        "stray" => NVIC::pend(pac::Interrupt::TIM2),
        "hang" => HANG.store(true, Ordering::Relaxed),
        _ => {}
    }
    if words == "stray" {
        // SAFETY: no critical section relies on this interrupt's mask.
        unsafe { NVIC::unmask(pac::Interrupt::TIM2) };
    }
    let Some(mut core) = cortex_m::Peripherals::take() else {
        finish(false)
    };
    TIME.start(&mut core.SYST);
    pac::TIM3.arr().write(|reload| reload.set_arr(4_999));
    pac::TIM3.dier().modify(|enable| enable.set_uie(true));
    pac::TIM3.cr1().modify(|control| control.set_cen(true));
    // SAFETY: no critical section relies on this interrupt's mask.
    unsafe { NVIC::unmask(pac::Interrupt::TIM3) };
    spawner.spawn(cycle().expect("spawned once"));
    spawner.spawn(supervise().expect("spawned once"));
    core::future::pending::<()>().await;
}
