//! The bus of a board: its task, its registers, and its authority over the drive.

use super::*;
use crate::link::tests::{Board, board_with, simulate};
use crate::storage::store::LoadedSettings;
use crate::testing::with;
use core::cell::{Cell, RefCell};
use core::pin::pin;
use embassy_futures::{block_on, poll_once};
use kband::arithmetic::Noise;
use kband_bus::SaveProgress;
use kband_control::wire::{Pin, Refusal, Request, Response};
use kband_control::{Limits, Recipe, RecipeName, StartCause, State, Target};
use std::vec::Vec;

const UNIT: u8 = 17;
const SAVE: u16 = 9;

fn settings(bus: f32) -> Settings {
    Settings {
        bus,
        bus_address: f32::from(UNIT),
        bus_timeout: 0.4,
        ..Settings::default()
    }
}

/// A board after power-on with this authority of the bus, and its enable input on.
fn with_authority(bus: f32) -> Board {
    started(bus, StartCause::PowerOn)
}

fn started(bus: f32, start: StartCause) -> Board {
    let loaded = LoadedSettings::whole(settings(bus), Target::K(0.8));
    with(Board::started(loaded, start), |it| it.enable = true)
}

impl Board {
    /// Answer to a PDU, without the unit; empty without an answer.
    fn modbus(&mut self, pdu: &[u8]) -> Vec<u8> {
        let adu: Vec<u8> = [UNIT].into_iter().chain(pdu.iter().copied()).collect();
        match self.ask_now(&Request::Bus(&adu)) {
            Response::Bus(answer) => answer.get(1..).unwrap_or_default().to_vec(),
            other => panic!("{other:?}"),
        }
    }

    fn write(&mut self, address: u16, word: u16) -> Vec<u8> {
        let ([a, b], [c, d]) = (address.to_be_bytes(), word.to_be_bytes());
        self.modbus(&[6, a, b, c, d])
    }

    fn word(&mut self, address: u16) -> u16 {
        let [a, b] = address.to_be_bytes();
        let answer = self.modbus(&[3, a, b, 0, 1]);
        u16::from_be_bytes([answer[2], answer[3]])
    }

    fn control(&mut self, word: u16) -> State {
        assert_eq!(self.write(0, word)[0], 6);
        self.cycle();
        self.state()
    }
}

#[test]
fn the_run_bit_starts_and_stops_with_the_enable_input() {
    let mut board = with_authority(1.0);
    board.enable = false;
    board.control(0);
    assert_eq!(board.control(1), State::Off, "no enable input");
    board.enable = true;
    assert_eq!(board.control(1), State::Off, "no edge with it");
    assert_eq!(board.word(4) & 0b11, 0b01, "ready");
    board.control(0);
    assert_eq!(board.control(1), State::Starting);
    assert_eq!(board.word(4) & 0b11, 0b10, "running");
    assert_eq!(board.control(0), State::Stopping);
    board.run(true, 100);
    assert_eq!(board.control(1), State::Starting);
    board.run(false, 1);
    assert_eq!(board.state(), State::Stopping);
}

#[test]
fn drawn_writes_start_nothing_without_the_enable_input() {
    let mut noise = Noise::new(17);
    for start in [StartCause::PowerOn, StartCause::Reset] {
        for _ in 0..200 {
            let mut board = started(2.0, start);
            board.enable = false;
            board.station.bus.writable.set(true);
            // Only the bus acknowledges within half a second.
            for _ in 0..20 {
                let words = 1 + noise.bits() % 4;
                let mut pdu = Vec::from([16, 0, 0, 0, words as u8, 2 * words as u8]);
                pdu.extend((0..words).flat_map(|word| match word {
                    0 => [0, (noise.bits() & 0x81) as u8],
                    1 => [0, (noise.bits() % 50) as u8],
                    _ => [0x3f, noise.bits() as u8],
                }));
                board.modbus(&pdu);
                board.cycle();
                let report = board.station.report();
                assert_eq!(report.command.amplitude, 0.0);
                assert!(matches!(report.state, State::Off | State::Fault));
            }
        }
    }
}

/// A port that records the calls of the task.
#[derive(Default)]
struct Port {
    configured: RefCell<Vec<Option<LineConfig>>>,
    sending: Cell<u32>,
}

impl BusPort for &Port {
    fn configure(&mut self, config: Option<LineConfig>) {
        self.configured.borrow_mut().push(config);
    }

    fn start_sending(&mut self) {
        self.sending.set(self.sending.get() + 1);
    }
}

#[test]
fn the_task_answers_its_unit_and_follows_the_settings() {
    let board = with_authority(1.0);
    let line = &board.station.exchange.bus;
    line.restart(1000);
    let port = Port::default();
    let mut task = pin!(bus(&port, &board.station, "kband test"));
    let mut poll = || _ = poll_once(task.as_mut());
    let mut now = 0_u32;
    let mut send = |unit: u8| {
        let mut frame = Vec::from([unit, 3, 0, 5, 0, 1]);
        frame.extend(rtu::crc(&frame).to_le_bytes());
        for byte in frame {
            now += 100;
            line.receive(Some(byte), now);
        }
        now += 1000;
        line.poll(now);
    };
    poll();
    send(UNIT);
    assert!(line.is_waiting());
    poll();
    let answer: Vec<u8> = core::iter::from_fn(|| line.next()).collect();
    assert_eq!(rtu::check(&answer), Some(&[UNIT, 3, 2, 0, 0][..]));
    assert_eq!(port.sending.get(), 1);
    line.end_sending();
    for other in [0, UNIT + 1] {
        send(other);
        poll();
        assert!(!line.is_waiting());
        assert_eq!(line.next(), None);
    }
    assert_eq!(port.sending.get(), 1);
    let line_config = |baud, parity| {
        let unit = UNIT;
        Some(LineConfig { unit, baud, parity })
    };
    let mut settings = board.station.settings();
    (settings.bus_baud, settings.bus_parity) = (9600.0, 0.0);
    board.station.set_settings(&settings).unwrap();
    poll();
    settings.bus_address = 0.0;
    board.station.set_settings(&settings).unwrap();
    poll();
    let first = line_config(19_200, Parity::Even);
    let expected = [first, line_config(9_600, Parity::None), None];
    assert_eq!(expected, port.configured.borrow()[..]);
}

#[test]
fn the_link_reads_while_the_bus_is_in_control() {
    let mut board = board_with(settings(1.0));
    for request in [
        Request::set("gain", 2.0),
        Request::Defaults,
        Request::Target(Target::K(0.5)),
        simulate(Target::K(0.5)),
    ] {
        board.refused(&request, Refusal::NotInControl);
    }
    for request in [
        Request::Enable(false),
        Request::Enable(true),
        Request::Save,
        Request::Lock(Pin::parse("4711")),
        Request::Unlock(Pin::parse("4711").unwrap()),
    ] {
        board.done(&request);
    }
    let read = board.ask(&Request::Get("gain"));
    assert!(matches!(read, Response::Setting(_)));
    // The link's task permits a save that the bus requests, and carries it out.
    assert_eq!(board.write(SAVE, 1), [0x86, 4], "the lock is not known yet");
    block_on(board.service.serve_bus(&board.station));
    assert_eq!((board.write(SAVE, 1)[0], board.word(SAVE)), (6, 1));
    assert_eq!(board.write(SAVE, 1), [0x86, 6], "not done yet");
    block_on(board.service.serve_bus(&board.station));
    assert_eq!(board.word(SAVE), 2);
    board.station.bus.save.set(SaveProgress::Failed);
    assert_eq!(board.word(SAVE), 3);
    board.done(&Request::set("bus", 0.0));
    board.done(&Request::set("gain", 2.0));
}

#[test]
fn a_request_over_the_link_is_one_of_the_bus() {
    let mut board = board_with(with(settings(2.0), |it| it.link_timeout = 0.0));
    board.enable = true;
    assert_eq!(board.modbus(&[3, 0, 5, 0, 1]), [3, 2, 0, 0]);
    assert_eq!(board.modbus(&[3, 0, 99, 0, 1]), [0x83, 2]);
    assert!(board.modbus(&[0]).is_empty());
    // An amplitude of 0 and the run bit; the line of the bus reads the same control word.
    for control in [0, 1] {
        let words = [16, 0, 0, 0, 4, 8, 0, control, 0, 33, 0, 0, 0, 0];
        assert_eq!(board.modbus(&words), words[..5]);
        board.cycle();
    }
    assert_eq!(board.station.report().state, State::Starting);
    let counters = board.station.bus.server.borrow().counters();
    assert_eq!((counters.requests, counters.exceptions), (4, 1));
    // The bus is silent; other frames of the link do not count.
    let silent = (1..100).find(|_| {
        board.done(&Request::Alive);
        board.station.report().limits.contains(Limits::LINK_LOST)
    });
    assert!(matches!(silent, Some(19..=22)), "{silent:?}");
    board.modbus(&[3, 0, 5, 0, 1]);
    board.cycle();
    assert!(!board.station.report().limits.contains(Limits::LINK_LOST));
}

#[test]
fn a_locked_link_reads_the_registers_only() {
    let mut board = board_with(settings(2.0));
    let pin = Pin::parse("4711").unwrap();
    board.done(&Request::Lock(Some(pin)));
    for written in [[6, 0, 0, 0, 0], [6, 0, 8, 0, 0], [6, 0, 1, 0, 1]] {
        assert_eq!(board.modbus(&written), [0x86, 4]);
    }
    assert_eq!(board.modbus(&[3, 0, 4, 0, 1])[2..], [0, 0]);
    board.done(&Request::Unlock(pin));
    assert_eq!(board.modbus(&[6, 0, 0, 0, 0]).len(), 5);
}

#[test]
fn register_8_selects_a_recipe_where_the_bus_is_in_control() {
    let settings = with(Settings::default(), |it| it.restitution_high = 0.3);
    let name = RecipeName::parse("caps").unwrap();
    let recipe = (name, Recipe::of(Target::K(0.5), &settings));
    let mut board = with_authority(1.0);
    board.cycle();
    board.station.set_recipe(2, Some(&recipe)).unwrap();
    assert_eq!(board.word(8), 0);
    assert_eq!(board.write(8, 2)[0], 6);
    assert_eq!((board.word(8), board.station.target()), (2, Target::K(0.5)));
    assert_eq!(board.station.settings().restitution_high, 0.3);
    // A missing recipe: an exception, and the recipe in use stays.
    for missing in [1, 8, 0x102] {
        assert_eq!(board.write(8, missing), [0x86, 3]);
    }
    assert_eq!((board.word(8), board.station.target()), (2, Target::K(0.5)));
    // The inputs select nothing now.
    board.station.follow_inputs(0);
    board.station.follow_inputs(1);
    assert_eq!(board.word(8), 2);
    assert_eq!(board.write(8, 0)[0], 6);
    assert_eq!((board.word(8), board.station.target()), (0, Target::K(0.8)));
}
