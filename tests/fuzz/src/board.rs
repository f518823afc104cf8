//! The board's side of the link and its state: frames, drive cycles, power failures.

use crate::Reader;
use crate::desk;
use crate::frames::{framed, framed_update, payload};
use crate::store::Flash;
use embassy_futures::block_on;
use kband_control::wire::{
    Incoming, MAX_FRAME_BYTES, Outgoing, Request, Response, SetUp, Stored, read_answer,
    read_request, write_request,
};
use kband_control::{Cycle, Event, Inputs, StartCause, State};
use kband_firmware::exchange::Exchange;
use kband_firmware::link::{Image, Service};
use kband_firmware::station::Station;
use kband_firmware::storage::last_words::LastWords;
use kband_firmware::storage::store::LoadedSettings;
use kband_firmware::storage::waiting::Waiting;
use kband_firmware::update::{SecondSlot, Slot, Writer};
use std::cell::Cell;

/// Words of events.
pub const WORDS: &str = "amplitude_limit|gain|output_maximum|stm32f405rg";

static EXCHANGE: Exchange = Exchange::empty();

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

/// A slot that reads as erased. No input has a valid signature.
const SLOT: Slot = Slot {
    board: "stm32f405rg",
    size: 384 * 1024,
    restart: || panic!("the board restarts"),
    writer: Writer::Program(SecondSlot {
        sector: 128 * 1024,
        erase: |_| count_operation(),
        write: |_, _| count_operation(),
        read: |_, bytes| bytes.fill(0xff),
        on_trial: || false,
        mark: || panic!("an image without a signature is marked"),
        confirm: count_operation,
        has_room: || true,
    }),
};

struct Board {
    service: Service<Flash, Waiting>,
    station: Station,
    /// Content that the next start must find, unless a save was refused or unobserved.
    saved: Option<LoadedSettings>,
}

impl Board {
    /// Starts a board whose flash has power for this number of further words.
    fn start(flash: &Flash, start: StartCause, words: usize) -> Self {
        flash.power(usize::MAX);
        let loaded = block_on(flash.records().load());
        flash.power(words);
        let controller = Station::controller(&loaded, start).expect("what is found is accepted");
        Self {
            station: Station::new(&loaded, &controller, &EXCHANGE, LastWords::EMPTY),
            service: Service::new(IMAGE, flash.records(), loaded.pin),
            saved: Some(loaded),
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
            // If the fault of this cycle is acknowledged, another one may be reported in the next
            // cycle.
            let mut events = report.events.iter();
            let acknowledged = events.any(|event| event == Event::Acknowledged);
            assert!(!inputs.stack_low || report.state == State::Fault || acknowledged);
            assert!(!(acknowledged && inputs.enable));
        }
        self.station.plan_step();
        let _ = self.service.tick(&self.station);
        block_on(self.service.keep_fault(&self.station));
    }

    /// Response of the board to these bytes, if any.
    fn take(&mut self, bytes: &[u8]) -> Option<Vec<u8>> {
        bytes.iter().fold(None, |answer, byte| {
            let frame = block_on(self.service.take(*byte, &self.station));
            frame.map(<[u8]>::to_vec).or(answer)
        })
    }

    /// Sends a frame with a valid checksum: it is counted, and a refused one has no effect.
    fn process(&mut self, sequence: u8, frame: Option<Vec<u8>>) -> bool {
        let Some(frame) = frame else {
            return false;
        };
        let operations = OPERATIONS.get();
        // Ends any previous frame.
        let _ = self.take(&[0]);
        let (station, service) = (&self.station, &self.service);
        let (settings, target) = (station.settings(), station.target());
        let (counted, at_rest) = (service.counters.frames(), station.at_rest());
        let answer = self.take(&frame);
        let (station, service) = (&self.station, &self.service);
        assert_eq!(service.counters.frames(), counted + 1);
        let in_use = station.settings().check();
        in_use.expect("settings in use are accepted");
        let saves = matches!(
            read_request(&payload(&frame)),
            Ok((_, Incoming::Request(Request::Save | Request::Lock(_))))
        );
        if saves {
            self.saved = None;
        }
        let unchanged = settings == station.settings();
        let kept = unchanged || at_rest;
        assert!(kept, "settings changed while the drive runs");
        let written = OPERATIONS.get() != operations;
        assert!(!written || at_rest, "the slot changed while the drive runs");
        let Some(answer) = answer else {
            assert!(unchanged && target == station.target());
            return false;
        };
        let answer = payload(&answer);
        let answer = read_answer(&answer).expect("an answer is known");
        let (same, Outgoing::Response(response)) = answer else {
            return true;
        };
        assert_eq!(same, sequence);
        if let Response::Refused(_) = response {
            assert!(unchanged && target == station.target(), "{response:?}");
            return false;
        }
        if saves {
            self.saved = Some(LoadedSettings::whole(settings, target));
        }
        true
    }
}

/// A sequence of events for a board.
pub fn service(input: &[u8]) -> bool {
    let flash = Flash::default();
    let mut board = Board::start(&flash, StartCause::Ordinary, usize::MAX);
    let mut input = Reader(input);
    let mut is_valid = false;
    let mut inputs = Inputs::default();
    while let Some(what) = input.byte() {
        match what % 8 {
            0 => {
                let piece = input.piece().unwrap_or(&[]);
                let counted = board.service.counters.requests;
                let _ = board.take(piece);
                if board.service.counters.requests != counted {
                    board.saved = None;
                }
            }
            1..=4 => {
                let piece = input.piece().unwrap_or(&[]);
                let update = what % 16 == 12;
                let frame = if update { framed_update } else { framed };
                is_valid |= board.process(what, frame(what, piece));
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
                use StartCause::{Ordinary, PowerOn, Refused, Reset};
                let start = [Ordinary, PowerOn, Reset, Refused];
                let which = usize::from(input.byte().unwrap_or(0));
                // In half of the runs the power fails during a flash operation.
                let words = [usize::MAX, 8 * which][which / 128];
                let saved = board.saved;
                board = Board::start(&flash, start[which % start.len()], words);
                if let (Some(saved), Some(loaded)) = (saved, board.saved) {
                    assert_eq!(saved.settings, loaded.settings);
                    assert_eq!(saved.target, loaded.target);
                }
            }
        }
    }
    is_valid
}

/// Recipes of a file up to the first zero, then messages about recipes: kind of request, and its
/// content. A board at rest returns each recipe that it accepted.
pub fn recipes(input: &[u8]) -> bool {
    let mut parts = input.splitn(2, |byte| *byte == 0);
    let [file, messages] = [(); 2].map(|()| parts.next().unwrap_or(&[]));
    let flash = Flash::default();
    let mut board = Board::start(&flash, StartCause::Ordinary, usize::MAX);
    let written = |request: &Request<'_>| {
        let mut buffer = [0; MAX_FRAME_BYTES];
        write_request(&mut buffer, 1, request).map_or(Vec::new(), <[u8]>::to_vec)
    };
    let entries = desk::recipes(file);
    for &(number, name, recipe) in &entries {
        let set = Request::SetRecipe {
            number,
            recipe: Some((name, recipe)),
        };
        if board.process(1, Some(written(&set))) {
            let answer = board.take(&written(&Request::Recipe(number)));
            let answer = payload(&answer.expect("an answer"));
            let Ok((_, Outgoing::Response(response))) = read_answer(&answer) else {
                panic!("an answer");
            };
            assert_eq!(response, Response::Recipe(Stored::Recipe(name, recipe)));
            board.process(1, Some(written(&Request::UseRecipe(number))));
        }
    }
    let mut is_valid = !entries.is_empty();
    let requests = [
        Request::Recipe(1),
        Request::SetRecipe {
            number: 1,
            recipe: None,
        },
        Request::SaveRecipes,
        Request::UseRecipe(1),
    ];
    let mut messages = Reader(messages);
    while let Some(what) = messages.byte() {
        let content = messages.piece().unwrap_or(&[]);
        let request = payload(&written(&requests[usize::from(what) % requests.len()]));
        // After version, schema and sequence.
        let message = [&request[4..5], content].concat();
        is_valid |= board.process(what, framed(what, &message));
    }
    is_valid
}
