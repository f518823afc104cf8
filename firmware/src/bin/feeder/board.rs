//! The board: connects pins and peripherals to the application.

use crate::chip::Board;
use core::sync::atomic::{AtomicU32, Ordering};
use cortex_m::peripheral::scb::SystemHandler;
use cortex_m::peripheral::{DWT, NVIC, SCB};
use cortex_m_rt::exception;
use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_stm32::peripherals::USART2;
use embassy_stm32::usart::BufferedInterruptHandler;
use embassy_stm32::{bind_interrupts, interrupt, pac};
use embassy_time::{Instant, Timer};
use kband_control::wire::SetUp;
use kband_control::{Controller, Cycle, Report, SAMPLE_RATE, Settings, Signal, StartCause};
use kband_firmware::application::{Sampler, control};
use kband_firmware::board::Panel;
use kband_firmware::bus::bus;
use kband_firmware::bus::uart::{self, Uart};
use kband_firmware::exchange::Exchange;
use kband_firmware::hardware::chip::Chip;
use kband_firmware::hardware::cortex::{
    IDENTITY, Owned, count_millisecond, guard_stack, microseconds, stack_free, stack_use,
    take_last_words,
};
use kband_firmware::hardware::log;
use kband_firmware::hardware::stm32::{
    Converter, HalfBridge, LINE_RATE, Lamps, Serial, Terminals, count_sample, drive_off,
    feed_watchdog, image_is_valid, pull_inputs_up, recipe_inputs, start_watchdog, strapped,
};
use kband_firmware::inputs::selector::Selector;
use kband_firmware::link::{Image, Service, link};
use kband_firmware::start::ResetCause;
use kband_firmware::station::Station;
use kband_firmware::storage::last_words::LastWords;
use kband_firmware::storage::resets::{GOOD_OPERATION_S, Resets};
use kband_firmware::storage::store::{Condition, LoadedSettings};
use kband_firmware::storage::waiting::Waiting;
use static_cell::{ConstStaticCell, StaticCell};
use systick_timer::SystickDriver;

embassy_time_driver::time_driver_impl!(static TIME: SystickDriver<4> =
    SystickDriver::new(Board::CORE_CLOCK as u64, Board::CORE_CLOCK / 1_000 - 1));

defmt::timestamp!("{=u64:ms}", Instant::now().as_millis());

/// The loader at the start of the flash, with an erased key if it has one. The chip starts the
/// loader, and the loader starts this program.
#[used]
#[unsafe(link_section = ".loader")]
static LOADER: [u8; LOADER_BYTES.len()] = *LOADER_BYTES;
const LOADER_BYTES: &[u8; include_bytes!(concat!(env!("OUT_DIR"), "/loader.bin")).len()] =
    include_bytes!(concat!(env!("OUT_DIR"), "/loader.bin"));

/// Priority of interrupts that a sample may delay: the middle of the range.
const LOW_PRIORITY: u8 = 0x80;

type LinkService = Service<<Board as Chip>::Flash, &'static mut Waiting>;

static STATION: StaticCell<Station> = StaticCell::new();
static SERVICE: StaticCell<LinkService> = StaticCell::new();
/// Send and receive buffer of the link's port.
static BUFFERS: ConstStaticCell<[[u8; 512]; 2]> = ConstStaticCell::new([[0; 512]; 2]);

bind_interrupts!(struct Interrupts {
    USART2 => BufferedInterruptHandler<USART2>;
});

static EXCHANGE: Exchange = Exchange::empty();
static SELECTOR: Selector = Selector::open();
static SAMPLER: Owned<Sampler<Converter, HalfBridge>> = Owned::empty();
/// Count of successive resets, in RAM that a reset does not change.
#[unsafe(link_section = ".uninit.resets")]
static RESETS: Resets = Resets::none();
/// Longest sample interrupt, core cycles.
static LONGEST_SAMPLE: AtomicU32 = AtomicU32::new(0);

#[unsafe(no_mangle)]
extern "Rust" fn kband_drive_off() {
    drive_off();
}

#[unsafe(no_mangle)]
extern "Rust" fn kband_halt() -> ! {
    SCB::sys_reset()
}

/// Takes one sample, in the interrupt that ends its conversion.
///
/// Deadline: 50 us, the next sample. Measured: 171 instructions, 700 at the end of a cycle.
///
/// # Safety
/// Only for the converter's interrupt handler.
#[inline]
pub unsafe fn sample() {
    // SAFETY: one handler calls it once, as the caller guarantees.
    if let Some(sampler) = unsafe { SAMPLER.get() } {
        let began = DWT::cycle_count();
        sampler.interrupt();
        count_sample();
        let duration = DWT::cycle_count().wrapping_sub(began);
        if duration > LONGEST_SAMPLE.load(Ordering::Relaxed) {
            LONGEST_SAMPLE.store(duration, Ordering::Relaxed);
        }
    }
}

/// Counts milliseconds for the time driver. Deadline: 1 ms; a missed one delays the clock.
#[exception]
fn SysTick() {
    TIME.systick_interrupt();
    SELECTOR.sample(recipe_inputs());
    EXCHANGE.bus.poll(count_millisecond());
}

#[interrupt]
fn UART4() {
    uart::interrupt(&EXCHANGE.bus, microseconds(Board::CORE_CLOCK));
}

#[embassy_executor::task]
async fn drive_cycle(station: &'static Station, terminals: Terminals, mut lamps: Lamps) {
    let observe = |report: &Report, ready| lamps.report(report, ready);
    control(station, terminals, observe).await;
}

#[embassy_executor::task]
async fn desk_link(service: &'static mut LinkService, serial: Serial, station: &'static Station) {
    link(service, serial, station).await;
}

#[embassy_executor::task]
async fn fieldbus(port: Uart, station: &'static Station) {
    bus(port, station, IDENTITY).await;
}

#[embassy_executor::task]
async fn supervise() {
    loop {
        if EXCHANGE.roll.complete() {
            feed_watchdog();
            if Instant::now().as_secs() >= GOOD_OPERATION_S {
                RESETS.clear();
            }
        }
        Timer::after_millis(20).await;
    }
}

/// Stays at rest, without samples, after repeated resets or with a damaged image. A clock paces the
/// controller for link, lamps and acknowledgement. An acknowledged fault restarts the board.
#[embassy_executor::task]
async fn stay_at_rest(station: &'static Station, mut terminals: Terminals, mut lamps: Lamps) {
    loop {
        feed_watchdog();
        let frequency = station.settings().frequency;
        let cycle = Cycle {
            samples: (SAMPLE_RATE as f32 / frequency) as u16,
            ..Cycle::default()
        };
        if let Some(report) = station.cycle(&cycle, terminals.inputs()) {
            lamps.report(&report, false);
            if report.fault.is_none() {
                restart();
            }
        }
        Timer::after_millis((1000.0 / frequency) as u64).await;
    }
}

/// Restarts the board; the next start is not a fault.
fn restart() {
    RESETS.acknowledge();
    SCB::sys_reset();
}

/// Builds the station in its static memory. A separate call builds each large part: their stack use
/// does not add up, and the future of `main` stays small.
#[inline(never)]
fn place(
    loaded: &LoadedSettings,
    start: StartCause,
    last_words: LastWords,
) -> Option<&'static Station> {
    match &Station::controller(loaded, start) {
        Ok(controller) => Some(place_station(loaded, controller, last_words)),
        Err(_) => None,
    }
}

#[inline(never)]
fn place_station(
    loaded: &LoadedSettings,
    controller: &Controller,
    last_words: LastWords,
) -> &'static Station {
    let place = STATION.uninit();
    place.write(Station::new(loaded, controller, &EXCHANGE, last_words))
}

/// Builds the sample interrupt in its static memory.
#[inline(never)]
fn place_sampler(settings: &Settings, converter: Converter, bridge: HalfBridge) -> Option<()> {
    let signal = Signal::build(settings).ok()?;
    // SAFETY: the sample interrupt is still masked.
    unsafe { SAMPLER.put(Sampler::new(signal, converter, bridge, &EXCHANGE)) };
    Some(())
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let cause = ResetCause::of(Board::signs());
    let mut start = RESETS.start(cause);
    // Before the first wait.
    start_watchdog();
    let slot = Board::slot(restart);
    // An update restarted the board, which is not a fault.
    if slot.on_trial() {
        start = StartCause::PowerOn;
    }
    let Some(mut core) = cortex_m::Peripherals::take() else {
        defmt::panic!("the core's peripherals are taken");
    };
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
    guard_stack(&core.MPU);
    let (p, clocks_ok) = Board::start();
    feed_watchdog();
    let last_words = take_last_words();
    log::start(cause, &last_words);
    let bridge = HalfBridge::new(
        p.TIM1,
        p.PA8,
        p.PA7,
        p.DAC1,
        p.PA4,
        p.PB12,
        p.PC3,
        Board::supply_allows,
        Board::CORE_CLOCK,
    );
    Board::watch(clocks_ok);
    if !image_is_valid() {
        defmt::error!("the flash does not hold the image that was written: the drive stays off");
        start = StartCause::ImageDamaged;
    }
    feed_watchdog();
    if !clocks_ok {
        defmt::error!("the crystal does not swing at its frequency: the drive stays off");
    }
    // Before the first sample, which reads the enable input.
    let terminals = Terminals::new(p.PB0, p.PB1, Board::supply_low, !clocks_ok, || {
        SELECTOR.selected()
    });
    pull_inputs_up(p.PC1, p.PC6, p.PC7, p.PC8);
    let (adc, sample_time) = Board::converter(p.ADC1);
    let converter = Converter::new(adc, p.PA1, p.PC0, sample_time);
    let Ok(mut memory) = Board::memory(p.FLASH) else {
        defmt::panic!("the memory of the settings does not fit its pages");
    };
    let loaded = memory.load().await;
    feed_watchdog();
    match loaded.condition {
        Condition::Whole => defmt::info!("settings: as saved"),
        Condition::Never => defmt::warn!("settings: none were ever saved"),
        Condition::Lost => defmt::error!("settings: damaged, or another firmware's"),
        Condition::Newer => defmt::error!("settings: a newer firmware's, left as they are"),
    }
    log::new_settings(loaded.added);
    // A target that only an older firmware accepted counts as lost settings. The link must still
    // answer.
    let (loaded, station) = match place(&loaded, start, last_words) {
        Some(station) => (loaded, Some(station)),
        None => {
            let lost = LoadedSettings::none(Condition::Lost);
            (lost, place(&lost, start, last_words))
        }
    };
    let (Some(station), Some(())) = (station, place_sampler(&loaded.settings, converter, bridge))
    else {
        defmt::panic!("settings that were accepted are refused");
    };
    let Ok(serial) = Serial::new(p.USART2, p.PA3, p.PA2, Interrupts, BUFFERS.take()) else {
        defmt::panic!("the serial port does not take its rate");
    };
    let fieldbus_port = Uart::new(&EXCHANGE.bus, p.UART4, p.PC10, p.PC11, p.PC12);
    TIME.start(&mut core.SYST);
    // The sample has the highest priority.
    // SAFETY: no critical section relies on the priority or the mask of these interrupts.
    unsafe {
        core.SCB.set_priority(SystemHandler::SysTick, LOW_PRIORITY);
        core.NVIC.set_priority(pac::Interrupt::USART2, LOW_PRIORITY);
        core.NVIC.set_priority(pac::Interrupt::UART4, LOW_PRIORITY);
        NVIC::unmask(pac::Interrupt::UART4);
        core.NVIC.set_priority(Board::CONVERTED, 0);
    }
    let rests = matches!(start, StartCause::Repeated | StartCause::ImageDamaged);
    if !rests {
        // SAFETY: no critical section relies on the mask of this interrupt.
        unsafe { NVIC::unmask(Board::CONVERTED) };
        // From here a missing sample resets the chip.
        Board::start_window();
    }
    let image = Image {
        identity: IDENTITY,
        stack_free,
        set_up: || SetUp {
            sample: LONGEST_SAMPLE.load(Ordering::Relaxed),
            ..Board::set_up()
        },
        line_rate: LINE_RATE,
        strapped,
        slot: Some(slot),
    };
    let lamps = Lamps::new(p.PC2, p.PB11);
    let service = SERVICE.init(Service::new(image, memory, loaded.pin));
    spawner.spawn(desk_link(service, serial, station).expect("spawned once"));
    spawner.spawn(fieldbus(fieldbus_port, station).expect("spawned once"));
    if rests {
        spawner.spawn(stay_at_rest(station, terminals, lamps).expect("spawned once"));
    } else {
        spawner.spawn(drive_cycle(station, terminals, lamps).expect("spawned once"));
        spawner.spawn(supervise().expect("spawned once"));
    }
    loop {
        Timer::after_secs(60).await;
        let (used, size) = stack_use();
        defmt::info!(
            "stack {} of {} bytes, {} cycles missed",
            used,
            size,
            EXCHANGE.missed()
        );
    }
}
