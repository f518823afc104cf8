//! Instruction counts of the sample interrupt, the control of a cycle, and the plans of capture and
//! gear.

use core::hint::black_box;
use core::sync::atomic::{AtomicU16, Ordering};
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_semihosting::{heprint, heprintln};
use kband_control::{AdcCode, Command, Settings, Signal, Target, phase_step};
use kband_firmware::application::Sampler;
use kband_firmware::board::{Drive, Sense};
use kband_firmware::exchange::Exchange;
use kband_firmware::station::Station;
use kband_plant::Bench;

/// Full range of SysTick: 16.7 million ticks, 99 million instructions.
const FULL: u32 = 0x00ff_ffff;
/// Number of counted drive cycles, after as many uncounted ones.
const CYCLES: u32 = 20;

static EXCHANGE: Exchange = Exchange::empty();

static READING: AtomicU16 = AtomicU16::new(0);

struct Reading;

impl Sense for Reading {
    fn sample(&mut self) -> AdcCode {
        AdcCode(READING.load(Ordering::Relaxed))
    }

    fn current(&mut self) -> AdcCode {
        self.sample()
    }
}

struct LastOutput(f32);

impl Drive for LastOutput {
    fn set(&mut self, output: f32) {
        self.0 = black_box(output);
    }

    fn off(&mut self) {
        self.0 = black_box(0.0);
    }
}

/// Hundredths of instructions in ticks: an instruction takes 1 ns, a tick 1000/168 ns.
fn instructions(ticks: u32) -> u64 {
    u64::from(ticks) * 100_000 / 168
}

fn begin(timer: &mut SYST) {
    timer.set_clock_source(SystClkSource::Core);
    timer.set_reload(FULL);
    timer.clear_current();
    timer.enable_counter();
}

fn lap(work: &mut dyn FnMut()) -> u32 {
    let before = SYST::get_current();
    work();
    before.wrapping_sub(SYST::get_current()) & FULL
}

/// Counts the plan for gear slice by slice: for the trial's lot, and for parts that soon lose gear.
#[inline(never)]
fn count_gear(station: &Station) {
    let (settings, target) = (station.settings(), station.target());
    let lot = (settings.restitution_low, settings.restitution_high);
    for (name, lot, scatter, [second_tone, third_tone]) in [
        ("the lot of the trial", lot, 0.05, [0.0; 2]),
        ("lively parts", (0.5, 0.7), 0.1, [0.0; 2]),
        ("lively parts on two tones", (0.5, 0.7), 0.1, [0.25, 0.0]),
        ("lively parts on three tones", (0.5, 0.7), 0.1, [0.3, 0.06]),
    ] {
        let accepted = station.set_settings(&Settings {
            restitution_low: lot.0,
            restitution_high: lot.1,
            scatter,
            second_tone,
            third_tone,
            ..settings
        });
        let asked = station.set_target(Target::Gear { order: 1 });
        if accepted.is_err() || asked.is_err() {
            return;
        }
        heprint!("gear of {}: ", name);
        count_plan(station);
    }
    let _ = station.set_settings(&settings);
    let _ = station.set_target(target);
}

/// Counts a search, slice by slice as the control task runs it.
fn count_plan(station: &Station) {
    let (mut sum, mut longest, mut slices, mut more) = (0, 0, 0, true);
    while more && slices <= 100_000 {
        let ticks = lap(&mut || more = black_box(station.plan_step()));
        sum += instructions(ticks) / 100;
        longest = longest.max(ticks);
        slices += 1;
    }
    heprintln!(
        "{} instructions in {} slices, most {}",
        sum,
        slices,
        instructions(longest) / 100
    );
}

/// Counts the plans, the control of each cycle on the way to a lively state, and the sample
/// interrupt over whole cycles. Prints mean and maximum.
///
/// Each sample is counted alone, without the bench. The maximum is exact to the counter's step of
/// six instructions, the mean to a sixtieth of one.
pub fn count(timer: &mut SYST, mut signal: Signal, station: &Station, mut bench: Bench) {
    begin(timer);
    count_gear(station);
    heprint!("capture plan: ");
    count_plan(station);
    // Closed loop to a lively state: drive on, parts in flight.
    let mut cycles = 0_u32;
    let (mut control, mut max_ticks) = (0_u64, 0);
    while cycles < 60 {
        let before = signal.phase();
        let sampled = signal.sample(bench.sample());
        bench.hold(sampled.output, (signal.phase() - before).bits());
        if sampled.wrapped {
            let mut command = None;
            let ticks = lap(&mut || {
                let report = station.simulated_cycle(signal.cycle(), bench.inputs());
                command = Some(black_box(report.command));
            });
            control += instructions(ticks) / 100;
            max_ticks = max_ticks.max(ticks);
            if let Some(command) = command {
                signal.command(command);
                EXCHANGE.command(command);
            }
            cycles += 1;
        }
    }
    heprintln!(
        "control: mean {} most {}",
        control / u64::from(cycles),
        instructions(max_ticks) / 100
    );
    count_samples("", signal, &mut bench);
    for (name, tones, current_sensitivity) in [
        (" of two tones", [0.15, 0.0], 0.0),
        (" of three tones", [0.15, 0.05], 0.0),
        (" with a current sensor", [0.0; 2], 0.1),
    ] {
        if let Some(path) = changed(station, tones, current_sensitivity) {
            count_samples(name, path, &mut bench);
        }
    }
}

fn changed(station: &Station, tones: [f32; 2], current_sensitivity: f32) -> Option<Signal> {
    let mut settings = station.settings();
    [settings.second_tone, settings.third_tone] = tones;
    settings.current_sensitivity = current_sensitivity;
    let mut path = Signal::build(&settings).ok()?;
    path.command(Command {
        amplitude: 0.25,
        overtones: [[0.05; 2]; 2],
        step: phase_step(settings.frequency),
        ..Command::default()
    });
    Some(path)
}

#[inline(never)]
fn count_samples(name: &str, signal: Signal, bench: &mut Bench) {
    let mut cycles = 0;
    let empty = (0..1000).map(|_| lap(&mut || ())).sum::<u32>();
    let mut path = signal.clone();
    let mut sampler = Sampler::new(signal, Reading, LastOutput(0.0), &EXCHANGE);
    let (mut sum, mut max_ticks, mut samples) = (0, 0, 0_u32);
    while cycles < CYCLES {
        let code = black_box(bench.sample());
        let sampled = path.sample_with(code, || code);
        READING.store(code.0, Ordering::Relaxed);
        let ticks = lap(&mut || sampler.interrupt());
        sum += ticks;
        max_ticks = max_ticks.max(ticks);
        samples += 1;
        bench.hold(sampled.output, 10_737_418);
        cycles += u32::from(sampled.wrapped);
    }
    let idle = instructions(empty) / 1000;
    let mean = (instructions(sum) / u64::from(samples)).saturating_sub(idle) / 100;
    let peak = instructions(max_ticks).saturating_sub(idle) / 100;
    heprintln!("sample interrupt{}: mean {} most {}", name, mean, peak);
}
