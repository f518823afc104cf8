//! The board's side of the link and its state: frames, drive cycles, power failures.

use std::cell::Cell;

use embassy_futures::block_on;
use kband_control::wire::{Outgoing, Response, SetUp, read_answer};
use kband_control::{Cycle, Event, Inputs, StartCause, State};
use kband_firmware::exchange::Exchange;
use kband_firmware::last_words::LastWords;
use kband_firmware::link::{Image, Service};
use kband_firmware::station::Station;
use kband_firmware::store::{Records, Store};
use kband_firmware::update::Slot;
use kband_firmware::waiting::Waiting;

use crate::Taker;
use crate::frames::{framed, framed_update, inside};
use crate::store::Flash;

static EXCHANGE: Exchange = Exchange::new();

const IMAGE: Image = Image {
    identity: "kband fuzzed",
    stack_free: || 1000,
    set_up: SetUp::default,
    line_rate: 11_520,
    strapped: || false,
    slot: Some(SLOT),
};

thread_local! {
    /// Number of operations of the slot's flash.
    static OPERATIONS: Cell<u32> = const { Cell::new(0) };
}

fn count_operation() -> bool {
    OPERATIONS.set(OPERATIONS.get() + 1);
    true
}

/// A slot that reads as erased. No input signs an image of it.
const SLOT: Slot = Slot {
    board: "stm32f405rg",
    size: 384 * 1024,
    sector: 128 * 1024,
    erase: |_| count_operation(),
    write: |_, _| count_operation(),
    read: |_, bytes| bytes.fill(0xff),
    on_trial: || false,
    mark: || panic!("an image without a signature is marked"),
    confirm: count_operation,
    has_room: || true,
    restart: || panic!("the board restarts"),
};

struct Board {
    service: Service<Records<Flash, Waiting>>,
    station: Station,
}

impl Board {
    fn start(flash: &Flash, start: StartCause) -> Self {
        let found = block_on(flash.records().load());
        let controller = Station::controller(&found, start).expect("what is found is accepted");
        Self {
            station: Station::new(&found, start, &controller, &EXCHANGE, LastWords::EMPTY),
            service: Service::new(IMAGE, flash.records(), found.pin),
        }
    }

    /// A drive cycle with a track amplitude of `per_cent` of the predicted one.
    fn cycle(&mut self, inputs: Inputs, per_cent: u8, readings: [u16; 2]) {
        let settings = self.station.settings();
        let report = self.station.report();
        let angular = core::f32::consts::TAU * report.frequency;
        let swing = settings.gain * 1e-5 * f32::from(per_cent) * report.command.amplitude;
        let [low, high] = readings;
        let cycle = Cycle {
            low,
            high,
            samples: (20_000.0 / report.frequency.max(5.0)) as u16,
            quadrature: -swing * angular * angular,
            ..Cycle::default()
        };
        if let Some(report) = self.station.cycle(&cycle, inputs) {
            let command = report.command;
            assert!((0.0..=settings.output_maximum).contains(&command.amplitude));
            if matches!(report.state, State::Off | State::Fault) {
                assert!(command.amplitude == 0.0 && command.immediate);
            }
            // If it acknowledges another fault, this one is reported in the next cycle.
            let acknowledged = report
                .events
                .iter()
                .any(|event| event == Event::Acknowledged);
            assert!(!inputs.stack_low || report.state == State::Fault || acknowledged);
            assert!(!(acknowledged && inputs.enable));
        }
        self.station.plan_step();
        let _ = self.service.tick(&self.station);
        block_on(self.service.keep_fault(&self.station));
    }

    /// The frame that answers these bytes, if any.
    fn take(&mut self, bytes: &[u8]) -> Option<Vec<u8>> {
        let mut answer = None;
        for byte in bytes {
            if let Some(frame) = block_on(self.service.take(*byte, &self.station)) {
                answer = Some(frame.to_vec());
            }
        }
        answer
    }

    /// A frame with a valid checksum: it is counted, and a refused one has no effect.
    fn ask(&mut self, sequence: u8, frame: Option<Vec<u8>>) -> bool {
        let Some(frame) = frame else {
            return false;
        };
        let operations = OPERATIONS.get();
        // Ends any frame before it.
        let _ = self.take(&[0]);
        let (station, service) = (&self.station, &self.service);
        let (settings, target) = (station.settings(), station.target());
        let (counted, at_rest) = (service.counters().frames(), station.at_rest());
        let answer = self.take(&frame);
        let (station, service) = (&self.station, &self.service);
        assert_eq!(service.counters().frames(), counted + 1);
        station
            .settings()
            .check()
            .expect("settings in use are accepted");
        let kept = settings == station.settings();
        assert!(kept || at_rest, "settings changed while the drive runs");
        let written = OPERATIONS.get() != operations;
        assert!(!written || at_rest, "the slot changed while the drive runs");
        let Some(answer) = answer else {
            assert!(kept && target == station.target());
            return false;
        };
        match read_answer(&inside(&answer)).expect("an answer is known") {
            Outgoing::Response {
                sequence: same,
                response,
            } => {
                assert_eq!(same, sequence);
                if let Response::Refused(_) = response {
                    assert!(kept && target == station.target(), "{response:?}");
                    return false;
                }
                true
            }
            Outgoing::Identity { .. } | Outgoing::Update { .. } => true,
        }
    }
}

/// A sequence of events for a board.
pub fn service(input: &[u8]) -> bool {
    let flash = Flash::default();
    let mut board = Board::start(&flash, StartCause::Ordinary);
    let mut input = Taker(input);
    let mut known = false;
    let mut inputs = Inputs::default();
    while let Some(what) = input.byte() {
        match what % 8 {
            0 => {
                let piece = input.piece().unwrap_or(&[]);
                let _ = board.take(piece);
            }
            1..=4 => {
                let piece = input.piece().unwrap_or(&[]);
                let frame = if what % 16 == 12 {
                    framed_update
                } else {
                    framed
                };
                known |= board.ask(what, frame(what, piece));
            }
            5 => {
                let bits = input.byte().unwrap_or(0);
                inputs = Inputs {
                    enable: bits & 1 != 0,
                    link_heard: bits & 2 != 0,
                    over_temperature: bits & 0xc == 0xc,
                    over_current: bits & 0x18 == 0x18,
                    stack_low: bits & 0x30 == 0x30,
                    control_late: bits & 0x60 == 0x60,
                    supply_low: bits & 0xc0 == 0xc0,
                    clock_failed: bits & 0x84 == 0x84,
                    withheld: false,
                    held_off: bits & 0x41 == 0x41,
                    chatters: bits & 0x90 == 0x90,
                    bus: None,
                };
            }
            6 => {
                let per_cent = input.byte().unwrap_or(100);
                let wild = input.byte().unwrap_or(0);
                let readings = match wild {
                    250.. => [0, 4095],
                    240.. => [2048; 2],
                    _ => [2000, 2100],
                };
                for _ in 0..=wild % 64 {
                    board.cycle(inputs, per_cent, readings);
                }
            }
            _ => {
                let start = [
                    StartCause::Ordinary,
                    StartCause::PowerOn,
                    StartCause::Reset,
                    StartCause::Refused,
                ];
                let which = usize::from(input.byte().unwrap_or(0));
                board = Board::start(&flash, start[which % start.len()]);
            }
        }
    }
    known
}
