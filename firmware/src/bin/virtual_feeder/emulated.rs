//! The emulated board: the bench replaces converter and power stage, semihosting replaces pins.

use crate::count::count;
use crate::flash::FlashFile;
use crate::serial::{self, Serial};
use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering};
use cortex_m::peripheral::NVIC;
use cortex_m_rt::exception;
use cortex_m_semihosting::{debug, heprintln, syscall1};
use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_futures::block_on;
use embassy_stm32::{interrupt, pac};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::{Instant, Timer};
use kband::feeder::OutOfRange;
use kband_control::wire::{Pin, SetUp};
use kband_control::{AdcCode, Inputs, Report, Signal, Target};
use kband_firmware::application::{Sampler, control};
use kband_firmware::board::{Drive, Panel, Sense};
use kband_firmware::bus::bus;
use kband_firmware::bus::uart::{self, Uart};
use kband_firmware::exchange::Exchange;
use kband_firmware::hardware::cortex::{
    IDENTITY, Owned, count_millisecond, microseconds, stack_free, stack_low, stack_use,
    take_last_words,
};
use kband_firmware::hardware::log;
use kband_firmware::link::{Image, Service, link};
use kband_firmware::start::ResetCause;
use kband_firmware::station::Station;
use kband_firmware::storage::last_words::LastWords;
use kband_firmware::storage::store::{LoadedSettings, Records};
use kband_firmware::storage::waiting::Waiting;
use kband_firmware::trial::{TraceRow, Trial};
use kband_firmware::watch::Watched;
use kband_plant::{Bench, Scene};
use static_cell::StaticCell;
use systick_timer::SystickDriver;

/// SysTick's clock in QEMU's machine, Hz.
const CORE_CLOCK: u64 = 168_000_000;
/// Clock of UART4, Hz. The emulated line has no rate.
const BUS_CLOCK: u32 = 42_000_000;
/// Factor by which silence on the emulated line is longer: a busy desk delays bytes by some ms.
const BUS_SLOWNESS: u32 = 16;
/// Largest number of samples in a millisecond: the board's sample rate.
const SAMPLES_A_MILLISECOND: u32 = 20;
/// Number of samples until the emulated watchdog ends the run: one second of emulated time.
const WATCHDOG_SAMPLES: u32 = 20_000;
const GET_CMDLINE: usize = 0x15;

embassy_time_driver::time_driver_impl!(static TIME: SystickDriver<4> =
    SystickDriver::new(CORE_CLOCK, (CORE_CLOCK / 1_000 - 1) as u32));

defmt::timestamp!("{=u64:ms}", Instant::now().as_millis());

static EXCHANGE: Exchange = Exchange::empty();
static STATION: StaticCell<Station> = StaticCell::new();
static UNFED_SAMPLES: AtomicU32 = AtomicU32::new(0);
static SAMPLER: Owned<Sampler<Bed, Bed>> = Owned::empty();
static BENCH: Mutex<CriticalSectionRawMutex, RefCell<Option<(Bench, f32)>>> =
    Mutex::new(RefCell::new(None));

/// Nothing to switch: the samples, which end with the run, hold the bench.
#[unsafe(no_mangle)]
extern "Rust" fn kband_drive_off() {}

#[unsafe(no_mangle)]
extern "Rust" fn kband_halt() -> ! {
    let words = take_last_words();
    heprintln!("last words: {}", words.read().unwrap_or_default());
    finish(false)
}

const IMAGE: Image = Image {
    identity: IDENTITY,
    stack_free,
    set_up: SetUp::default,
    // The emulated line accepts each byte at once.
    line_rate: u32::MAX,
    strapped: || false,
    slot: None,
};

struct Bed;

impl Bed {
    fn with<T>(work: impl FnOnce(&mut Bench, &mut f32) -> T) -> Option<T> {
        BENCH.lock(|cell| cell.borrow_mut().as_mut().map(|(b, o)| work(b, o)))
    }
}

impl Sense for Bed {
    fn sample(&mut self) -> AdcCode {
        Self::with(|bench, _| bench.sample()).unwrap_or_default()
    }

    fn current(&mut self) -> AdcCode {
        Self::with(|bench, _| bench.current()).unwrap_or_default()
    }
}

impl Drive for Bed {
    fn set(&mut self, output: f32) {
        Self::with(|_, value| *value = output);
    }

    fn off(&mut self) {
        Self::with(|_, value| *value = 0.0);
    }
}

impl Panel for Bed {
    fn inputs(&mut self) -> Inputs {
        let mut inputs = Self::with(|bench, _| bench.inputs()).unwrap_or_default();
        inputs.stack_low |= stack_low();
        inputs
    }

    fn new_target(&mut self) -> Option<Target> {
        Self::with(|bench, _| bench.new_target()).flatten()
    }
}

/// Prints a row of the trace and ends the run after the last of `remaining` rows; `None` prints
/// nothing and runs on.
fn trace(report: &Report, remaining: &mut Option<u32>) {
    log::report(report);
    if let Some(remaining) = remaining {
        heprintln!("{}", TraceRow(report));
        *remaining -= 1;
        if *remaining == 0 {
            finish(true);
        }
    }
}

/// Memory of the settings: a file of the desk. Without one each start is the first.
type Memory = Records<FlashFile, Waiting>;

/// Takes one sample. In the emulator it has no deadline: the next sample waits.
fn sample() {
    if UNFED_SAMPLES.fetch_add(1, Ordering::Relaxed) >= WATCHDOG_SAMPLES {
        cortex_m::interrupt::disable();
        heprintln!("watchdog bites");
        finish(false);
    }
    // A pause of the samples is not a failure, so the interrupt checks in.
    EXCHANGE.roll.check_in(Watched::Samples);
    if EXCHANGE.is_unfinished() {
        return;
    }
    // SAFETY: only this handler calls it, once.
    if let Some(sampler) = unsafe { SAMPLER.get() } {
        let before = sampler.phase();
        sampler.interrupt();
        let step = (sampler.phase() - before).bits();
        Bed::with(|bench, value| bench.hold(*value, step));
    }
}

#[exception]
fn SysTick() {
    TIME.systick_interrupt();
    EXCHANGE.bus.poll(count_millisecond() / BUS_SLOWNESS);
    for _ in 0..SAMPLES_A_MILLISECOND {
        sample();
    }
}

#[interrupt]
fn UART4() {
    let now = microseconds(CORE_CLOCK as u32) / BUS_SLOWNESS;
    uart::interrupt(&EXCHANGE.bus, now);
}

#[embassy_executor::task]
async fn fieldbus(station: &'static Station) {
    let port = Uart::with_clock(&EXCHANGE.bus, BUS_CLOCK);
    bus(port, station, IDENTITY).await;
}

#[embassy_executor::task]
async fn drive_cycle(station: &'static Station, mut rows: Option<u32>) {
    let observe = |report: &Report, _| trace(report, &mut rows);
    control(station, Bed, observe).await;
}

#[embassy_executor::task]
async fn desk_link(station: &'static Station, memory: Memory, pin: Option<Pin>) {
    let mut service = Service::new(IMAGE, memory, pin);
    link(&mut service, Serial, station).await;
}

#[embassy_executor::task]
async fn supervise() {
    loop {
        if EXCHANGE.roll.complete() {
            UNFED_SAMPLES.store(0, Ordering::Relaxed);
        }
        Timer::after_millis(10).await;
    }
}

fn finish(passed: bool) -> ! {
    let (used, size) = stack_use();
    heprintln!("stack {} of {} bytes", used, size);
    debug::exit(if passed {
        debug::EXIT_SUCCESS
    } else {
        debug::EXIT_FAILURE
    });
    loop {
        cortex_m::asm::wfi();
    }
}

/// Arguments after the image's name on the semihosting command line.
fn arguments(buffer: &mut [u8; 256]) -> &str {
    let mut request = [buffer.as_mut_ptr() as usize, buffer.len()];
    // SAFETY: SYS_GET_CMDLINE takes the address and length of a buffer that outlives the call, and
    // returns the length written in the second word.
    let failed = unsafe { syscall1(GET_CMDLINE, request.as_mut_ptr() as usize) } != 0;
    let length = if failed { 0 } else { request[1] };
    let line = core::str::from_utf8(&buffer[..length.min(buffer.len())]).unwrap_or_default();
    line.split_once(' ').map_or("", |(_, rest)| rest.trim())
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    begin(spawner);
    core::future::pending::<()>().await;
}

/// Builds the station in its static memory, and its signal path. A separate call builds each large
/// part, so that their stack use does not add up.
#[inline(never)]
fn place(loaded: &LoadedSettings) -> Result<(&'static Station, Signal), OutOfRange> {
    let controller = Station::controller(loaded, ResetCause::Power.start())?;
    let station =
        STATION.init_with(|| Station::new(loaded, &controller, &EXCHANGE, LastWords::EMPTY));
    Ok((station, Signal::build(&loaded.settings)?))
}

#[inline(never)]
fn place_bench(scene: &Scene) -> Result<(), OutOfRange> {
    let bench = Bench::build(scene)?;
    BENCH.lock(|cell| cell.replace(Some((bench, 0.0))));
    Ok(())
}

#[inline(never)]
fn count_with_bench(core: &mut cortex_m::Peripherals, signal: Signal, station: &Station) -> ! {
    if let Some((bench, _)) = BENCH.lock(RefCell::take) {
        count(&mut core.SYST, signal, station, bench);
    }
    finish(true)
}

/// Builds the sample interrupt in its static memory.
#[inline(never)]
fn place_sampler(signal: Signal) {
    // SAFETY: SysTick, which takes the samples, does not run yet.
    unsafe { SAMPLER.put(Sampler::new(signal, Bed, Bed, &EXCHANGE)) };
}

/// Starts everything. In `main`, the future would keep the space of each local for the whole run.
#[inline(never)]
fn begin(spawner: Spawner) {
    let mut buffer = [0; 256];
    let words = arguments(&mut buffer);
    let (word, file) = words.split_once(' ').unwrap_or((words, ""));
    heprintln!("kband {}", IDENTITY);
    log::start(ResetCause::Power, &LastWords::EMPTY);
    let trial = Trial::named(if word == "count" { "default" } else { word });
    let Some((trial, mut core)) = trial.zip(cortex_m::Peripherals::take()) else {
        heprintln!("no trial {}", word);
        finish(false);
    };
    let scene = (trial.scene)();
    let memory = FlashFile::open(file).ok().and_then(|flash| {
        let [settings, faults] = flash.ranges();
        Records::new(flash, settings, faults, Waiting::EMPTY, || true).ok()
    });
    let Some(mut memory) = memory else {
        heprintln!("no flash in {}", file);
        finish(false);
    };
    let loaded = if file.is_empty() {
        LoadedSettings::whole(scene.settings, scene.target)
    } else {
        block_on(memory.load())
    };
    let built = place(&loaded).and_then(|placed| place_bench(&scene).map(|()| placed));
    let (station, signal) = built.unwrap_or_else(|refusal| {
        // The rejected value is left out: printing a float costs 15 KiB of flash.
        heprintln!("{}: {} is accepted", refusal.parameter, refusal.accepted);
        finish(false)
    });
    if word == "count" {
        count_with_bench(&mut core, signal, station);
    }
    place_sampler(signal);
    TIME.start(&mut core.SYST);
    let linked = matches!(word, "link" | "run");
    if linked {
        serial::start();
        // SAFETY: no critical section relies on this interrupt's mask.
        unsafe { NVIC::unmask(pac::Interrupt::UART4) };
        spawner.spawn(desk_link(station, memory, loaded.pin).expect("spawned once"));
        spawner.spawn(fieldbus(station).expect("spawned once"));
    }
    let rows = (!linked).then_some(trial.cycles);
    spawner.spawn(drive_cycle(station, rows).expect("spawned once"));
    spawner.spawn(supervise().expect("spawned once"));
}
