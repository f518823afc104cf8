//! The fieldbus of the flashed image: its pins and times, and its effects on the samples.

use kband_control::wire::{Request, Response};
use kband_control::{State, Target};
use kband_machines::bus::{UNIT, read, write};
use kband_machines::chip::SAMPLE;
use kband_machines::chip::gpio::Mode;
use kband_machines::chip::kind::Kind;
use kband_machines::chip::world::Seen;
use kband_machines::hazards::Hazard;
use kband_machines::rig::{Act, Rig};

/// Cycles of the core between two samples.
const DEADLINE: u64 = 8400;

/// A machine at rest whose bus commands; rate in baud.
fn machine(target: Target, baud: f32, parity: f32) -> Rig {
    let mut hazard = Hazard::of("bus", 50.0, target);
    hazard.scene.settings.link_timeout = 0.0;
    board(&hazard, baud, parity)
}

fn board(hazard: &Hazard, baud: f32, parity: f32) -> Rig {
    let mut rig = hazard.commissioned(Kind::Stm32f405);
    rig.chip.board.serials[3].other_end = (baud as u64, 11);
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

/// Writes the control word and lets two drive cycles pass.
fn control(rig: &mut Rig, word: u16) -> u16 {
    rig.bus_write(0, &[word]);
    rig.run(rig.time() + 0.04);
    rig.bus_word(5)
}

/// Polls the state for some time, s.
fn poll(rig: &mut Rig, seconds: f64) -> u16 {
    let end = rig.time() + seconds;
    while rig.time() < end {
        rig.run(rig.time() + 0.1);
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
    trace
        .filter_map(|(time, seen)| match seen {
            Seen::BusDriver(on) => Some((*time, *on)),
            _ => None,
        })
        .collect()
}

#[test]
fn the_driver_is_on_only_while_an_answer_leaves() {
    for (baud, parity) in [(9600.0, 2.0), (19_200.0, 1.0), (115_200.0, 0.0)] {
        // The plan of a capture keeps the control task busy.
        let mut rig = machine(Target::Locked { order: 1 }, baud, parity);
        let port = &rig.chip.board.ports[2];
        assert_eq!([10, 11].map(|pin| port.mode(pin)), [Mode::Function(8); 2]);
        assert_eq!(port.output(12), Some(false));
        assert_eq!(rig.chip.board.serials[3].has_parity(), parity > 0.0);
        assert_eq!(driver_edges(&rig), [], "{baud}");
        control(&mut rig, 0);
        rig.act(&Act::Enable(true));
        rig.run(rig.time() + 0.2);
        assert_eq!(control(&mut rig, 1), state(State::Starting));
        let character = rig.chip.board.serials[3].other_byte();
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
            let late = off.saturating_sub(answered.end);
            assert!(
                off >= answered.end && late <= character,
                "{late} {character}"
            );
            rig.run(rig.time() + 1e-3 * f64::from(n % 7));
        }
        assert_eq!(rig.resets().len(), 1);
    }
}

#[test]
fn an_answer_waits_for_no_second_slice_of_planning() {
    let mut hazard = Hazard::of("bus plans", 50.0, Target::Gear { order: 1 });
    hazard.scene = kband_plant::Scene::default();
    hazard.scene.settings.link_timeout = 0.0;
    let mut rig = board(&hazard, 115_200.0, 2.0);
    control(&mut rig, 0);
    rig.act(&Act::Enable(true));
    rig.run(rig.time() + 0.2);
    control(&mut rig, 1);
    let mut longest = 0.0_f64;
    for n in 0..150 {
        let answered = rig.bus(&read(4, 4)).unwrap();
        longest = longest.max(answered.after);
        rig.run(rig.time() + 1e-3 * f64::from(n * 7 % 23));
    }
    println!("longest {:.1} ms", 1e3 * longest);
    assert!(longest < 20e-3, "{longest}");
    // In gear, the readings agree with the track.
    assert_eq!(poll(&mut rig, 4.0), state(State::Holding));
    let words = rig.bus_answer(&read(32, 32));
    let float = |n: usize| f32::from_be_bytes(words[2 + 4 * n..6 + 4 * n].try_into().unwrap());
    assert!((float(1) / rig.amplitude() as f32 - 1.0).abs() < 0.02);
    assert!(float(7) > 50.0, "share in gear {}", float(7));
    assert_eq!(rig.bus_word(4) & 1 << 8, 1 << 8, "the target is held");
}

#[test]
fn a_flooded_link_and_a_polling_master_delay_no_sample() {
    let mut rig = machine(Target::K(0.41), 115_200.0, 2.0);
    control(&mut rig, 0);
    rig.act(&Act::Enable(true));
    rig.run(rig.time() + 0.2);
    control(&mut rig, 1);
    poll(&mut rig, 1.5);
    rig.request_done(&Request::Telemetry(2));
    rig.chip.forget_handlers();
    let began = rig.time();
    let mut answers = 0;
    for n in 0..100 {
        let requests = [
            Request::Status,
            Request::Held,
            Request::Alive,
            Request::Get("gain"),
        ];
        let link: Vec<u8> = requests
            .iter()
            .flat_map(|request| rig.frame(request))
            .collect();
        rig.act(&Act::Link(link));
        let pdu = match n % 3 {
            0 => read(100, 90).to_vec(),
            1 => write(1, &[32, 0x3ed1, 0xeb85]),
            _ => vec![43, 14, 1, 0],
        };
        answers += u32::from(rig.bus(&pdu).is_some());
    }
    let samples = rig.chip.handler(SAMPLE);
    println!(
        "{answers} answers in {:.1} s, longest sample {}",
        rig.time() - began,
        samples.longest
    );
    assert_eq!(answers, 100);
    assert!(samples.longest < DEADLINE);
    let lasted = rig.time() - began;
    assert!(
        (samples.count as f64 - 20_000.0 * lasted).abs() <= 2.0,
        "{}",
        samples.count
    );
    assert_eq!(rig.resets().len(), 1);
    assert_eq!(rig.opens_after(began), None);
    rig.act(&Act::Enable(false));
    rig.run(rig.time() + 1.5);
    let missed = rig.request(&Request::SelfTest, |response| match response {
        Response::SelfTest(test) => test.missed,
        other => panic!("{other:?}"),
    });
    assert_eq!(missed, 0);
}
