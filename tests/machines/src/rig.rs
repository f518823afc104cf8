//! Test rig for a board: the flashed image on its chip, the track on its bridge, and actions.

use std::collections::VecDeque;
use std::path::Path;

use kband_control::wire::{
    Counters, MAX_FRAME_BYTES, Outgoing, Receiver, Record, Request, Response, SavedSettings,
    SelfTest, Status, UpdateAnswer, UpdateRefusal, UpdateRequest, crc32, read_answer,
    write_identity_request, write_request, write_update_request,
};
use kband_plant::{Change, Scene};

use crate::chip::clocks::{Cause, TICKS};
use crate::chip::core::STACK;
use crate::chip::gpio::Wire;
use crate::chip::kind::Kind;
use crate::chip::world::{Event, World};
use crate::chip::{Chip, Hang, flash};
use crate::images;

#[derive(Clone, Debug, PartialEq)]
pub enum Act {
    /// The enable input (PB0), wired to 3.3 V or to 0 V.
    Enable(bool),
    /// The thermal switch (PB1): to ground, or open when hot.
    ThermalSwitch(bool),
    /// The over-current signal (PB12).
    OverCurrent(bool),
    /// Any pin: port, number, level.
    Wire(usize, usize, Wire),
    Plant(Change),
    /// Whether conversions are triggered.
    Converts(bool),
    CrystalStops,
    Volts(f64),
    Link(Vec<u8>),
    /// A master on the fieldbus sends these bytes.
    Bus(Vec<u8>),
    Hang(Hang),
    Halt,
    /// Continues the program at another address.
    Jump(u32),
    /// Sets the stack pointer after the interrupt in progress, and hangs the program: only the next
    /// interrupt uses that stack.
    Stack(u32),
    /// A stray write of the program.
    Store(u32, u32),
    /// Supply of the sensor over its nominal one.
    SensorSupply(f32),
    /// Drift of the sensor's voltage, V.
    SensorOffset(f32),
}

/// Ticks for a time in s.
pub fn ticks(seconds: f64) -> u64 {
    (seconds * TICKS as f64) as u64
}

#[derive(Clone, Debug)]
pub struct Rig {
    pub chip: Chip,
    acts: VecDeque<(u64, Act)>,
    sequence: u8,
    /// Whether a forbidden access is only recorded, without a panic.
    pub tolerant: bool,
}

/// Fill pattern of the start-up code for the stack.
const PAINT: [u8; 4] = [0xcc; 4];
/// Longest wait for an answer, s.
const ANSWER_TIMEOUT: f64 = 5.0;
/// Time before an unanswered request is repeated, s, as at the desk. A byte that ends between the
/// port interrupt's reads of status and data is lost.
const REPEAT_INTERVAL: f64 = 0.5;

impl Rig {
    /// Puts a chip on the rig without supply. Wired are the scene's track, a cool thermal switch
    /// and a low over-current signal.
    pub fn with(chip: Chip, scene: &Scene) -> Self {
        let mut rig = Self {
            chip,
            acts: VecDeque::new(),
            sequence: 0,
            tolerant: false,
        };
        rig.chip.power_off();
        rig.chip.board.now = 0;
        rig.chip.board.world = World::new(scene).expect("a scene that is accepted");
        rig.act(&Act::ThermalSwitch(true))
            .act(&Act::OverCurrent(false))
            .act(&Act::Enable(false));
        rig
    }

    /// Powers on a board with this chip and without settings, on the track of the default scene.
    pub fn boot_on(kind: Kind) -> Self {
        let mut rig = Self::with(chip_of(kind, &images::feeder_on(kind)), &Scene::default());
        rig.chip.power_on();
        rig
    }

    /// Schedules an action at a time in s.
    pub fn at(&mut self, seconds: f64, act: Act) -> &mut Self {
        let time = ticks(seconds);
        let place = self.acts.partition_point(|(other, _)| *other <= time);
        self.acts.insert(place, (time, act));
        self
    }

    pub fn time(&self) -> f64 {
        self.chip.board.now as f64 / TICKS as f64
    }

    pub fn run(&mut self, seconds: f64) -> &mut Self {
        let end = ticks(seconds);
        while self.chip.board.now < end {
            let next = self.acts.front().map_or(u64::MAX, |act| act.0);
            self.chip.run(end.min(next));
            let now = self.chip.board.now;
            while let Some((_, act)) = self.acts.pop_front_if(|(time, _)| *time <= now) {
                self.act(&act);
            }
        }
        let violations = &self.chip.board.world.violations;
        assert!(self.tolerant || violations.is_empty(), "{violations:?}");
        self
    }

    pub fn run_for(&mut self, seconds: f64) -> &mut Self {
        self.run(self.time() + seconds)
    }

    /// Runs in steps of some s until a condition is met, which takes less than `limit` s.
    #[track_caller]
    pub fn run_until(&mut self, step: f64, limit: f64, is_met: impl Fn(&Self) -> bool) {
        let end = self.time() + limit;
        while !is_met(self) {
            self.run_for(step);
            assert!(self.time() < end, "not within {limit} s");
        }
    }

    /// Switches the supply off for a time in s, and on again for another.
    pub fn power_cycle(&mut self, off: f64, on: f64) -> &mut Self {
        self.act(&Act::Volts(0.0)).run_for(off);
        self.act(&Act::Volts(3.3)).run_for(on)
    }

    /// Lets the desk send a frame every 0.3 s from one time on up to another, s.
    pub fn keep_link_alive(&mut self, from: f64, until: f64) {
        let times = (0..).map(|n| from + 0.3 * f64::from(n));
        for time in times.take_while(|time| *time < until) {
            let frame = self.frame(&Request::Alive);
            self.at(time, Act::Link(frame));
        }
    }

    pub fn act(&mut self, act: &Act) -> &mut Self {
        let board = &mut self.chip.board;
        let high = |on: bool| if on { Wire::High } else { Wire::Low };
        match act {
            Act::Enable(on) => board.set_wire(1, 0, high(*on)),
            Act::ThermalSwitch(true) => board.set_wire(1, 1, Wire::Low),
            Act::ThermalSwitch(false) => board.set_wire(1, 1, Wire::Open),
            Act::OverCurrent(on) => return self.act(&Act::Wire(1, 12, high(*on))),
            Act::Wire(port, pin, wire) => {
                board.set_wire(*port, *pin, *wire);
                board.break_input(false);
            }
            Act::Plant(change) => board.world.bench.apply(*change),
            Act::Converts(on) => board.converts = *on,
            Act::CrystalStops => board.crystal_stops(),
            Act::Volts(volts) => {
                let was = board.supplied;
                board.set_volts(*volts);
                if !was && board.reset.is_none() {
                    self.chip.supply_returns();
                }
            }
            Act::Link(bytes) => board.link.receive(board.now, bytes),
            Act::Bus(bytes) => board.fieldbus.receive(board.now, bytes),
            Act::Hang(hang) => self.chip.hangs = Some(*hang),
            Act::Halt => self.chip.debugger_halts(),
            Act::Jump(address) => self.chip.core.set_next_instruction(*address),
            Act::Stack(pointer) => {
                while self.chip.core.exception != 0 {
                    self.chip.run(self.chip.board.now + 1);
                }
                self.chip.core.r[STACK] = *pointer;
                self.chip.hangs = Some(Hang::Thread);
            }
            Act::Store(address, value) => {
                let _ = board.store(*address, 4, *value);
            }
            Act::SensorSupply(share) => board.world.sensor_supply = *share,
            Act::SensorOffset(volts) => board.world.sensor_offset = *volts,
        }
        self.chip.board.refresh();
        self
    }

    /// Time in s from `seconds` until the bridge opens; 0 if it is already open.
    pub fn opening_after(&self, seconds: f64) -> Option<f64> {
        let from = ticks(seconds);
        let trace = &self.chip.board.world.trace;
        let bridge = |entry: &&(u64, Event)| matches!(entry.1, Event::Bridge(_));
        let before = trace.iter().rfind(|entry| entry.0 < from && bridge(entry));
        if !matches!(before, Some((_, Event::Bridge(true)))) {
            return Some(0.0);
        }
        let mut after = trace.iter().filter(|entry| entry.0 >= from);
        let opened = after.find(|entry| entry.1 == Event::Bridge(false));
        opened.map(|(time, _)| (time - from) as f64 / TICKS as f64)
    }

    /// Requires that the bridge opens less than `limit` s after `from` s, and then stays open.
    #[track_caller]
    pub fn assert_opens(&self, from: f64, limit: f64, name: &str) {
        let opens = self.opening_after(from);
        assert!(opens.is_some_and(|time| time < limit), "{name}: {opens:?}");
        assert_eq!(self.closes_after(from + limit), None, "{name}");
    }

    /// Time in s of the first event of this kind at or after `seconds`.
    pub fn find_time(&self, seconds: f64, event: &Event) -> Option<f64> {
        let from = ticks(seconds);
        let mut trace = self.chip.board.world.trace.iter();
        let entry = trace.find(|entry| entry.0 >= from && entry.1 == *event);
        entry.map(|(time, _)| *time as f64 / TICKS as f64)
    }

    /// Time in s at which the bridge closes, at or after `seconds`.
    pub fn closes_after(&self, seconds: f64) -> Option<f64> {
        self.find_time(seconds, &Event::Bridge(true))
    }

    /// Time in s at which the lamp FAULT turns on, at or after `seconds`.
    pub fn faults_after(&self, seconds: f64) -> Option<f64> {
        self.find_time(seconds, &Event::Fault(true))
    }

    /// Times in s and causes of the resets since the start.
    pub fn resets(&self) -> Vec<(f64, Cause)> {
        let trace = self.chip.board.world.trace.iter();
        let resets = trace.filter_map(|(time, event)| match event {
            Event::Reset(cause) => Some((*time as f64 / TICKS as f64, *cause)),
            _ => None,
        });
        resets.collect()
    }

    /// Amplitude of the track, mm.
    pub fn amplitude(&self) -> f64 {
        f64::from(self.chip.board.world.amplitude()) * 1e3
    }

    /// Largest displacement of the track since the last call, mm.
    pub fn peak(&mut self) -> f64 {
        f64::from(std::mem::take(&mut self.chip.board.world.peak)) * 1e3
    }

    /// Number of stack bytes, at the bottom of the RAM, that were never used since the start.
    pub fn stack_free(&self) -> usize {
        let words = self.chip.board.ram.chunks_exact(4);
        4 * words.take_while(|word| *word == PAINT).count()
    }

    /// Frame of a request with the next sequence number.
    pub fn frame(&mut self, request: &Request<'_>) -> Vec<u8> {
        self.sequence = self.sequence % 255 + 1;
        let mut buffer = [0; MAX_FRAME_BYTES];
        let frame = write_request(&mut buffer, self.sequence, request);
        frame.expect("a short request").to_vec()
    }

    /// Sends a request and runs for 10 ms without reading the answer.
    pub fn send(&mut self, request: &Request<'_>) -> &mut Self {
        let frame = self.frame(request);
        self.act(&Act::Link(frame)).run_for(0.01)
    }

    /// Sends a request and passes the board's answer to `look`.
    pub fn request<T>(&mut self, request: &Request<'_>, look: impl FnOnce(Response<'_>) -> T) -> T {
        let frame = self.frame(request);
        let (own, mut look) = (self.sequence, Some(look));
        let answer = self.exchange(&frame, |outgoing| match outgoing {
            (sequence, Outgoing::Response(response)) if sequence == own => {
                look.take().map(|look| look(response))
            }
            _ => None,
        });
        answer.unwrap_or_else(|| panic!("no answer to {request:?}"))
    }

    /// Frame of a request of an update with the next sequence number.
    pub fn update_frame(&mut self, request: &UpdateRequest<'_>) -> Vec<u8> {
        self.sequence = self.sequence % 255 + 1;
        let mut buffer = [0; MAX_FRAME_BYTES];
        let frame = write_update_request(&mut buffer, self.sequence, request);
        frame.expect("a short request").to_vec()
    }

    /// Sends a request for an update; returns the reason if the board refuses it.
    pub fn update(&mut self, request: &UpdateRequest<'_>) -> Result<(), UpdateRefusal> {
        let frame = self.update_frame(request);
        let own = self.sequence;
        let answer = self.exchange(&frame, |outgoing| match outgoing {
            (sequence, Outgoing::Update(answer)) if sequence == own => match answer {
                UpdateAnswer::Refused(why) => Some(Err(why)),
                _ => Some(Ok(())),
            },
            _ => None,
        });
        answer.unwrap_or_else(|| panic!("no answer to {request:?}"))
    }

    /// Name of the running image; `None` without an answer.
    pub fn image(&mut self) -> Option<String> {
        let mut buffer = [0; MAX_FRAME_BYTES];
        let frame = write_identity_request(&mut buffer, 0).expect("a short question");
        self.exchange(frame, |(_, outgoing)| match outgoing {
            Outgoing::Identity(identity) => Some(identity.image.to_owned()),
            _ => None,
        })
    }

    /// Sends a frame repeatedly until `read` accepts a response of the board, for 5 s of its time.
    fn exchange<T>(
        &mut self,
        frame: &[u8],
        mut read: impl FnMut((u8, Outgoing<'_>)) -> Option<T>,
    ) -> Option<T> {
        let frame = frame.to_vec();
        self.act(&Act::Link(frame.clone()));
        let mut receiver = Receiver::new();
        let mut seen = self.chip.board.link.sent.len();
        let end = self.time() + ANSWER_TIMEOUT;
        let mut knock = self.time() + REPEAT_INTERVAL;
        while self.time() < end {
            if self.time() >= knock {
                self.act(&Act::Link(frame.clone()));
                knock += REPEAT_INTERVAL;
            }
            self.run_for(1e-3);
            let sent = self.sent().split_off(seen);
            seen += sent.len();
            for byte in sent {
                if let Some(Ok(inside)) = receiver.push(byte)
                    && let Ok(outgoing) = read_answer(inside)
                    && let Some(answer) = read(outgoing)
                {
                    return Some(answer);
                }
            }
        }
        None
    }

    /// Sends a request that the board must accept.
    pub fn request_done(&mut self, request: &Request<'_>) -> &mut Self {
        self.request(request, |response| {
            assert_eq!(response, Response::Done, "{request:?}");
        });
        self
    }

    pub fn self_test(&mut self) -> SelfTest {
        self.request(&Request::SelfTest, |response| match response {
            Response::SelfTest(test) => test,
            other => panic!("{other:?}"),
        })
    }

    pub fn counters(&mut self) -> Counters {
        self.request(&Request::Counters, |response| match response {
            Response::Counters(counters) => counters,
            other => panic!("{other:?}"),
        })
    }

    /// Inputs and outputs of the board.
    pub fn status(&mut self) -> Status {
        self.request(&Request::Status, |response| match response {
            Response::Status(status) => status,
            other => panic!("{other:?}"),
        })
    }

    /// Condition of the settings in flash, by a self-test.
    pub fn stored(&mut self) -> SavedSettings {
        self.self_test().settings
    }

    /// Number of a stored fault of the board; 0 is the newest.
    pub fn stored_fault(&mut self, age: u8) -> Option<u8> {
        self.request(&Request::Fault(age), |response| match response {
            Response::Fault(fault) => fault.map(|fault| fault.fault),
            other => panic!("{other:?}"),
        })
    }

    /// Numbers of all stored faults of the board, newest first.
    pub fn stored_faults(&mut self) -> Vec<u8> {
        (0..).map_while(|age| self.stored_fault(age)).collect()
    }

    /// The events in the board's log.
    pub fn events(&mut self) -> Vec<Record> {
        let event = |number| {
            self.request(&Request::Event(number), |response| match response {
                Response::Event(record) => record,
                other => panic!("{other:?}"),
            })
        };
        (0..).map_while(event).collect()
    }

    /// Bytes that the board has sent over its link.
    pub fn sent(&self) -> Vec<u8> {
        let sent = self.chip.board.link.sent.iter();
        sent.map(|(_, byte)| *byte).collect()
    }
}

/// A chip without supply with an image whose checksum is filled in as `kband flash` does.
pub fn chip_of(kind: Kind, image: &Path) -> Chip {
    let mut chip = Chip::new(kind);
    let segments = images::segments(image);
    for (address, data) in &segments {
        let at = (address - flash::START) as usize;
        chip.flash_mut()[at..at + data.len()].copy_from_slice(data);
    }
    chip.board.bridge.reset();
    if let Some((address, data)) = segments.last()
        && data.ends_with(&[0xff; 4])
    {
        let check = (address - flash::START) as usize + data.len() - 4;
        let sum = image_check(kind, chip.flash(), check);
        chip.flash_mut()[check..check + 4].copy_from_slice(&sum.to_le_bytes());
    }
    chip.board.supplied = false;
    chip
}

/// Checksum of an image whose program ends at the offset `end` of the flash.
pub fn image_check(kind: Kind, flash: &[u8], end: usize) -> u32 {
    crc32(&flash[kind.facts().program..end])
}
