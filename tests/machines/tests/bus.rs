//! The fieldbus of the flashed image: pins, times, authority, and effects on the drive.

use kband_control::wire::Request;
use kband_control::{Fault, Limits, State, Target};
use kband_machines::bus::{UNIT, float, frame, read, write};
use kband_machines::chip::gpio::Mode;
use kband_machines::chip::kind::Kind;
use kband_machines::chip::world::Event;
use kband_machines::chip::{DEADLINE, SAMPLE};
use kband_machines::hazards::Hazard;
use kband_machines::rig::{Act, Rig};
use kband_plant::Change;

/// A machine at rest under command of its bus; rate in baud.
fn machine(target: Target, baud: f32, parity: f32) -> Rig {
    board(Hazard::new("bus", 50.0, target), baud, parity)
}

fn board(mut hazard: Hazard, baud: f32, parity: f32) -> Rig {
    hazard.scene.settings.link_timeout = 0.0;
    let mut rig = hazard.commissioned(Kind::Stm32f405);
    rig.chip.board.fieldbus.other_end = (baud as u64, 11);
    for (key, value) in [
        ("bus_baud", baud),
        ("bus_parity", parity),
        ("bus_timeout", 0.6),
        ("bus_address", f32::from(UNIT)),
        ("bus", 1.0),
    ] {
        rig.request_done(&Request::set(key, value));
    }
    rig.request_done(&Request::Save);
    rig
}

/// A machine at rest whose bus has this authority.
fn under(target: Target, authority: f32) -> Rig {
    let mut rig = machine(target, 19_200.0, 2.0);
    rig.request_done(&Request::set("bus", authority));
    rig.request_done(&Request::Save);
    rig
}

fn started(target: Target, authority: f32) -> Rig {
    let mut rig = under(target, authority);
    assert_eq!(start(&mut rig), state(State::Starting));
    rig
}

/// Turns the enable input on, then the run bit.
fn start(rig: &mut Rig) -> u16 {
    control(rig, 0);
    rig.act(&Act::Enable(true)).run_for(0.2);
    control(rig, 1)
}

/// Writes the control word and waits for two drive cycles.
fn control(rig: &mut Rig, word: u16) -> u16 {
    rig.bus_write(0, &[word]);
    rig.run_for(0.04);
    rig.bus_word(5)
}

/// Polls the state for some time, s.
fn poll(rig: &mut Rig, seconds: f64) -> u16 {
    let end = rig.time() + seconds;
    while rig.time() < end {
        rig.run_for(0.1);
        rig.bus_word(5);
    }
    rig.bus_word(5)
}

fn state(state: State) -> u16 {
    state.number().into()
}

/// Edges of the driver's enable, ticks.
fn driver_edges(rig: &Rig) -> Vec<(u64, bool)> {
    let trace = rig.chip.board.world.trace.iter();
    let edges = trace.filter_map(|(time, event)| match event {
        Event::BusDriver(on) => Some((*time, *on)),
        _ => None,
    });
    edges.collect()
}

#[test]
fn the_driver_is_on_only_while_an_answer_leaves() {
    for (baud, parity) in [(9600.0, 2.0), (19_200.0, 1.0), (115_200.0, 0.0)] {
        // The plan of a capture keeps the control task busy.
        let mut rig = machine(Target::Locked { order: 1 }, baud, parity);
        let port = &rig.chip.board.ports[2];
        assert_eq!([10, 11].map(|pin| port.mode(pin)), [Mode::Function(8); 2]);
        assert_eq!(port.output(12), Some(false));
        assert_eq!(rig.chip.board.fieldbus.has_parity(), parity > 0.0);
        assert_eq!(driver_edges(&rig), [], "{baud}");
        assert_eq!(start(&mut rig), state(State::Starting));
        let character = rig.chip.board.fieldbus.other_byte();
        let silence = if baud > 19_200.0 {
            1.75e-3
        } else {
            38.5 / f64::from(baud)
        };
        for n in 0..80 {
            let before = driver_edges(&rig).len();
            let answered = rig.bus(&read(16, 32)).unwrap();
            assert_eq!(answered.pdu.len(), 66);
            assert!((silence..20e-3).contains(&answered.after), "{answered:?}");
            let edges = driver_edges(&rig)[before..].to_vec();
            let &[(on, true), (off, false)] = &edges[..] else {
                panic!("{edges:?}");
            };
            assert!(on <= answered.end - 69 * character, "{n}");
            let delays = answered.end..=answered.end + character;
            assert!(delays.contains(&off), "{off} {delays:?}");
            rig.run_for(1e-3 * f64::from(n % 7));
        }
        assert_eq!(rig.resets().len(), 1);
    }
}

#[test]
fn an_answer_waits_for_no_second_slice_of_planning() {
    let mut hazard = Hazard::new("bus plans", 50.0, Target::Gear { order: 1 });
    hazard.scene = kband_plant::Scene::default();
    let mut rig = board(hazard, 115_200.0, 2.0);
    start(&mut rig);
    for n in 0..150 {
        let answered = rig.bus(&read(4, 4)).unwrap();
        assert!(answered.after < 20e-3, "{answered:?}");
        rig.run_for(1e-3 * f64::from(n * 7 % 23));
    }
    // In gear, the registers agree with the track.
    assert_eq!(poll(&mut rig, 4.0), state(State::Holding));
    let answer = rig.bus_answer(&read(32, 32));
    let float = |n: usize| f32::from_be_bytes(answer[2 + 4 * n..6 + 4 * n].try_into().unwrap());
    assert!((float(1) / rig.amplitude() as f32 - 1.0).abs() < 0.02);
    assert!(float(7) > 50.0, "share in gear {}", float(7));
    assert_eq!(rig.bus_word(4) & 1 << 8, 1 << 8, "the target is held");
}

#[test]
fn the_run_bit_runs_and_stops_with_the_enable_input() {
    let mut rig = under(Target::K(0.8), 1.0);
    control(&mut rig, 0);
    assert_eq!(control(&mut rig, 1), state(State::Off), "without the input");
    rig.act(&Act::Enable(true));
    assert_eq!(poll(&mut rig, 0.3), state(State::Off), "without an edge");
    assert_eq!(rig.bus_word(4) & 0b11, 0b01);
    control(&mut rig, 0);
    assert_eq!(control(&mut rig, 1), state(State::Starting));
    assert_eq!(poll(&mut rig, 1.0), state(State::Holding));
    assert!(rig.chip.is_driven());
    // A new target in one request.
    let [high, low] = float(0.1);
    rig.bus_write(1, &[33, high, low]);
    poll(&mut rig, 1.0);
    assert!((rig.amplitude() - 0.1).abs() < 2e-3, "{}", rig.amplitude());
    assert_eq!(control(&mut rig, 0), state(State::Stopping));
    assert_eq!(poll(&mut rig, 1.0), state(State::Off));
    assert!(!rig.chip.is_driven());
    // The enable input stops the drive, as without a bus.
    control(&mut rig, 1);
    assert!(rig.chip.is_driven());
    rig.act(&Act::Enable(false)).run_for(0.03);
    assert!(!rig.chip.is_driven());
    assert_eq!(rig.find_time(1.0, &Event::Fault(true)), None);
}

#[test]
fn a_set_run_bit_starts_nothing_after_power_on() {
    let mut rig = started(Target::K(0.8), 1.0);
    rig.power_cycle(0.1, 0.5);
    let since = rig.time();
    for enable in [true, false, true] {
        // As without a bus, the enable input must turn off once.
        rig.act(&Act::Enable(enable)).run_for(0.2);
        for _ in 0..3 {
            assert_eq!(control(&mut rig, 1), state(State::Off));
        }
    }
    assert_eq!(rig.find_time(since, &Event::Bridge(true)), None);
    control(&mut rig, 0);
    assert_eq!(control(&mut rig, 1), state(State::Starting));
}

#[test]
fn a_fault_is_acknowledged_with_authority_and_needs_an_edge() {
    let fails = |rig: &mut Rig| {
        rig.act(&Act::Plant(Change::SensorLost(true)));
        assert_eq!(poll(rig, 0.5), state(State::Fault));
        assert_eq!(rig.bus_word(6), u16::from(Fault::SensorLost.number()));
        rig.act(&Act::Plant(Change::SensorLost(false)));
    };
    for authority in [1.0, 2.0] {
        let mut rig = started(Target::K(0.8), authority);
        poll(&mut rig, 1.0);
        fails(&mut rig);
        control(&mut rig, 0);
        let answer = rig.bus_answer(&write(0, &[0x80]));
        rig.run_for(0.04);
        if authority == 1.0 {
            assert_eq!(answer, [0x90, 4]);
            assert_eq!(rig.bus_word(5), state(State::Fault));
            continue;
        }
        assert_eq!(rig.bus_word(5), state(State::Off));
        assert_eq!(control(&mut rig, 1), state(State::Starting), "an edge");
        fails(&mut rig);
        let since = rig.time();
        assert_eq!(control(&mut rig, 0x81), state(State::Off), "and no edge");
        assert_eq!(poll(&mut rig, 0.5), state(State::Off));
        assert_eq!(rig.find_time(since, &Event::Bridge(true)), None);
    }
}

#[test]
fn a_silent_bus_leads_to_the_safe_amplitude() {
    let mut rig = started(Target::Amplitude(0.3), 1.0);
    poll(&mut rig, 1.5);
    assert!((rig.amplitude() - 0.3).abs() < 6e-3);
    // Frames of the desk and of other units do not restart the timeout.
    for n in 0..30 {
        let frame = match n % 2 {
            0 => Act::Link(rig.frame(&Request::Alive)),
            _ => Act::Bus(frame(UNIT + 1, &read(0, 1))),
        };
        rig.act(&frame).run_for(0.05);
    }
    assert!((rig.amplitude() - 0.05).abs() < 2e-3, "{}", rig.amplitude());
    assert_eq!(rig.bus_word(7), Limits::LINK_LOST.bits());
    assert!(rig.chip.is_driven());
    poll(&mut rig, 1.5);
    assert!((rig.amplitude() - 0.3).abs() < 6e-3);
    assert_eq!(rig.bus_word(7), 0);
}

#[test]
fn without_authority_the_bus_reads_and_the_desk_commands() {
    let mut rig = under(Target::K(0.8), 0.0);
    for request in [
        write(0, &[0]),
        write(1, &[2]),
        write(9, &[1]),
        write(100, &float(60.0)),
    ] {
        assert_eq!(rig.bus_answer(&request), [0x90, 4]);
    }
    rig.request_done(&Request::Target(Target::K(0.5)));
    assert_eq!(rig.bus_word(1), 32);
    rig.act(&Act::Enable(true)).run_for(0.3);
    assert_eq!(rig.bus_word(5), state(State::Starting));
    assert_eq!(rig.bus_word(4) & 1 << 9, 0);
}

#[test]
fn a_save_over_the_bus_outlasts_a_power_cut() {
    let mut rig = under(Target::K(0.8), 1.0);
    rig.bus_write(1, &[2]);
    let frequency = float(60.0);
    rig.bus_write(100, &frequency);
    rig.bus_write(9, &[1]);
    rig.run_for(0.1);
    assert_eq!(rig.bus_word(9), 2);
    rig.power_cycle(0.1, 0.5);
    assert_eq!(rig.bus_word(1), 2);
    assert_eq!([100, 101].map(|at| rig.bus_word(at)), frequency);
    assert_eq!(rig.bus_word(9), 0);
}

#[test]
fn a_flooded_link_and_a_polling_master_delay_no_sample() {
    let mut rig = machine(Target::K(0.41), 115_200.0, 2.0);
    start(&mut rig);
    poll(&mut rig, 1.5);
    rig.request_done(&Request::Telemetry(2));
    rig.chip.forget_handlers();
    let began = rig.time();
    let mut answers = 0;
    for n in 0..100 {
        for request in [
            Request::Status,
            Request::Held,
            Request::Alive,
            Request::Get("gain"),
        ] {
            let frame = rig.frame(&request);
            rig.act(&Act::Link(frame));
        }
        let pdu = match n % 3 {
            0 => read(100, 90).to_vec(),
            1 => write(1, &[32, 0x3ed1, 0xeb85]),
            _ => vec![43, 14, 1, 0],
        };
        answers += u32::from(rig.bus(&pdu).is_some());
    }
    let samples = rig.chip.handler(SAMPLE);
    assert_eq!(answers, 100);
    assert!(samples.longest < DEADLINE);
    let surplus = samples.count as f64 - 20_000.0 * (rig.time() - began);
    assert!(surplus.abs() <= 2.0, "{surplus}");
    assert_eq!(rig.resets().len(), 1);
    assert_eq!(rig.opening_after(began), None);
    rig.act(&Act::Enable(false)).run_for(1.5);
    assert_eq!(rig.self_test().missed, 0);
}
