//! Fault scenarios of `docs/safety.md` on the flashed image. Each must end with a smaller amplitude
//! or with the bridge open.

use kband_control::wire::{Refusal, Request, Response, SavedSettings, crc32};
use kband_control::{Fault, Target};
use kband_machines::chip::clocks::Cause;
use kband_machines::chip::gpio::Mode;
use kband_machines::chip::kind::Kind;
use kband_machines::chip::world::Event;
use kband_machines::chip::{Chip, Hang, LINK, MILLISECOND, SAMPLE, flash};
use kband_machines::draw::Draw;
use kband_machines::hazards::{
    ENABLE_TIME, Hazard, Outcome, REST_TIME, drive_on_follows_the_bridge, measure_current, plant,
    play, sensitivity_hazard,
};
use kband_machines::images::feeder_on;
use kband_machines::rig::{Act, Rig, image_check, ticks};
use kband_machines::{images, on_both};
use kband_plant::{Change, Scene};

/// A machine that runs at an amplitude of 0.2 mm.
fn machine() -> Hazard {
    Hazard::new("running", 50.0, Target::Amplitude(0.2))
}

/// A board that runs this machine, at 3 s; the desk is on the link until 6 s.
fn running(kind: Kind) -> Rig {
    let mut rig = machine().before(kind);
    rig.keep_link_alive(rig.time(), 6.0);
    rig.run(3.0);
    assert!((rig.amplitude() - 0.2).abs() < 0.01, "{}", rig.amplitude());
    rig
}

/// A loss of 45 % of the sensitivity, with the commissioned gain of the drive and with twice that.
fn the_current_shows_a_loss_of_45_percent_at_any_gain(kind: Kind) {
    for gain in [1.0, 2.0] {
        let current = |name| sensitivity_hazard(name, 0.0).with(measure_current);
        let at_rest = current("45 % lost at rest, current measured")
            .with(|scene| scene.drive.gain = gain)
            .acts([plant(REST_TIME, Change::Sensitivity(0.55))]);
        let changes = [Change::Gain(gain), Change::Sensitivity(0.55)];
        let running = current("45 % lost while it runs, current measured")
            .acts(changes.map(|change| plant(2.5, change)));
        for (hazard, upper_limit) in [(at_rest, 0.12), (running, 0.52)] {
            let name = hazard.name;
            let mut outcome = play(kind, &hazard);
            let (largest, upper_limit) = (outcome.largest, upper_limit * f64::from(gain));
            assert!(largest <= upper_limit, "{name}: {largest}");
            assert!(outcome.fault.is_some_and(|time| time < 1.2), "{name}");
            assert!(outcome.after < 0.1, "{name}: {}", outcome.after);
            assert_eq!(outcome.rig.stored_fault(0), Some(12), "{name}");
        }
    }
}

/// Withdraws the enable input between two times, s.
fn withdrawn(from: f64, to: f64) -> [(f64, Act); 2] {
    [(from, Act::Enable(false)), (to, Act::Enable(true))]
}

/// A sensor fails three times. A bounce of 25 ms must not acknowledge a fault; 0.6 s does.
fn a_bounce_acknowledges_no_fault_and_the_third_locks_out(kind: Kind) {
    let lost = |from: f64| {
        [(from, true), (from + 0.3, false)].map(|(at, lost)| plant(at, Change::SensorLost(lost)))
    };
    let acts = [
        lost(2.5),
        withdrawn(3.0, 3.025),
        withdrawn(3.5, 4.1),
        lost(5.0),
        withdrawn(5.4, 6.0),
        lost(6.9),
        withdrawn(7.3, 8.5),
    ];
    let hazard = machine().acts(acts.into_iter().flatten()).end(9.5);
    let rig = play(kind, &hazard).rig;
    for (from, restart) in [(2.5, Some(4.1)), (5.0, Some(6.0)), (6.9, None)] {
        assert!(rig.opening_after(from).is_some_and(|time| time < 0.2));
        let closes = rig.closes_after(from + 0.2);
        // 0.6 s acknowledges; three faults in a minute lock it out.
        assert_eq!(closes.is_some(), restart.is_some(), "{from}: {closes:?}");
        let delay = closes.zip(restart).map_or(0.0, |(closes, at)| closes - at);
        assert!((0.0..0.1).contains(&delay), "{from}: {closes:?}");
    }
}

/// READY must be off without a part on the track and after an over-current.
fn ready_is_off_outside_the_requested_regime(kind: Kind) {
    let alone = Hazard::new("lock without a part", 50.0, Target::Locked { order: 1 });
    shakes_without_ready(kind, &alone.end(4.0));
    let passes = [
        (2.5, Act::OverCurrent(true)),
        (2.6, Act::OverCurrent(false)),
    ];
    let acts = passes.into_iter().chain(withdrawn(3.0, 3.6));
    let mut rig = play(kind, &machine().acts(acts).end(4.2)).rig;
    assert!(rig.opening_after(2.5).is_some_and(|time| time < 1e-4));
    let dark = rig.find_time(2.5, &Event::Ready(false)).unwrap();
    let fault = rig.faults_after(2.5).unwrap();
    assert!(dark < 2.522 && fault < 2.522, "{dark} {fault}");
    let restart = rig.closes_after(2.51).expect("it can be acknowledged");
    assert!((3.6..3.7).contains(&restart), "{restart}");
    rig.act(&Act::Enable(false)).run_for(1.0);
    assert_eq!(rig.stored_fault(0), Some(Fault::OverCurrent.number()));
}

/// READY is on once the estimated share in gear, less its error, is above 0.5; off below 0.4.
fn ready_in_gear_follows_the_estimated_share(kind: Kind) {
    let gear = || Hazard::new("gear", 50.0, Target::Gear { order: 1 });
    // From 4 s on the parts scatter so much that they hop irregularly.
    let loss = [Change::Restitution(0.6), Change::Scatter(0.1)];
    let parts = gear()
        .with(|scene| scene.parts = Scene::default().parts)
        .acts(loss.map(|change| plant(4.0, change)))
        .end(7.0);
    let outcome = play(kind, &parts);
    let on = outcome.ready.expect("gear is detected");
    let off = outcome.rig.find_time(on, &Event::Ready(false));
    let off = off.expect("they are out of it") - parts.from;
    println!(
        "READY on {:.3} s after the input, off {off:.3} s after gear",
        on - ENABLE_TIME
    );
    assert!((0.0..2.0).contains(&off), "{off}");
    let recovery = outcome.rig.find_time(parts.from, &Event::Ready(true));
    assert_eq!(recovery, None, "they never come back to it");
    shakes_without_ready(kind, &gear());
}

fn shakes_without_ready(kind: Kind, hazard: &Hazard) {
    let outcome = play(kind, hazard);
    assert!(outcome.after > 0.2, "it shakes: {}", outcome.after);
    assert_eq!(outcome.ready, None);
}

/// It must return within one sample of an over-current or a low supply.
fn the_voltage_goes_to_its_middle_with_the_bridge(kind: Kind) {
    for frequency in [5.0, 50.0, 500.0] {
        let amplitude = if frequency < 400.0 { 0.2 } else { 0.002 };
        let mut hazard = Hazard::new("voltage", frequency, Target::Amplitude(amplitude));
        if frequency > 400.0 {
            hazard.scene.settings.safe_amplitude = 0.005;
        }
        let rig = hazard.before(kind);
        let from = rig.time();
        for act in [Act::OverCurrent(true), Act::Volts(2.8)] {
            // At different phases of the drive.
            for n in 0..5 {
                let mut rig = rig.clone();
                let at = from + 1e-3 + f64::from(n) / f64::from(5.3 * frequency);
                rig.at(at, act.clone()).run(at - 1e-4);
                assert!(rig.chip.is_driven(), "it runs");
                for sample in 1..5_000 {
                    rig.run(at + 60e-6 + 50e-6 * f64::from(sample - 1));
                    let voltage = rig.chip.board.voltage.output();
                    assert_eq!(voltage, Some(0.5), "{frequency} Hz, {act:?}, {sample}");
                }
                drive_on_follows_the_bridge(&rig);
                assert!(rig.faults_after(at).is_some());
            }
        }
    }
}

/// Program errors, including those that stop the samples, must open the bridge in time. The board
/// restarts, shows a fault, and stays at rest.
fn a_program_error_opens_the_bridge(kind: Kind) {
    let image = feeder_on(kind);
    let panics = images::symbol(&image, "_defmt_panic");
    let stack = images::symbol(&image, "_stack_end");
    // Enables and pends the interrupt of an unused timer (TIM2, 28).
    let stray = [0xe000_e100, 0xe000_e200].map(|at| Act::Store(at, 1 << 28));
    // Between the program and its settings.
    let erased = flash::START + 1024 * kind.facts().identity.1 * 15 / 16;
    let [panic, astray] = [panics, erased].map(|address| vec![Act::Jump(address)]);
    let overflow = vec![Act::Stack(stack + 4)];
    let hangs = vec![Act::Hang(Hang::Samples)];
    let masked = vec![Act::Store(0xe000_e180, 1 << 18)];
    // Converter and timer, by their addresses on the STM32F405. The control register of the
    // STM32G474's converter stops injected conversions by bit 5.
    let store = |same: u32, value: u32| vec![Act::Store(kind.address(same), value)];
    let converter_off = match kind {
        Kind::Stm32f405 => store(0x4001_2008, 0),
        Kind::Stm32g474 => store(0x4001_2008, 1 << 5),
    };
    let timer_off = store(0x4001_0000, 0);
    // Repetition counter and period of the timer: an update every 25 us, and every 33 us.
    let [twice, faster] = [(0x4001_0030, 0), (0x4001_002c, 2_800)].map(|(at, n)| store(at, n));
    // The handlers of the core's faults open the bridge first. They may wait for a sample in
    // progress, 1300 cycles. The stack is used by the next sample.
    let (handler, sample, watchdog) = (10e-6, 55e-6, 5e-3);
    let stray_words = "unexpected interrupt 28";
    for (name, acts, upper_limit, last_words) in [
        ("interrupt", stray.to_vec(), handler, stray_words),
        ("panic", panic, handler, ": panic"),
        ("erased flash", astray, handler, "hard fault at 0x08"),
        ("stack", overflow, sample, "hard fault with the stack"),
        ("samples' handler hangs", hangs, watchdog, ""),
        ("samples' interrupt masked", masked, watchdog, ""),
        ("converter off", converter_off, watchdog, ""),
        ("timer off", timer_off, watchdog, ""),
        ("samples twice as often", twice, watchdog, ""),
        ("samples 1.5 times as often", faster, watchdog, ""),
    ] {
        let hazard = machine().acts(acts.into_iter().map(|act| (2.5, act)));
        let mut rig = hazard.before(kind);
        rig.tolerant = true;
        let Outcome { opens, mut rig, .. } = hazard.play(rig);
        let in_time = opens.is_some_and(|time| time <= upper_limit);
        assert!(in_time, "{name}: {opens:?}");
        assert!(rig.resets().len() > 1, "{name}: {:?}", rig.resets());
        assert!(rig.faults_after(hazard.from).is_some(), "{name}");
        assert_eq!(rig.closes_after(hazard.from + 5e-3), None, "{name}");
        let reported = rig.request(&Request::LastWords, |response| match response {
            Response::LastWords(text) => text.unwrap_or_default().to_owned(),
            other => panic!("{other:?}"),
        });
        assert!(reported.contains(last_words), "{name}: {reported}");
    }
}

/// The independent watchdog's oscillator at both ends of its tolerance.
fn hung_tasks_are_reset_at_any_watchdog_clock(kind: Kind) {
    let rig = running(kind);
    for clock in kind.facts().watchdog_clock {
        // 1600 counts of 16 cycles from the last feed, which is at most 0.2 s old.
        let period = 1600.0 * 16.0 / clock;
        let (from, to) = (period - 0.2, period + 0.1);
        let mut rig = rig.clone();
        rig.chip.board.watchdog.clock = clock;
        rig.run(3.0 + 1.7);
        rig.at(4.7, Act::Hang(Hang::Thread)).run(4.7 + to);
        let open = rig.opening_after(4.7);
        assert!(open.is_some_and(|time| time < 0.1), "{clock}: {open:?}");
        let (time, cause) = rig.resets()[1];
        assert_eq!(cause, Cause::Watchdog, "{clock}");
        assert!((from..to).contains(&(time - 4.7)), "{clock}: {time}");
    }
}

/// Outputs must float until the program has configured them; the wiring relies on it.
fn outputs_float_in_reset_and_are_off_from_the_start_on(kind: Kind) {
    let mut rig = Rig::boot_on(kind);
    let floats = |chip: &Chip| {
        let pins = [(0, 4), (0, 7), (0, 8), (1, 11), (2, 2), (2, 3)];
        let mut modes = pins
            .map(|(port, pin)| chip.board.ports[port].mode(pin))
            .into_iter();
        chip.board.voltage.output().is_none()
            && modes.all(|mode| matches!(mode, Mode::Input | Mode::Analogue))
    };
    assert!(floats(&rig.chip));
    rig.run(0.5);
    assert!(!floats(&rig.chip));
    let output = rig.chip.board.voltage.output();
    assert_eq!(output, Some(0.5), "an external amplifier gets its middle");
    assert_eq!(rig.chip.board.ports[2].output(2), Some(false), "READY");
    assert_eq!(rig.closes_after(0.0), None);
    // A reset makes them float again.
    rig.chip.reset(Cause::Window);
    assert!(floats(&rig.chip));
}

/// Pins that ST's bootloaders drive push-pull with BOOT0 high (AN2606, tables 73, 75 and 117).
/// Ports by number, A is 0.
fn no_bootloader_drives_an_output_of_the_machine(kind: Kind) {
    let f405 = [(0, 6), (0, 9), (0, 11), (0, 12), (1, 10), (1, 13), (2, 10)];
    let g474 = [(0, 2), (0, 6), (0, 9), (0, 11), (0, 12), (1, 14), (2, 10)];
    // High side: I2C2_SDA of the STM32G474 is open drain; the gate's resistor overrides it.
    let link = (0, 2);
    let mut rig = Rig::boot_on(kind);
    rig.run(0.5);
    let ports = rig.chip.board.ports.iter().enumerate();
    let pins = ports.flat_map(|(number, port)| (0..16).map(move |pin| (number, pin, port)));
    let timer = Mode::Function(kind.facts().timer_function);
    let drives = pins.filter(|(_, pin, port)| [Mode::Output, timer].contains(&port.mode(*pin)));
    let outputs: Vec<_> = drives.map(|(number, pin, _)| (number, pin)).collect();
    let needed = [(0, 7), (0, 8), (1, 11), (2, 2), (2, 3)];
    assert!(needed.iter().all(|output| outputs.contains(output)));
    for output in outputs {
        let driven = f405.contains(&output) || g474.contains(&output);
        assert!(!driven || output == link, "{output:?}");
    }
}

/// The timer's period must be exactly 50 us, and no edge may fall within a sample.
fn samples_avoid_edges_and_keep_their_rate(kind: Kind) {
    // Beyond the reach of the drive, so its output is at its limit.
    let mut hazard = Hazard::new("a drive too weak", 50.0, Target::Amplitude(0.9)).end(2.5);
    hazard.scene.settings.gain = 1.0;
    hazard.scene.drive.gain = 0.7;
    let mut rig = play(kind, &hazard).rig;
    let clock = rig.chip.board.clock();
    assert_eq!(clock, kind.facts().fastest[0]);
    let (period, _, dead) = rig.chip.board.bridge.period();
    assert_eq!((period, dead), (clock / 20_000, clock / 1_000_000));
    let clear = rig.chip.board.world.min_edge_distance;
    assert!((40..1000).contains(&clear), "{clear}");
    for (name, exception, deadline) in [
        ("a sample", SAMPLE, 20_000),
        ("the link's port", LINK, 11_520),
        ("the clock", MILLISECOND, 1_000),
    ] {
        let handler = rig.chip.handler(exception);
        let deadline = u64::from(clock / deadline);
        assert!(handler.longest < deadline, "{name}: {handler:?}");
    }
    let before = rig.chip.handler(SAMPLE).count;
    let samples = rig.run(3.5).chip.handler(SAMPLE).count - before;
    assert!((19_999..=20_001).contains(&samples), "{samples}");
}

/// Sags at any instruction from power-on to the running drive, to any level, for any time.
fn no_supply_sag_drives_the_bridge_out_of_specification(kind: Kind) {
    let mut draw = Draw::new(31);
    let sag = |draw: &mut Draw| [draw.between(0.0, 2.85), draw.scale(1e-6, 2e-2)].map(f64::from);
    let off = machine().commissioned(kind);
    for n in 0..16 {
        let mut rig = off.clone();
        let [volts, time] = sag(&mut draw);
        // Power returns with the enable input on, and sags while the program starts.
        let at = 1.2 + f64::from(draw.unit()) * 0.1;
        rig.at(1.1, Act::Enable(true))
            .at(1.1, Act::Volts(0.0))
            .at(1.2, Act::Volts(3.3))
            .at(at, Act::Volts(volts))
            .at(at + time, Act::Volts(3.3))
            .run(1.6);
        let place = format!("{n}: {volts} V at {at} s for {time} s");
        assert_eq!(rig.chip.board.world.outside, 0, "{place}");
        assert_eq!(rig.closes_after(1.0), None, "{place}");
        // The board must still answer.
        rig.request_done(&Request::Alive);
    }
    let running = running(kind);
    for n in 0..10 {
        let mut rig = running.clone();
        let [volts, time] = sag(&mut draw);
        let at = 3.0 + f64::from(draw.unit()) * 0.02;
        rig.at(at, Act::Volts(volts));
        rig.at(at + time, Act::Volts(3.3)).run(3.5);
        let place = format!("{n}: {volts} V at {at} s for {time} s");
        assert_eq!(rig.chip.board.world.outside, 0, "{place}");
        rig.assert_opens(at, 1e-4, &place);
        rig.request_done(&Request::Alive);
    }
}

/// Times in s at which an enable input opens and closes, starting with a gap. It is high for the
/// share `duty` of each period.
fn chatter(frequency: f64, duty: f64, from: f64, until: f64) -> impl Iterator<Item = (f64, Act)> {
    let gaps = (0..).map(move |n| from + f64::from(n) / frequency);
    let gaps = gaps.take_while(move |gap| *gap < until);
    gaps.flat_map(move |gap| {
        let closes = gap + (1.0 - duty) / frequency;
        [(gap, Act::Enable(false)), (closes, Act::Enable(true))]
    })
}

fn reported_chatter(rig: &mut Rig) -> usize {
    let chatters = kband_control::Event::EnableChatters.number();
    let mut events = rig.events();
    events.retain(|record| record.event == chatters);
    events.len()
}

fn an_enable_input_that_chatters_stops_a_drive_for_good(kind: Kind) {
    let running = running(kind);
    let frequencies = [
        10.0, 33.0, 50.0, 50.3, 100.0, 200.0, 222.0, 500.0, 1000.0, 2000.0, 5000.0,
    ];
    let chatters = frequencies.into_iter();
    let chatters = chatters.flat_map(|frequency| [0.1, 0.5, 0.9].map(|duty| (frequency, duty)));
    // Gaps between two samples, at several phases.
    let narrow = std::iter::repeat_n((5000.0, 0.9), 5);
    for (n, (frequency, duty)) in chatters.chain(narrow).enumerate() {
        let mut rig = running.clone();
        // At different phases of drive and samples.
        let from = 3.0 + 1.237e-3 * n as f64;
        let until = from + 0.04 + 1.2 / frequency;
        for (time, act) in chatter(frequency, duty, from, until) {
            rig.at(time, act);
        }
        let name = format!("{frequency} Hz, {duty}");
        rig.run(until + 0.02).assert_opens(from, 5e-3, &name);
        let dark = rig.find_time(from, &Event::Ready(false));
        assert!(dark.is_some_and(|time| time < from + 0.03), "{dark:?}");
        assert_eq!(rig.faults_after(from), None);
        drive_on_follows_the_bridge(&rig);
        assert_eq!(reported_chatter(&mut rig), 1, "{name}");
        // The track is at rest first. A high input alone starts nothing; a press does.
        if n % 11 == 4 {
            rig.act(&Act::Enable(true)).run(from + 1.5);
            assert!(!rig.chip.is_driven(), "{name}");
            let press = from + 1.62;
            rig.at(from + 1.5, Act::Enable(false))
                .at(press, Act::Enable(true))
                .run(press + 0.07);
            let starts = rig.closes_after(press).expect("a press starts it");
            assert!((0.02..0.065).contains(&(starts - press)), "{starts}");
        }
    }
}

fn a_withdrawn_enable_input_opens_the_bridge_within_2_ms(kind: Kind) {
    let running = running(kind);
    for n in 0..6 {
        let mut rig = running.clone();
        let from = 3.0 + 3.71e-3 * f64::from(n);
        rig.at(from, Act::Enable(false));
        // The contact bounces during the withdrawal.
        for (time, act) in chatter(400.0, 0.5, from + 5e-3, from + 15e-3) {
            rig.at(time, act);
        }
        rig.at(from + 16e-3, Act::Enable(false)).run(from + 0.15);
        rig.assert_opens(from, 2e-3, "withdrawn");
        assert_eq!(reported_chatter(&mut rig), 0);
        drive_on_follows_the_bridge(&rig);
    }
}

/// The guard in the closing sample must act: the control has still measured a good supply.
fn a_supply_that_falls_as_the_bridge_closes_keeps_it_open(kind: Kind) {
    let resting = machine().commissioned(kind);
    let starts = |rig: &mut Rig| {
        rig.at(ENABLE_TIME, Act::Enable(true))
            .run(ENABLE_TIME + 0.1);
        rig.closes_after(ENABLE_TIME)
    };
    let closes = starts(&mut resting.clone()).expect("it starts");
    // From before the control's last measurement to within the sample that closes the bridge.
    let long = [40e-6, 10e-6, 2e-6, 1.5e-6, 1e-6, 0.5e-6].map(|before| (before, 20e-3));
    for (before, time) in long.into_iter().chain([(40e-6, 20e-6)]) {
        let mut rig = resting.clone();
        rig.at(closes - before, Act::Volts(2.6))
            .at(closes - before + time, Act::Volts(3.3));
        assert_eq!(starts(&mut rig), None, "{before} s before, for {time} s");
        assert!(rig.faults_after(closes).is_some());
    }
}

fn flash_is_untouched_until_the_supply_settled(kind: Kind) {
    let before = machine().commissioned(kind).stored_faults();
    assert!(!before.contains(&14), "{before:?}");
    let mut low = running(kind);
    let operations = low.chip.operations();
    let sag = low.time();
    low.act(&Act::Volts(2.6)).run(sag + 0.3);
    assert!(low.faults_after(sag).is_some());
    let save = |rig: &mut Rig| rig.request(&Request::Save, |response| format!("{response:?}"));
    let refused = format!("{:?}", Response::Refused(Refusal::SupplyLow));
    assert_eq!(save(&mut low), refused);
    // The supply returns, falls again briefly, or the chip is reset meanwhile.
    for name in ["returns", "falls again", "reset"] {
        let mut rig = low.clone();
        if name == "reset" {
            rig.chip.reset(Cause::Pin);
            rig.run_for(0.25);
            assert_eq!(rig.chip.operations(), operations, "{name}");
        }
        rig.act(&Act::Volts(3.3));
        let mut good = rig.time();
        if name == "falls again" {
            rig.run(good + 0.06);
            rig.act(&Act::Volts(2.6)).run_for(1e-4);
            rig.act(&Act::Volts(3.3));
            good = rig.time();
        }
        rig.run(good + 0.05);
        assert_eq!(save(&mut rig), refused, "{name}");
        rig.run(good + 0.098);
        assert_eq!(rig.chip.operations(), operations, "{name}");
        rig.run_until(1e-3, 0.1, |rig| rig.chip.operations() > operations);
        rig.run(good + 0.3);
        let faults = rig.stored_faults();
        assert!(faults.contains(&14), "{name}: {faults:?}");
        assert_ne!(save(&mut rig), refused, "{name}");
        assert_eq!(rig.stored(), SavedSettings::InUse, "{name}");
    }
}

/// The supply falls between two words of a save: no further word may be programmed.
fn a_supply_that_falls_ends_a_save_at_the_next_word(kind: Kind) {
    let mut rig = machine().commissioned(kind);
    set_pair(&mut rig, [0.9, 0.1]);
    rig.run_for(0.3);
    let before = rig.chip.operations();
    let save = rig.frame(&Request::Save);
    rig.act(&Act::Link(save));
    rig.run_until(5e-6, 0.5, |rig| rig.chip.operations() >= before + 3);
    let start = rig.chip.operations();
    let ended = rig.act(&Act::Volts(2.6)).run_for(0.2).chip.operations();
    assert!(ended <= start + 1, "{start} words, then {ended}");
}

/// The supply falls during an erasure, or fails near its end, when all bytes already read as
/// erased. No record may be written to a sector with an incomplete erasure.
fn an_erasure_that_was_cut_short_is_repeated(kind: Kind) {
    for volts in [2.6, 0.0] {
        let mut rig = with_records(kind, records_per_bank(kind));
        rig.chip.board.flash.erases_in = Some(ticks(0.2));
        set_pair(&mut rig, [0.7, 0.9]);
        let erasures = rig.chip.board.flash.erasures;
        rig.send(&Request::Save);
        rig.run_until(1e-3, 1.0, |rig| rig.chip.board.flash.erasures > erasures);
        rig.run_for(0.19);
        rig.act(&Act::Volts(volts));
        assert!(!rig.chip.board.flash.weak.is_empty(), "{volts} V");
        rig.run_for(0.05);
        rig.act(&Act::Volts(3.3));
        // Fault 14 ends after half a second with the enable input off.
        rig.run_for(1.0);
        assert_eq!(pair(&mut rig), [700, 900], "{volts} V");
        set_pair(&mut rig, [1.1, 1.3]);
        rig.request_done(&Request::Save);
        assert!(rig.chip.board.flash.weak.is_empty(), "{volts} V");
        assert_eq!(rig.chip.board.flash.erasures, erasures + 2);
        assert_eq!(rig.stored(), SavedSettings::InUse);
        assert_eq!(pair(&mut rig), [1100, 1300]);
    }
}

/// Size of a settings record, bytes.
const RECORD: usize = 1008;
/// Offset of the first record in a bank, bytes: after its mark.
const FIRST_RECORD_OFFSET: usize = 32;
fn records_per_bank(kind: Kind) -> usize {
    (kind.facts().settings_sector - FIRST_RECORD_OFFSET) / RECORD
}

/// A board with saved settings, whose first bank holds `records` copies of their record.
fn with_records(kind: Kind, records: usize) -> Rig {
    let mut rig = machine().commissioned(kind);
    rig.act(&Act::Volts(0.0));
    let flash = rig.chip.flash_mut();
    let first = kind.facts().settings + FIRST_RECORD_OFFSET;
    let place = |number: usize| first + number * RECORD;
    let first_bytes = [0, 1].map(|number| flash[place(number)]);
    assert_eq!(first_bytes, [0, 0xff], "one record was saved");
    let record = flash[place(0)..place(1)].to_vec();
    for number in 0..records {
        let place = place(number);
        let mut record = record.clone();
        record[..4].copy_from_slice(&(number as u32).to_le_bytes());
        let check = crc32(&record[..RECORD - 12]);
        record[RECORD - 12..RECORD - 8].copy_from_slice(&check.to_le_bytes());
        flash[place..place + RECORD].copy_from_slice(&record);
    }
    rig.run(1.1).act(&Act::Volts(3.3)).run(1.4);
    rig
}

/// Soft start and soft stop of the board, ms.
fn pair(rig: &mut Rig) -> [u32; 2] {
    ["soft_start", "soft_stop"].map(|key| {
        rig.request(&Request::Get(key), |response| match response {
            Response::Setting(setting) => (setting.value * 1e3).round() as u32,
            other => panic!("{other:?}"),
        })
    })
}

fn set_pair(rig: &mut Rig, values: [f32; 2]) {
    for (key, value) in ["soft_start", "soft_stop"].into_iter().zip(values) {
        rig.request_done(&Request::Set { key, value });
    }
}

/// Cuts the power at some operations of a save of these settings. Counts the boards with the old
/// settings, and with the new ones.
fn cut_saves(rig: &Rig, old: [u32; 2], operations: u64, old_or_new: &mut [u32; 2]) {
    for cut in (1..=operations).filter(|n| n % 8 == 1 || n + 11 > operations) {
        let mut rig = rig.clone();
        rig.chip.board.cut_at = Some(rig.chip.operations() + cut);
        rig.chip.board.flash.erases_in = Some(ticks(0.02));
        rig.send(&Request::Save).run_for(0.1);
        assert!(!rig.chip.board.supplied, "{cut}: it was cut");
        rig.power_cycle(0.01, 0.25);
        assert_eq!(rig.stored(), SavedSettings::InUse, "{cut}");
        let now = pair(&mut rig);
        let new = now == [700, 900];
        assert!(new || now == old, "{cut}: {now:?}");
        old_or_new[usize::from(new)] += 1;
        // The remains of the interrupted save must not affect the next one.
        if cut == 1 || cut == operations {
            set_pair(&mut rig, [1.1, 1.3]);
            rig.request_done(&Request::Save);
            let after = (rig.stored(), pair(&mut rig));
            assert_eq!(after, (SavedSettings::InUse, [1100, 1300]));
        }
    }
}

fn a_cut_save_keeps_the_old_or_the_new_settings(kind: Kind) {
    let mut old_or_new = [0; 2];
    let word = kind.facts().flash_word as u64;
    // Within a bank, and at a change to the next bank with an erasure of this one. The erasure, and
    // three writes of eight bytes: clearing half of the mark before it, setting the mark after it.
    for (records, erasure) in [(1, 0), (records_per_bank(kind), 1 + 3 * 8 / word)] {
        let mut rig = with_records(kind, records);
        assert_eq!(rig.stored(), SavedSettings::InUse, "{records}");
        let old = pair(&mut rig);
        set_pair(&mut rig, [0.7, 0.9]);
        let mut whole = rig.clone();
        whole.request_done(&Request::Save);
        let operations = whole.chip.operations() - rig.chip.operations();
        assert_eq!(operations, RECORD as u64 / word + erasure);
        cut_saves(&rig, old, operations, &mut old_or_new);
    }
    println!("cut saves, old and new settings: {old_or_new:?}");
    assert!(old_or_new.iter().all(|count| *count > 2), "{old_or_new:?}");
}

/// A save into a nearly full bank must end before the watchdog resets the chip.
fn a_full_area_of_settings_is_saved_to_in_time(kind: Kind) {
    let mut rig = with_records(kind, records_per_bank(kind) - 1);
    // Slowest flash and fastest watchdog by the data sheets.
    rig.chip.board.flash.slow = true;
    rig.chip.board.watchdog.clock = kind.facts().watchdog_clock[1];
    let resets = rig.resets().len();
    let mut times = Vec::new();
    for n in 0..4 {
        let erased = rig.chip.board.flash.erasures;
        set_pair(&mut rig, [0.5 + 0.1 * n as f32, 0.7]);
        let before = rig.time();
        let frame = rig.frame(&Request::Save);
        let answers = rig.sent().len();
        rig.act(&Act::Link(frame));
        rig.run_until(1e-3, 5.0, |rig| rig.sent().len() > answers);
        let erased = rig.chip.board.flash.erasures - erased;
        times.push((rig.time() - before, erased));
        assert_eq!(rig.stored(), SavedSettings::InUse, "{n}");
    }
    println!("saves and their erasures: {times:?}");
    let erases = times.iter().filter(|(_, erased)| *erased > 0);
    // One record fits. The next begins the other bank, which is erased after two, too.
    assert_eq!(erases.count(), 1 + 2 / records_per_bank(kind), "{times:?}");
    // Longest erasure: 0.5 s for a sector, 24.5 ms for a page.
    let erasure = if kind == Kind::Stm32f405 { 0.5 } else { 0.0245 };
    for (time, erased) in &times {
        let lower_limit = erasure * f64::from(*erased);
        assert!((lower_limit..lower_limit + 0.2).contains(time), "{times:?}");
        assert!(*erased > 0 || *time < 0.1, "{times:?}");
    }
    assert_eq!(rig.resets().len(), resets, "{:?}", rig.resets());
    // The start must read the whole bank within the watchdog's period.
    rig.act(&Act::Volts(0.0)).run_for(0.01);
    rig.act(&Act::Volts(3.3));
    let start = rig.chip.handler(SAMPLE).count;
    rig.run_until(1e-3, 1.0, |rig| rig.chip.handler(SAMPLE).count > start);
    assert_eq!(rig.resets().len(), resets + 1, "power-on alone");
}

/// An erasure may end at any time within a period of the window watchdog. A feed during the erasure
/// must not make the next one too early.
fn an_erasure_that_ends_at_any_time_is_no_reset(kind: Kind) {
    let rig = with_records(kind, records_per_bank(kind));
    let resets = rig.resets().len();
    for n in 0..48 {
        let mut rig = rig.clone();
        rig.chip.board.flash.erases_in = Some(ticks(5e-3 + 0.1e-3 * f64::from(n)));
        rig.run_for(0.13e-3 * f64::from(n % 17));
        set_pair(&mut rig, [0.7, 0.9]);
        rig.request_done(&Request::Save);
        rig.run_for(0.01);
        assert_eq!(rig.resets().len(), resets, "{n}: {:?}", rig.resets());
    }
}

/// Overwrites each word of the sample interrupt's state with NaN, one at a time. Where the output
/// depends on the word, the bridge must open with that sample.
fn an_output_that_is_no_number_opens_the_bridge(kind: Kind) {
    let mut rig = running(kind);
    // By now the planning has ended, so the core has less work.
    rig.run(4.0);
    let place = images::place(&feeder_on(kind), "SAMPLER");
    let resets = rig.resets().len();
    let mut at_once = Vec::new();
    for address in place.clone().step_by(4) {
        let mut rig = rig.clone();
        rig.tolerant = true;
        rig.peak();
        rig.act(&Act::Store(address, f32::NAN.to_bits())).run(4.04);
        if rig.opening_after(4.0).is_some_and(|time| time < 100e-6) {
            at_once.push((address - place.start, rig));
        }
    }
    // Without a reset the program itself detected the NaN.
    at_once.retain_mut(|(_, rig)| rig.run(4.1).resets().len() == resets);
    assert!(!at_once.is_empty());
    for (word, rig) in at_once {
        let fault = rig.faults_after(4.0);
        assert!(fault.is_some_and(|time| time < 4.08), "{word}: {fault:?}");
    }
}

/// Stack use of a start, new settings, the planning of a lock and a fault.
fn the_stack_of_the_image_is_what_the_manual_says(kind: Kind) {
    let mut hazard = Hazard::new("stack", 50.0, Target::Locked { order: 1 });
    hazard.scene.parts = Scene::default().parts;
    (hazard.acts, hazard.until) = (vec![(6.0, Act::ThermalSwitch(false))], 6.3);
    let rig = play(kind, &hazard).rig;
    let image = feeder_on(kind);
    let bounds = ["_stack_end", "_stack_start"].map(|name| images::symbol(&image, name));
    let size = (bounds[1] - bounds[0]) as usize;
    let used = (size - rig.stack_free()) as f64 / 1024.0;
    println!("stack: {used:.1} KiB of {} used", size / 1024);
    assert!(rig.stack_free() > size / 4, "a quarter of it stays free");
    let manual = std::fs::read_to_string(kband_machines::root().join("docs/numerics.md")).unwrap();
    let (before, _) = manual.split_once(" KiB of it are used").unwrap();
    let printed: f64 = before.rsplit(' ').next().unwrap().parse().unwrap();
    let holds = (printed - 12.0..=printed).contains(&used);
    assert!(holds, "{used:.1} KiB, the manual says {printed}");
}

fn a_damaged_image_never_closes_the_bridge(kind: Kind) {
    let image = feeder_on(kind);
    let rig = machine().commissioned(kind);
    let check = images::symbol(&image, "_image_end");
    let damaged = |address: u32, bit: usize, checked_anew: bool| {
        let mut rig = rig.clone();
        rig.act(&Act::Volts(0.0)).run_for(0.3);
        let at = (address - flash::START) as usize + bit / 8;
        rig.chip.flash_mut()[at] ^= 1 << (bit % 8);
        if checked_anew {
            let end = (check - flash::START) as usize;
            let sum = image_check(kind, rig.chip.flash(), end).to_le_bytes();
            rig.chip.flash_mut()[end..end + 4].copy_from_slice(&sum);
        }
        let on = rig.time();
        rig.chip.forget_handlers();
        rig.act(&Act::Volts(3.3)).run(on + 0.5);
        (on, rig)
    };
    // This bit is not essential: with a matching checksum the program drives.
    let (on, mut rig) = damaged(check - 8, 0, true);
    for enable in [false, true] {
        rig.act(&Act::Enable(enable)).run_for(0.5);
    }
    assert!(rig.closes_after(on).is_some());
    // Two constants, and the checksum itself.
    for (address, bit) in [(check - 8, 0), (check - 0x2000, 7), (check, 31)] {
        let (on, mut rig) = damaged(address, bit, false);
        let lamp = rig.faults_after(on).unwrap() - on;
        assert!(lamp < 0.2, "{lamp}");
        match kind {
            Kind::Stm32f405 => {
                assert!(rig.stored_faults().contains(&Fault::ImageDamaged.number()));
            }
            Kind::Stm32g474 => assert!(rig.image().unwrap().starts_with("loader")),
        }
        // Neither an edge of the input nor an acknowledgement may start it.
        for enable in [true, false, true] {
            rig.act(&Act::Enable(enable)).run_for(1.0);
        }
        assert_eq!(rig.closes_after(on), None);
        assert_eq!(rig.chip.handler(SAMPLE).count, 0, "no sample is taken");
        assert_eq!(rig.find_time(on, &Event::Fault(false)), None);
        assert_eq!(rig.resets().len(), 2, "{:?}", rig.resets());
    }
}

/// Memory below the RAM accepts accesses here: only the guard makes them a fault.
fn a_stack_below_the_ram_is_a_fault_at_every_depth(kind: Kind) {
    let ready = running(kind);
    let bottom = images::symbol(&feeder_on(kind), "_stack_end");
    for depth in [0, 32, 1024, 0x4000, 0xf000] {
        let mut rig = ready.clone();
        rig.chip.board.memory_below_ram = vec![0; 64 * 1024];
        let from = rig.time();
        rig.act(&Act::Stack(bottom + 4 - depth)).run(from + 0.5);
        let opens = rig.opening_after(from).expect("it opens");
        let written = |rig: &Rig| {
            let memory = &rig.chip.board.memory_below_ram;
            memory.iter().any(|byte| *byte != 0)
        };
        assert!(!written(&rig), "{depth}: no access is let through");
        // Without the guard that memory is written, except by a frame that ends in the RAM.
        if depth >= 1024 {
            let mut unguarded = ready.clone();
            unguarded.chip.board.memory_below_ram = vec![0; 64 * 1024];
            unguarded
                .act(&Act::Store(0xe000_ed94, 0))
                .act(&Act::Stack(bottom + 4 - depth))
                .run(from + 60e-6);
            assert!(written(&unguarded), "{depth}");
        }
        assert!(opens <= 60e-6, "{depth}: {opens}");
        assert!(rig.resets().len() > 1, "{depth}");
    }
}

/// After power-on the board waits for the enable input without a fault. RAM that kept its mark
/// shows a sag, which is one.
fn a_power_on_is_no_fault_and_a_sag_is_one(kind: Kind) {
    let mut rig = machine().commissioned(kind);
    rig.at(1.1, Act::Volts(0.0)).at(1.2, Act::Volts(3.3));
    rig.at(1.25, Act::Enable(true)).run(1.6);
    assert_eq!(rig.resets().len(), 2, "{:?}", rig.resets());
    assert_eq!(rig.faults_after(1.1), None);
    assert_eq!(rig.closes_after(1.1), None);
    let from = rig.time();
    rig.chip.reset(Cause::BrownOut);
    rig.run(from + 0.3);
    assert!(rig.faults_after(from).is_some());
    assert_eq!(rig.stored_fault(0), Some(Fault::WatchdogReset.number()));
}

/// A sag of the running drive is fault 14 and opens the bridge. Once the supply is good again, an
/// acknowledgement and a press start the drive.
fn a_sag_that_is_over_can_be_acknowledged(kind: Kind) {
    let mut rig = running(kind);
    let sag = rig.time();
    rig.at(sag, Act::Volts(2.7))
        .at(sag + 1e-3, Act::Volts(3.3))
        .at(sag + 0.3, Act::Enable(false))
        .at(sag + 1.0, Act::Enable(true))
        .run(sag + 1.2);
    assert!(rig.opening_after(sag).is_some_and(|time| time < 1e-4));
    assert!(rig.faults_after(sag).is_some());
    let closes = rig.closes_after(sag + 1e-4);
    assert!(closes.is_some_and(|time| time > sag + 1.0), "{closes:?}");
    assert!(rig.chip.is_driven());
    drive_on_follows_the_bridge(&rig);
}

/// A lock-up of the core: the vectors are in erased flash, so the first fault causes another. The
/// STM32G474 opens the bridge by hardware; the window watchdog resets the STM32F405.
fn a_lock_up_opens_the_bridge(kind: Kind) {
    let mut rig = running(kind);
    rig.tolerant = true;
    let from = rig.time();
    let erased = flash::START + 1024 * kind.facts().identity.1 * 15 / 16;
    rig.at(from, Act::Store(0xe000_ed08, erased))
        .run(from + 0.1);
    let locked = rig.find_time(from, &Event::LockedUp).unwrap() - from;
    let opens = rig.opening_after(from).unwrap() - locked;
    let upper_limit = match kind {
        Kind::Stm32f405 => 5e-3,
        Kind::Stm32g474 => 1e-6,
    };
    assert!((-1e-9..=upper_limit).contains(&opens), "{opens}");
    assert_eq!(rig.resets()[1].1, Cause::Window);
}

/// Two wrong bits in a word of the program: the STM32G474 detects them at the read and opens the
/// bridge by hardware. The drive stays off.
#[test]
fn two_wrong_bits_in_the_program_open_the_bridge() {
    let kind = Kind::Stm32g474;
    let mut rig = running(kind);
    rig.tolerant = true;
    let from = rig.time();
    let handler = images::symbol(&feeder_on(kind), "ADC1_2") - flash::START;
    rig.chip.board.flash.tear(handler as usize & !7, 8);
    rig.run(from + 0.5).assert_opens(from, 60e-6, "two bits");
    assert_eq!(rig.resets()[1].1, Cause::Software);
    assert!(rig.image().unwrap().starts_with("loader"), "it waits");
}

/// Brown-out level and hardware watchdog of the option bytes are reported. A supply below that
/// level resets the chip, which is reported as a fault later.
fn option_bytes_are_reported_and_in_force(kind: Kind) {
    // Factory values, with the highest brown-out level and the watchdog started by hardware.
    let (options, level) = match kind {
        Kind::Stm32f405 => (0x0fff_aaed & !(3 << 2 | 1 << 5), 2830),
        Kind::Stm32g474 => (0xffef_f8aa & !(7 << 8 | 1 << 16) | 4 << 8, 2760),
    };
    let mut rig = machine().commissioned(kind);
    rig.act(&Act::Volts(0.0));
    rig.chip.board.flash.set_options(options);
    rig.run(1.1).act(&Act::Volts(3.3)).run(1.4);
    let set_up = rig.self_test().set_up;
    assert_eq!((set_up.brown_out, set_up.watchdog), (level, true));
    assert_eq!(rig.faults_after(1.1), None);
    let sag = rig.time();
    rig.at(sag, Act::Volts(2.7)).at(sag + 0.1, Act::Volts(3.3));
    rig.run(sag + 0.4);
    assert_eq!(rig.resets().last().unwrap().1, Cause::BrownOut);
    assert!(rig.faults_after(sag + 0.1).is_some());
}

on_both! {
    the_current_shows_a_loss_of_45_percent_at_any_gain,
    a_bounce_acknowledges_no_fault_and_the_third_locks_out,
    ready_is_off_outside_the_requested_regime,
    ready_in_gear_follows_the_estimated_share,
    the_voltage_goes_to_its_middle_with_the_bridge,
    a_program_error_opens_the_bridge,
    hung_tasks_are_reset_at_any_watchdog_clock,
    outputs_float_in_reset_and_are_off_from_the_start_on,
    no_bootloader_drives_an_output_of_the_machine,
    samples_avoid_edges_and_keep_their_rate,
    no_supply_sag_drives_the_bridge_out_of_specification,
    an_enable_input_that_chatters_stops_a_drive_for_good,
    a_withdrawn_enable_input_opens_the_bridge_within_2_ms,
    a_supply_that_falls_as_the_bridge_closes_keeps_it_open,
    flash_is_untouched_until_the_supply_settled,
    a_supply_that_falls_ends_a_save_at_the_next_word,
    an_erasure_that_was_cut_short_is_repeated,
    a_cut_save_keeps_the_old_or_the_new_settings,
    a_full_area_of_settings_is_saved_to_in_time,
    an_erasure_that_ends_at_any_time_is_no_reset,
    an_output_that_is_no_number_opens_the_bridge,
    the_stack_of_the_image_is_what_the_manual_says,
    a_damaged_image_never_closes_the_bridge,
    a_stack_below_the_ram_is_a_fault_at_every_depth,
    a_power_on_is_no_fault_and_a_sag_is_one,
    a_sag_that_is_over_can_be_acknowledged,
    a_lock_up_opens_the_bridge,
    option_bytes_are_reported_and_in_force,
}
