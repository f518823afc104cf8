//! The bus of a board: its task, its registers, and its authority over the drive.

use core::cell::{Cell, RefCell};
use core::future::Future;
use core::pin::pin;
use core::task::{Context, Waker};
use std::boxed::Box;
use std::rc::Rc;
use std::vec::Vec;

use embassy_futures::block_on;
use kband::arithmetic::Noise;
use kband_control::wire::{Pin, Refusal, Request, Response};
use kband_control::{
    Cycle, Fault, Inputs, Limits, Recipe, RecipeName, Report, StartCause, State, Target,
};

use super::*;
use crate::exchange::Exchange;
use crate::last_words::LastWords;
use crate::store::{Condition, Found};
use crate::testing::with;

const UNIT: u8 = 17;
const FAULT: u16 = 6;
const SAVE: u16 = 9;

/// A board with its bus, without a task.
struct Board {
    station: Station,
    enable: bool,
}

impl Board {
    /// A board after power-on with this authority of the bus.
    fn new(bus: f32) -> Self {
        Self::started(bus, StartCause::PowerOn)
    }

    fn started(bus: f32, start: StartCause) -> Self {
        let exchange: &'static Exchange = Box::leak(Box::new(Exchange::empty()));
        let found = Found {
            settings: Settings {
                bus,
                bus_address: f32::from(UNIT),
                bus_timeout: 0.4,
                ..Settings::default()
            },
            target: Target::K(0.8),
            pin: None,
            condition: Condition::Whole,
            added: 0,
        };
        let controller = Station::controller(&found, start).unwrap();
        Self {
            station: Station::new(&found, start, &controller, exchange, LastWords::EMPTY),
            enable: true,
        }
    }

    /// Runs a drive cycle with a working sensor on a track that does not move.
    fn cycle(&self) -> Report {
        self.cycle_with(Inputs::default())
    }

    fn cycle_with(&self, inputs: Inputs) -> Report {
        let mut cycle = Cycle::default();
        (cycle.low, cycle.high, cycle.samples) = (2040, 2056, 400);
        let inputs = with(inputs, |it| it.enable = self.enable);
        self.station.cycle(&cycle, inputs).unwrap()
    }

    /// Runs until the controller detects that the track does not move.
    fn fail(&self) {
        let failed = (0..200).any(|_| {
            self.station.record_bus_request();
            self.cycle().state == State::Fault
        });
        assert!(failed);
    }

    /// Answer to a frame of this unit and PDU, without unit and checksum.
    fn ask(&mut self, pdu: &[u8]) -> Vec<u8> {
        let mut frame = Vec::from([UNIT]);
        frame.extend(pdu);
        frame.extend(rtu::crc(&frame).to_le_bytes());
        let mut answer = Answer::new();
        let mut registers = Registers {
            station: &self.station,
            image: "kband test",
            read_only: false,
        };
        let answered = self.station.with_bus_server(|server| {
            rtu::answer(server, UNIT, &frame, &mut registers, &mut answer)
        });
        assert!(answered);
        self.station.record_bus_request();
        rtu::check(&answer).unwrap()[1..].to_vec()
    }

    fn write(&mut self, address: u16, word: u16) -> Vec<u8> {
        let ([a, b], [c, d]) = (address.to_be_bytes(), word.to_be_bytes());
        self.ask(&[6, a, b, c, d])
    }

    /// Writes the control word and runs a drive cycle.
    fn control(&mut self, word: u16) -> Report {
        assert_eq!(self.write(0, word)[0], 6);
        self.cycle()
    }

    fn word(&mut self, address: u16) -> u16 {
        let [a, b] = address.to_be_bytes();
        let answer = self.ask(&[3, a, b, 0, 1]);
        u16::from_be_bytes([answer[2], answer[3]])
    }
}

#[test]
fn the_run_bit_starts_and_stops_with_the_enable_input() {
    let mut board = Board::new(1.0);
    board.enable = false;
    board.control(0);
    assert_eq!(board.control(1).state, State::Off, "no enable input");
    board.enable = true;
    assert_eq!(board.control(1).state, State::Off, "no edge with it");
    assert_eq!(board.word(4) & 0b11, 0b01, "ready");
    board.control(0);
    assert_eq!(board.control(1).state, State::Starting);
    assert_eq!(board.word(4) & 0b11, 0b10, "running");
    assert_eq!(board.control(0).state, State::Stopping);
    (0..100).for_each(|_| _ = board.cycle());
    assert_eq!(board.control(1).state, State::Starting);
    board.enable = false;
    assert_eq!(board.cycle().state, State::Stopping);
}

#[test]
fn a_run_bit_of_a_moment_stops_the_drive() {
    let mut board = Board::new(1.0);
    board.control(0);
    assert_eq!(board.control(1).state, State::Starting);
    // Both words within a drive cycle.
    board.write(0, 0);
    assert_eq!(board.control(1).state, State::Stopping);
}

#[test]
fn the_first_run_bit_after_power_on_starts_nothing() {
    let mut board = Board::new(1.0);
    for _ in 0..10 {
        assert_eq!(board.control(1).state, State::Off);
    }
    board.control(0);
    assert_eq!(board.control(1).state, State::Starting);
}

#[test]
fn only_authority_2_acknowledges_and_run_needs_an_edge() {
    let mut board = Board::new(1.0);
    board.control(0);
    board.control(1);
    board.fail();
    assert_eq!(board.word(FAULT), Fault::NoResponse.number().into());
    board.control(0);
    assert_eq!(board.write(0, 0x80), [0x86, 4]);
    assert_eq!(board.cycle().state, State::Fault);
    let mut board = Board::new(2.0);
    board.control(0);
    board.control(1);
    board.fail();
    assert_eq!(board.control(1).state, State::Fault);
    assert_eq!(board.control(0x81).state, State::Off);
    for _ in 0..10 {
        assert_eq!(board.control(0x81).state, State::Off);
    }
    board.control(0);
    assert_eq!(board.control(1).state, State::Starting);
    // Until the lock-out: the third fault within a minute.
    for fault in 2..=3 {
        board.fail();
        board.control(0);
        let state = board.control(0x80).state;
        assert_eq!(state == State::Fault, fault == 3);
        board.control(0);
        board.control(1);
    }
    // It ends as before.
    board.control(0);
    board.enable = false;
    for cycle in 1..=3000 {
        assert_eq!(board.cycle().state == State::Off, cycle == 3000);
    }
}

#[test]
fn a_cause_that_lasts_is_not_acknowledged() {
    let mut board = Board::new(2.0);
    board.control(0);
    board.control(1);
    let hot = with(Inputs::default(), |it| it.over_temperature = true);
    assert_eq!(board.cycle_with(hot).fault, Some(Fault::OverTemperature));
    board.write(0, 0);
    board.cycle_with(hot);
    board.write(0, 0x80);
    assert_eq!(board.cycle_with(hot).state, State::Fault);
    assert_eq!(board.cycle().state, State::Fault, "one edge, one attempt");
    board.control(0);
    assert_eq!(board.control(0x80).state, State::Off);
}

#[test]
fn a_silent_bus_in_control_is_a_lost_link() {
    let mut board = Board::new(1.0);
    board.control(0);
    // Amplitude 0, which the track at rest follows.
    board.ask(&[16, 0, 0, 0, 4, 8, 0, 1, 0, 33, 0, 0, 0, 0]);
    assert_eq!(board.cycle().state, State::Starting);
    let lost = |board: &Board| board.cycle().limits.contains(Limits::LINK_LOST);
    // The timeout is 20 cycles; the desk's frames do not count.
    let silent = (1..100).find(|_| {
        board.station.record_valid_frame();
        lost(&board)
    });
    assert_eq!(silent, Some(21));
    assert_eq!(board.word(7), 1 << 7);
    assert!(!lost(&board));
}

#[test]
fn a_save_waits_for_the_link_and_for_the_lock() {
    let mut board = Board::new(1.0);
    assert_eq!(board.write(SAVE, 1), [0x86, 4], "the lock is not known yet");
    board.station.set_writable(true);
    assert_eq!(board.write(SAVE, 1)[0], 6);
    assert_eq!(board.word(SAVE), 1);
    assert_eq!(board.write(SAVE, 1), [0x86, 6], "not done yet");
    board.station.end_save(true);
    assert_eq!(board.word(SAVE), 2);
    board.control(0);
    board.control(1);
    assert_eq!(board.write(SAVE, 1), [0x86, 6], "the drive runs");
    board.station.end_save(false);
    assert_eq!(board.word(SAVE), 3);
}

#[test]
fn control_that_passes_to_the_enable_input_starts_nothing() {
    let mut board = Board::new(1.0);
    board.control(0);
    let local = with(board.station.settings(), |it| it.bus = 0.0);
    board.station.set_settings(&local).unwrap();
    for _ in 0..10 {
        assert_eq!(board.cycle().state, State::Off);
    }
    board.enable = false;
    (0..30).for_each(|_| _ = board.cycle());
    board.enable = true;
    assert_eq!(board.cycle().state, State::Starting);
    assert_eq!(board.write(0, 0), [0x86, 4]);
}

#[test]
fn drawn_writes_start_nothing_without_the_enable_input() {
    let mut noise = Noise::new(17);
    for start in [StartCause::PowerOn, StartCause::Reset] {
        for _ in 0..200 {
            let mut board = Board::started(2.0, start);
            board.enable = false;
            board.station.set_writable(true);
            // Only the bus acknowledges within half a second.
            for _ in 0..20 {
                let words = 1 + noise.bits() % 4;
                let mut pdu = Vec::from([16, 0, 0, 0, words as u8, 2 * words as u8]);
                pdu.extend((0..words).flat_map(|word| match word {
                    0 => [0, (noise.bits() & 0x81) as u8],
                    1 => [0, (noise.bits() % 50) as u8],
                    _ => [0x3f, noise.bits() as u8],
                }));
                board.ask(&pdu);
                let report = board.cycle();
                assert_eq!(report.command.amplitude, 0.0);
                assert!(matches!(report.state, State::Off | State::Fault));
            }
        }
    }
}

/// A port that records the calls of the task.
#[derive(Clone, Default)]
struct Port {
    configured: Rc<RefCell<Vec<Option<LineConfig>>>>,
    sending: Rc<Cell<u32>>,
}

impl BusPort for Port {
    fn configure(&mut self, config: Option<LineConfig>) {
        self.configured.borrow_mut().push(config);
    }

    fn start_sending(&mut self) {
        self.sending.set(self.sending.get() + 1);
    }
}

#[test]
fn the_task_answers_its_unit_and_follows_the_settings() {
    let board = Board::new(1.0);
    let line = BusLine::listening();
    line.restart(1000);
    let port = Port::default();
    let mut task = pin!(bus(&line, port.clone(), &board.station, "kband test"));
    let mut poll = || {
        let _ = task.as_mut().poll(&mut Context::from_waker(Waker::noop()));
    };
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
    let config = LineConfig {
        unit: UNIT,
        baud: 19_200,
        parity: Parity::Even,
    };
    let mut settings = board.station.settings();
    (settings.bus_baud, settings.bus_parity) = (9600.0, 0.0);
    board.station.set_settings(&settings).unwrap();
    poll();
    settings.bus_address = 0.0;
    board.station.set_settings(&settings).unwrap();
    poll();
    let other = with(config, |it| (it.baud, it.parity) = (9_600, Parity::None));
    let wanted = [Some(config), Some(other), None];
    assert_eq!(wanted, port.configured.borrow()[..]);
}

#[test]
fn the_link_reads_while_the_bus_is_in_control() {
    use crate::link::tests::board_with;
    let mut board = board_with(Settings {
        bus: 1.0,
        bus_address: f32::from(UNIT),
        ..Settings::default()
    });
    for request in [
        Request::set("gain", 2.0),
        Request::Defaults,
        Request::Target(Target::K(0.5)),
        Request::Simulate {
            target: Target::K(0.5),
            start: StartCause::Ordinary,
        },
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
    board.ask(&Request::Get("gain"), |response| {
        assert!(matches!(response, Response::Setting(_)));
    });
    // A request of the bus to save is carried out by the link's task.
    assert!(board.station.request_save());
    block_on(board.service.serve_bus(&board.station));
    assert_eq!(board.station.save_progress(), kband_bus::SaveProgress::Done);
    assert!(board.station.is_writable());
    board.done(&Request::set("bus", 0.0));
    board.done(&Request::set("gain", 2.0));
}

/// Answer to a request of Modbus over the link, without its unit.
fn over_the_link(board: &mut crate::link::tests::Board, pdu: &[u8]) -> Vec<u8> {
    let adu: Vec<u8> = [UNIT].into_iter().chain(pdu.iter().copied()).collect();
    board.ask(&Request::Bus(&adu), |response| match response {
        Response::Bus(answer) => answer.get(1..).unwrap_or_default().to_vec(),
        other => panic!("{other:?}"),
    })
}

#[test]
fn a_request_over_the_link_is_one_of_the_bus() {
    use crate::link::tests::board_with;
    let mut board = board_with(Settings {
        bus: 2.0,
        bus_address: f32::from(UNIT),
        bus_timeout: 0.4,
        link_timeout: 0.0,
        ..Settings::default()
    });
    board.enable = true;
    assert_eq!(over_the_link(&mut board, &[3, 0, 5, 0, 1]), [3, 2, 0, 0]);
    assert_eq!(over_the_link(&mut board, &[3, 0, 99, 0, 1]), [0x83, 2]);
    assert!(over_the_link(&mut board, &[0]).is_empty());
    // An amplitude of 0 and the run bit; the line of the bus reads the same control word.
    for control in [0, 1] {
        let words = [16, 0, 0, 0, 4, 8, 0, control, 0, 33, 0, 0, 0, 0];
        assert_eq!(over_the_link(&mut board, &words), words[..5]);
        board.cycle();
    }
    assert_eq!(board.station.report().state, State::Starting);
    let own = board.station.with_bus_server(|server| server.counters());
    assert_eq!((own.requests, own.exceptions), (4, 1));
    // The bus is silent; other frames of the link do not count.
    let silent = (1..100).find(|_| {
        board.done(&Request::Alive);
        let limits = board.station.report().limits;
        limits.contains(Limits::LINK_LOST)
    });
    assert!(matches!(silent, Some(19..=22)), "{silent:?}");
    over_the_link(&mut board, &[3, 0, 5, 0, 1]);
    board.cycle();
    let limits = board.station.report().limits;
    assert!(!limits.contains(Limits::LINK_LOST));
}

#[test]
fn a_locked_link_reads_the_registers_only() {
    use crate::link::tests::board_with;
    let mut board = board_with(Settings {
        bus: 2.0,
        bus_address: f32::from(UNIT),
        ..Settings::default()
    });
    let pin = Pin::parse("4711").unwrap();
    board.done(&Request::Lock(Some(pin)));
    for written in [[6, 0, 0, 0, 0], [6, 0, 8, 0, 0], [6, 0, 1, 0, 1]] {
        assert_eq!(over_the_link(&mut board, &written), [0x86, 4]);
    }
    assert_eq!(over_the_link(&mut board, &[3, 0, 4, 0, 1])[2..], [0, 0]);
    board.done(&Request::Unlock(pin));
    assert_eq!(over_the_link(&mut board, &[6, 0, 0, 0, 0]).len(), 5);
}

#[test]
fn register_8_selects_a_recipe_where_the_bus_is_in_control() {
    let settings = with(Settings::default(), |it| it.restitution_high = 0.3);
    let recipe = (
        RecipeName::parse("caps").unwrap(),
        Recipe::of(Target::K(0.5), &settings),
    );
    let mut board = Board::new(1.0);
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
    let mut reader = Board::new(0.0);
    reader.station.set_recipe(2, Some(&recipe)).unwrap();
    assert_eq!(reader.write(8, 2), [0x86, 4]);
}
