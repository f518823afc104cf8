//! Instruction counts of the link's requests, and the delay that they cause to a sample.

use core::hint::black_box;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use cortex_m::peripheral::SYST;
use cortex_m_semihosting::heprintln;
use embassy_futures::block_on;
use kband_control::wire::{MAX_FRAME_BYTES, Request, write_question, write_request};
use kband_control::{Cycle, Inputs, Report, Settings, Signal, StartCause, State, Target};
use kband_firmware::link::{Image, Service};
use kband_firmware::station::Station;
use kband_firmware::store::Store;
use kband_plant::Bench;

use crate::count::{begin, instructions, lap};

/// Number of SysTick ticks between two samples of the trial: a prime, so that samples hit every
/// instruction.
const APART: u32 = 499;

/// Whether SysTick acts as the sample interrupt.
static SAMPLES: AtomicBool = AtomicBool::new(false);
/// Largest delay of a sample, ticks.
static LATE: AtomicU32 = AtomicU32::new(0);
/// Number of samples.
static TAKEN: AtomicU32 = AtomicU32::new(0);

/// Handles the trial's interrupt; returns whether it was one.
#[inline]
pub fn sample() -> bool {
    if !SAMPLES.load(Ordering::Relaxed) {
        return false;
    }
    let late = APART - SYST::get_current();
    LATE.fetch_max(late, Ordering::Relaxed);
    TAKEN.fetch_add(1, Ordering::Relaxed);
    true
}

/// Number of settings that a request of the bus writes at once: all but the bus's own.
const BUS_SETTINGS: usize = 40;

/// A request of Modbus to write the defaults of [`BUS_SETTINGS`] settings.
fn write_of_settings() -> [u8; 7 + 4 * BUS_SETTINGS] {
    let mut adu = [0; 7 + 4 * BUS_SETTINGS];
    let count = 2 * BUS_SETTINGS as u8;
    adu[..7].copy_from_slice(&[1, 16, 0, 100, 0, count, 2 * count]);
    let (values, _) = adu[7..].as_chunks_mut::<4>();
    for (bytes, value) in values.iter_mut().zip(Settings::default().values()) {
        *bytes = value.to_be_bytes();
    }
    adu
}

/// One request of each kind, the most expensive of its kind.
fn requests() -> [(&'static str, Request<'static>); 24] {
    let set = |key, value| Request::Set { key, value };
    [
        ("setting", Request::Setting(Settings::KEYS.len() as u8 - 1)),
        ("get", Request::Get("capture_attempts")),
        ("set", set("restitution_high", 0.24)),
        ("defaults", Request::Defaults),
        ("save", Request::Save),
        (
            "target locked",
            Request::Target(Target::Locked { order: 1 }),
        ),
        ("target chaotic", Request::Target(Target::Chaotic)),
        ("target k", Request::Target(Target::K(0.41))),
        ("target amplitude", Request::Target(Target::Amplitude(0.25))),
        ("target speed", Request::Target(Target::Speed(40.0))),
        ("target identify", Request::Target(Target::Identify)),
        ("target gear", Request::Target(Target::Gear { order: 1 })),
        ("held", Request::Held),
        ("enable", Request::Enable(true)),
        ("telemetry", Request::Telemetry(1)),
        ("event", Request::Event(0)),
        ("self-test", Request::SelfTest),
        ("counters", Request::Counters),
        ("last words", Request::LastWords),
        ("alive", Request::Alive),
        ("identification", Request::Identification),
        (
            "simulate",
            Request::Simulate {
                target: Target::Chaotic,
                start: StartCause::Ordinary,
            },
        ),
        (
            "samples",
            Request::Samples {
                codes: &[0; 240],
                end: None,
            },
        ),
        (
            "samples out of step",
            Request::Samples {
                codes: &[0xff; 240],
                end: Some(Inputs {
                    enable: true,
                    link_heard: true,
                    ..Inputs::default()
                }),
            },
        ),
    ]
}

/// Ends a drive cycle, so that the link may answer again.
fn end_cycle(service: &mut Service<impl Store>, station: &Station) {
    station.cycle(&Cycle::default(), Inputs::default());
    service.tick(station);
}

fn take(service: &mut Service<impl Store>, station: &Station, frame: &[u8]) {
    for &byte in frame {
        let answer = block_on(service.take(byte, station));
        black_box(answer);
    }
}

/// Counts each kind of request from its first byte to its answer. Then floods the link with all of
/// them and with invalid frames, while SysTick requests samples. Prints the largest delay of a
/// sample.
pub fn count(
    timer: &mut SYST,
    image: Image,
    store: impl Store,
    station: &Station,
    mut signal: Signal,
    bench: &mut Bench,
) {
    begin(timer);
    let mut service = Service::new(image, store, None);
    let mut frame = [0; MAX_FRAME_BYTES];
    let idle = (0..1000).map(|_| lap(&mut || ())).sum::<u32>() / 1000;
    let counted = |name: &str, service: &mut Service<_>, frame: &[u8]| {
        end_cycle(service, station);
        let ticks = lap(&mut || take(service, station, frame)).saturating_sub(idle);
        heprintln!(
            "request {}: {} bytes, {}",
            name,
            frame.len(),
            instructions(ticks) / 100
        );
    };
    if let Ok(question) = write_question(&mut frame, 1) {
        counted("who is there", &mut service, question);
    }
    for (name, request) in requests() {
        if let Ok(frame) = write_request(&mut frame, 1, &request) {
            counted(name, &mut service, frame);
        }
    }
    // The bus in control, so that its requests reach the settings.
    let mut set_bus = |service: &mut Service<_>, address, bus| {
        for request in [
            Request::set("bus", bus),
            Request::set("bus_address", address),
        ] {
            end_cycle(service, station);
            if let Ok(frame) = write_request(&mut frame, 1, &request) {
                take(service, station, frame);
            }
        }
        block_on(service.serve_bus(station));
    };
    set_bus(&mut service, 17.0, 2.0);
    let mut frame = [0; MAX_FRAME_BYTES];
    for (name, adu) in [
        ("bus read", &[1, 3, 0, 100, 0, 90][..]),
        ("bus write", &write_of_settings()),
    ] {
        if let Ok(frame) = write_request(&mut frame, 1, &Request::Bus(adu)) {
            counted(name, &mut service, frame);
        }
    }
    set_bus(&mut service, 0.0, 0.0);
    counted("oversized", &mut service, &[1; 2 * MAX_FRAME_BYTES]);
    let mut corrupt = [1; 250];
    corrupt[249] = 0;
    counted("corrupt", &mut service, &corrupt);
    // `Defaults` ended in fault 8, which lasts until settings are saved.
    station.saved();
    timer.set_reload(APART);
    timer.clear_current();
    // At rest, where settings may change, then with the drive on.
    for (state, enable) in [("at rest", false), ("while the drive runs", true)] {
        LATE.store(0, Ordering::Relaxed);
        TAKEN.store(0, Ordering::Relaxed);
        for (_, request) in requests().iter().cycle().take(30 * requests().len()) {
            let report = drive(&mut signal, bench, station, enable);
            service.tick(station);
            // `Defaults` would end in fault 8 again.
            let stops = !enable && matches!(request, Request::Defaults);
            if stops || !enable && !matches!(report.state, State::Off) {
                continue;
            }
            if let Ok(frame) = write_request(&mut frame, 1, request) {
                SAMPLES.store(true, Ordering::Relaxed);
                timer.enable_interrupt();
                take(&mut service, station, frame);
                timer.disable_interrupt();
                SAMPLES.store(false, Ordering::Relaxed);
            }
        }
        heprintln!(
            "sample waits for the link {}: most {} in {} samples",
            state,
            instructions(LATE.load(Ordering::Relaxed)) / 100,
            TAKEN.load(Ordering::Relaxed)
        );
    }
}

/// Runs one drive cycle.
fn drive(signal: &mut Signal, bench: &mut Bench, station: &Station, enable: bool) -> Report {
    loop {
        let before = signal.phase();
        let sampled = signal.sample(bench.sample());
        bench.hold(sampled.output, (signal.phase() - before).bits());
        if sampled.wrapped {
            let inputs = Inputs {
                enable,
                ..Inputs::default()
            };
            let report = station.simulated_cycle(signal.cycle(), inputs);
            signal.command(report.command);
            return report;
        }
    }
}
