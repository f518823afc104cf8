//! Tests of the link's board side, with a controller behind it, at the desk.

use core::cell::Cell;
use core::pin::pin;
use core::task::{Context, Waker};
use std::boxed::Box;
use std::println;
use std::vec::Vec;

use embassy_futures::block_on;
use kband_control::wire::{
    KeptFault, Outgoing, Status, Stored, read_answer, write_question, write_request,
};
use kband_control::{Cycle, Event, Inputs, Recipe, RecipeName, StartCause, State, Target};

use super::*;
use crate::exchange::Exchange;
use crate::last_words::LastWords;
use crate::recipes::Recipes;
use crate::store::{Found, StoreFailed};
use crate::testing::with;

pub(crate) struct Memory {
    found: Found,
    recipes: Recipes,
    faults: Vec<KeptFault>,
    supply_good: bool,
    key: Option<[u8; 32]>,
}

impl Memory {
    fn of(found: Found) -> Self {
        Self {
            found,
            recipes: Recipes::default(),
            faults: Vec::new(),
            supply_good: true,
            key: None,
        }
    }
}

impl Store for Memory {
    async fn load(&mut self) -> Found {
        self.found
    }

    async fn save(
        &mut self,
        settings: &Settings,
        target: Target,
        pin: Option<Pin>,
    ) -> Result<(), StoreFailed> {
        self.found = Found {
            settings: *settings,
            target,
            pin,
            ..Found::none(Condition::Whole)
        };
        Ok(())
    }

    async fn recipes(&mut self) -> Recipes {
        self.recipes.clone()
    }

    async fn save_recipes(&mut self, recipes: &Recipes) -> Result<(), StoreFailed> {
        if self.found.condition != Condition::Whole {
            return Err(StoreFailed::NoSettings);
        }
        self.recipes = recipes.clone();
        Ok(())
    }

    async fn key(&mut self) -> Option<[u8; 32]> {
        self.key
    }

    async fn save_key(&mut self, key: &[u8; 32]) -> Result<(), StoreFailed> {
        self.key = Some(*key);
        Ok(())
    }

    fn supply_is_good(&self) -> bool {
        self.supply_good
    }

    fn take_fault(&mut self, fault: &KeptFault) {
        self.faults.insert(0, *fault);
    }

    async fn keep_faults(&mut self) {}

    async fn fault(&mut self, back: u32) -> Option<KeptFault> {
        self.faults.get(back as usize).copied()
    }
}

const FOUND: fn(Condition) -> Found = |condition| Found {
    target: Target::Locked { order: 1 },
    ..Found::none(condition)
};

const IMAGE: Image = Image {
    identity: "kband test",
    stack_free: || 1000,
    set_up: SetUp::default,
    line_rate: 11_520,
    strapped: || false,
    slot: None,
};

const SIMULATE: Request<'static> = Request::Simulate {
    target: Target::Locked { order: 1 },
    start: StartCause::Ordinary,
};

pub(crate) struct Board {
    pub service: Service<Memory>,
    pub station: Station,
    pub enable: bool,
    /// Mean acceleration, m/s^2.
    mean: f32,
}

pub(crate) fn board_with(settings: Settings) -> Board {
    Board::with(with(FOUND(Condition::Whole), |it| it.settings = settings))
}

impl Board {
    fn new() -> Self {
        Self::with(FOUND(Condition::Whole))
    }

    fn with(found: Found) -> Self {
        Self::started(found, StartCause::Ordinary)
    }

    fn started(found: Found, start: StartCause) -> Self {
        Self::of(IMAGE, found, start)
    }

    fn of(image: Image, found: Found, start: StartCause) -> Self {
        let exchange: &'static Exchange = Box::leak(Box::new(Exchange::empty()));
        let mut words = LastWords::EMPTY;
        words.keep(format_args!("panic at lib.rs:7"));
        let controller = Station::controller(&found, start).unwrap();
        let station = Station::new(&found, start, &controller, exchange, words);
        Self {
            service: Service::new(image, Memory::of(found), found.pin),
            station,
            enable: false,
            mean: 0.0,
        }
    }

    /// Runs one drive cycle with the track at rest and returns its telemetry.
    pub fn cycle(&mut self) -> Option<Vec<u8>> {
        let inputs = with(Inputs::default(), |it| it.enable = self.enable);
        // Readings of a working sensor.
        let mut cycle = Cycle::default();
        (cycle.low, cycle.high) = (2040, 2056);
        cycle.mean = self.mean;
        self.station.cycle(&cycle, inputs);
        self.service.tick(&self.station).map(<[u8]>::to_vec)
    }

    fn send(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        bytes
            .iter()
            .filter_map(|byte| {
                block_on(self.service.take(*byte, &self.station)).map(<[u8]>::to_vec)
            })
            .collect()
    }

    pub fn ask<T>(&mut self, request: &Request<'_>, look: impl FnOnce(Response<'_>) -> T) -> T {
        self.cycle();
        let mut buffer = [0; MAX_FRAME_BYTES];
        let frame = write_request(&mut buffer, 7, request).unwrap().to_vec();
        let answers = self.send(&frame);
        assert_eq!(answers.len(), 1, "{request:?}");
        open(&answers[0], |sequence, response| {
            assert_eq!(sequence, 7);
            look(response)
        })
    }

    fn self_test(&mut self) -> SelfTest {
        self.ask(&Request::SelfTest, |response| match response {
            Response::SelfTest(test) => test,
            other => panic!("{other:?}"),
        })
    }

    fn status(&mut self) -> Status {
        self.ask(&Request::Status, |response| match response {
            Response::Status(status) => status,
            other => panic!("{other:?}"),
        })
    }

    /// Requires that a number of this parameter is refused.
    fn out_of_range(&mut self, request: &Request<'_>, named: &str) {
        self.ask(request, |response| match response {
            Response::Refused(Refusal::OutOfRange {
                parameter,
                accepted,
            }) => assert!(parameter == named && !accepted.is_empty(), "{parameter}"),
            other => panic!("{other:?}"),
        });
    }

    fn cycles(&mut self, count: u32) {
        (0..count).for_each(|_| drop(self.cycle()));
    }

    fn keep_fault(&mut self) {
        block_on(self.service.keep_fault(&self.station));
    }

    fn state(&self) -> State {
        self.station.report().state
    }

    pub fn done(&mut self, request: &Request<'_>) {
        self.ask(request, |response| assert_eq!(response, Response::Done));
    }

    pub fn refused(&mut self, request: &Request<'_>, refusal: Refusal<'_>) {
        self.ask(request, |response| {
            assert_eq!(response, Response::Refused(refusal), "{request:?}");
        });
    }
}

fn open<T>(frame: &[u8], look: impl FnOnce(u8, Response<'_>) -> T) -> T {
    let mut receiver = Receiver::new();
    let (last, body) = frame.split_last().unwrap();
    for byte in body {
        assert!(receiver.push(*byte).is_none());
    }
    match read_answer(receiver.push(*last).unwrap().unwrap()).unwrap() {
        Outgoing::Response { sequence, response } => look(sequence, response),
        identity => panic!("{identity:?}"),
    }
}

mod interlock;
mod recipes;
mod update;

#[test]
fn settings_are_read_changed_and_saved_at_rest() {
    let mut board = Board::new();
    let frequency = |board: &mut Board, request: &Request<'_>| {
        board.ask(request, |response| match response {
            Response::Setting(setting) => (setting.key == "frequency", setting.value),
            other => panic!("{other:?}"),
        })
    };
    let by_key = Request::Get("frequency");
    for request in [by_key, Request::Setting(0)] {
        assert_eq!(frequency(&mut board, &request), (true, 50.0));
    }
    let set = |value| Request::set("frequency", value);
    board.done(&set(60.0));
    assert_eq!(frequency(&mut board, &by_key), (true, 60.0));
    assert_eq!(board.service.store.found.settings.frequency, 50.0);
    let test = board.self_test();
    assert!(test.sensor && test.stack_free == 1000, "{test:?}");
    assert_eq!(test.settings, Kept::Others);
    board.done(&Request::Save);
    assert_eq!(board.service.store.found.settings.frequency, 60.0);
    board.done(&Request::Defaults);
    assert_eq!(frequency(&mut board, &by_key), (true, 50.0));
    for value in [4.9, 501.0, f32::NAN, f32::INFINITY] {
        board.out_of_range(&set(value), "frequency");
    }
    board.refused(&Request::Get("frequence"), Refusal::Unknown);
    board.refused(&Request::Setting(200), Refusal::Unknown);
    // The bounds together must keep their order.
    let reversed = Request::set("restitution_high", 0.1);
    board.out_of_range(&reversed, "restitution_high");
}

#[test]
fn a_running_drive_is_not_worked_on_but_obeys() {
    let mut board = Board::new();
    board.enable = true;
    board.cycle();
    assert_eq!(board.state(), State::Starting);
    for request in [
        Request::set("frequency", 60.0),
        Request::Save,
        Request::Defaults,
        Request::SelfTest,
        Request::Fault(0),
        SIMULATE,
    ] {
        board.refused(&request, Refusal::Running);
    }
    let held = |board: &mut Board, target| {
        board.ask(&Request::Held, |response| {
            assert_eq!(response, Response::Held(target));
        });
    };
    held(&mut board, Target::Locked { order: 1 });
    board.done(&Request::Target(Target::K(0.5)));
    held(&mut board, Target::K(0.5));
    board.out_of_range(&Request::Target(Target::K(f32::NAN)), "target k");
    held(&mut board, Target::K(0.5));
    let status = board.status();
    assert!(status.inputs.enable && !status.inputs.over_temperature && status.permitted);
    board.done(&Request::Enable(false));
    assert!(!board.status().permitted);
    board.cycle();
    assert_eq!(board.state(), State::Stopping);
    board.ask(&Request::Event(0), |response| match response {
        Response::Event(Some(record)) => assert_eq!(record.number, 0),
        other => panic!("{other:?}"),
    });
    board.ask(&Request::Event(1_000_000), |response| {
        assert_eq!(response, Response::Event(None));
    });
    board.ask(&Request::LastWords, |response| {
        assert_eq!(response, Response::LastWords(Some("panic at lib.rs:7")));
    });
}

#[test]
fn a_drive_that_is_stopping_is_not_at_rest() {
    for request in [
        Request::Save,
        Request::SelfTest,
        Request::Fault(0),
        SIMULATE,
    ] {
        let mut board = Board::new();
        board.enable = true;
        board.cycles(10);
        board.enable = false;
        board.refused(&request, Refusal::Running);
        assert_eq!(board.state(), State::Stopping);
    }
}

#[test]
fn sensor_above_gravity_at_rest_fails_the_self_test() {
    let mut board = Board::new();
    for (mean, sound) in [(9.8, true), (-9.8, true), (12.0, false), (-12.0, false)] {
        board.mean = mean;
        assert_eq!(board.self_test().sensor, sound, "{mean}");
    }
}

/// A line that accepts nothing and counts the milliseconds waited for it.
struct Stuck<'a> {
    frame: &'a [u8],
    read: usize,
    waited: &'a Cell<u32>,
}

impl Line for Stuck<'_> {
    async fn read(&mut self, bytes: &mut [u8]) -> usize {
        let left = &self.frame[self.read..];
        let count = bytes.len().min(left.len());
        if count == 0 {
            core::future::pending::<()>().await;
        }
        bytes[..count].copy_from_slice(&left[..count]);
        self.read += count;
        count
    }

    fn send(&mut self, _frame: &[u8]) -> bool {
        false
    }

    async fn millisecond(&mut self) {
        self.waited.set(self.waited.get() + 1);
        yield_now().await;
    }
}

#[test]
fn an_answer_waits_100_ms_and_telemetry_does_not_wait() {
    let board = Board::new();
    let mut buffer = [0; MAX_FRAME_BYTES];
    let frame = (write_request(&mut buffer, 1, &Request::Alive).unwrap()).to_vec();
    let waited = Cell::new(0);
    let line = Stuck {
        frame: &frame,
        read: 0,
        waited: &waited,
    };
    let mut service = Service::new(IMAGE, Memory::of(Found::default()), None);
    service.telemetry_interval = 1;
    let mut task = pin!(link(&mut service, line, &board.station));
    for _ in 0..300 {
        let mut context = Context::from_waker(Waker::noop());
        assert!(task.as_mut().poll(&mut context).is_pending());
    }
    assert_eq!(waited.get(), ANSWER_WAIT_MS);
    board.station.cycle(&Cycle::default(), Inputs::default());
    for _ in 0..10 {
        let mut context = Context::from_waker(Waker::noop());
        assert!(task.as_mut().poll(&mut context).is_pending());
    }
    assert_eq!(waited.get(), ANSWER_WAIT_MS);
}

#[test]
fn telemetry_that_the_line_cannot_carry_is_refused() {
    let mut board = Board::new();
    // 80 % of 11 520 bytes a second are 64 telemetry frames of 144 bytes.
    for (frequency, fewest) in [
        (5.0, 1),
        (50.0, 1),
        (63.0, 1),
        (65.0, 2),
        (100.0, 2),
        (500.0, 8),
    ] {
        board.done(&Request::set("safe_amplitude", 0.0));
        board.done(&Request::set("frequency", frequency));
        for cycles in 1..fewest {
            board.refused(&Request::Telemetry(cycles), Refusal::Faster(fewest));
        }
        board.done(&Request::Telemetry(fewest));
        board.done(&Request::Telemetry(0));
    }
}

#[test]
fn telemetry_comes_as_often_as_asked() {
    let mut board = Board::new();
    board.done(&Request::Telemetry(3));
    let sent: Vec<bool> = (0..9).map(|_| board.cycle().is_some()).collect();
    assert_eq!(sent.iter().filter(|sent| **sent).count(), 3);
    board.done(&Request::Telemetry(1));
    let frame = board.cycle().unwrap();
    let cycle = board.station.report().cycle;
    open(&frame, |sequence, response| match response {
        Response::Telemetry(telemetry) => assert_eq!((sequence, telemetry.cycle), (0, cycle)),
        other => panic!("{other:?}"),
    });
    board.done(&Request::Telemetry(0));
    assert!(board.cycle().is_none());
}

#[test]
fn a_silent_link_brings_the_safe_amplitude_after_its_time() {
    let mut board = Board::new();
    // Before the controller detects that the track never moves.
    board.done(&Request::set("link_timeout", 0.1));
    board.enable = true;
    board.done(&Request::Alive);
    let lost = |board: &Board| {
        let limits = board.station.report().limits;
        limits.contains(kband_control::Limits::LINK_LOST)
    };
    // 0.1 s at 50 Hz, and the cycle of the request.
    let cycles = (1..=20).find(|_| {
        board.cycle();
        lost(&board)
    });
    assert!((5..=7).contains(&cycles.unwrap()), "{cycles:?}");
    board.done(&Request::Alive);
    board.cycle();
    assert!(!lost(&board));
}

#[test]
fn a_flood_is_counted_and_costs_no_more_than_its_share() {
    let mut board = Board::new();
    board.cycle();
    let mut buffer = [0; MAX_FRAME_BYTES];
    let frame = write_question(&mut buffer, 1).unwrap().to_vec();
    let answers: usize = (0..100).map(|_| board.send(&frame).len()).sum();
    assert_eq!(answers, usize::from(MAX_REQUESTS_PER_CYCLE));
    let counters = board.service.counters();
    assert_eq!(counters.flooded, 100 - u32::from(MAX_REQUESTS_PER_CYCLE));
    board.cycle();
    assert_eq!(board.send(&frame).len(), 1);
}

/// A line with endless input.
struct Flood<'a> {
    bytes: &'a [u8],
    /// Numbers of answers and of telemetry frames sent.
    answered: &'a Cell<u32>,
    rows: &'a Cell<u32>,
}

impl Line for Flood<'_> {
    async fn read(&mut self, bytes: &mut [u8]) -> usize {
        let count = bytes.len().min(self.bytes.len());
        bytes[..count].copy_from_slice(&self.bytes[..count]);
        count
    }

    fn send(&mut self, frame: &[u8]) -> bool {
        // The identity frame is short.
        let count = if frame.len() < 50 {
            self.answered
        } else {
            self.rows
        };
        count.set(count.get() + 1);
        true
    }

    async fn millisecond(&mut self) {}
}

#[test]
fn endless_input_blocks_neither_telemetry_nor_tasks() {
    let board = Board::new();
    let mut buffer = [0; MAX_FRAME_BYTES];
    let question = write_question(&mut buffer, 1).unwrap().to_vec();
    for flood in [&question.repeat(5)[..], b"no frame at all", b"\0"] {
        let (answered, rows) = (Cell::new(0), Cell::new(0));
        let line = Flood {
            bytes: flood,
            answered: &answered,
            rows: &rows,
        };
        let mut service = Service::new(IMAGE, Memory::of(Found::default()), None);
        service.telemetry_interval = 1;
        let mut task = pin!(link(&mut service, line, &board.station));
        for n in 0..10 {
            let inputs = Inputs::default();
            board.station.cycle(&Cycle::default(), inputs);
            // The task yields after each block of input; otherwise this poll would never return.
            for _ in 0..12 {
                let before = answered.get();
                let mut context = Context::from_waker(Waker::noop());
                assert!(task.as_mut().poll(&mut context).is_pending());
                assert!(answered.get() - before <= 1, "two in a row");
            }
            assert_eq!(rows.get(), n + 1, "a flood of {flood:?}");
        }
        assert_eq!(answered.get() > 10, flood.len() > 20);
    }
}

#[test]
fn a_plant_simulated_by_the_desk_sees_the_closed_loop() {
    use kband_control::wire::{fold_output, write_reading};
    use kband_control::{AdcCode, Signal};
    use kband_plant::{Bench, ClosedLoop, Scene};

    let scene = Scene::default();
    let mut board = Board::new();
    fn samples(codes: &[u8], end: Option<Inputs>) -> Request<'_> {
        Request::Samples { codes, end }
    }
    board.refused(&samples(&[], None), Refusal::OutOfStep);
    // Not even where the desk alone withholds the enable.
    board.done(&Request::Enable(false));
    board.enable = true;
    board.refused(&SIMULATE, Refusal::Running);
    board.enable = false;
    board.cycle();
    board.done(&Request::Enable(true));
    assert_eq!(
        SIMULATE,
        Request::Simulate {
            target: scene.target,
            start: StartCause::Ordinary,
        }
    );
    board.done(&SIMULATE);
    let mut closed = ClosedLoop::build(&scene).unwrap();
    let mut bench = Bench::build(&scene).unwrap();
    let mut signal = Signal::build(&scene.settings).unwrap();
    let mut before = 0;
    for n in 0..100 {
        // A cycle of the board that began before the simulation plans nothing more.
        assert!(!board.station.plan_own_step(), "cycle {n}");
        // Too few readings for a cycle, and an invalid reading after a valid one: neither is
        // accepted.
        board.refused(&samples(&[4; 3], Some(bench.inputs())), Refusal::OutOfStep);
        board.refused(&samples(&[4, 0xff, 0xff, 0xff], None), Refusal::OutOfStep);
        let (mut bytes, mut used, mut check) = ([0; 200], 0, 0);
        loop {
            let AdcCode(code) = bench.sample();
            let phase = signal.phase();
            let sampled = signal.sample(AdcCode(code));
            bench.hold(sampled.output, (signal.phase() - phase).bits());
            check = fold_output(check, sampled.output);
            used += write_reading(&mut bytes[used..], before, code);
            before = code;
            if sampled.wrapped {
                break;
            }
            if used > 190 {
                board.done(&samples(&bytes[..used], None));
                used = 0;
            }
        }
        let end = Some(bench.inputs());
        let report = board.ask(&samples(&bytes[..used], end), |response| match response {
            Response::Cycle { outputs, report } => {
                assert_eq!(outputs, check, "cycle {n}");
                report
            }
            other => panic!("{other:?}"),
        });
        assert_eq!(report, closed.cycle().report, "cycle {n}");
        signal.command(report.command);
    }
    // A missing or surplus reading is refused, never guessed.
    board.refused(&samples(&[0; 3], Some(bench.inputs())), Refusal::OutOfStep);
    board.refused(&samples(&[0xff; 3], None), Refusal::OutOfStep);
}

/// A cycle at 50 Hz has 400 readings, the first one 401: the phase step is rounded down.
#[test]
fn readings_across_a_cycle_end_are_refused() {
    let mut board = Board::new();
    board.done(&SIMULATE);
    let samples = |count: usize, end: bool| Request::Samples {
        codes: &[0; 150][..count],
        end: end.then(Inputs::default),
    };
    board.done(&samples(150, false));
    board.done(&samples(150, false));
    board.refused(&samples(150, false), Refusal::OutOfStep);
    board.refused(&samples(150, true), Refusal::OutOfStep);
    board.refused(&samples(101, false), Refusal::OutOfStep);
    board.refused(&samples(100, true), Refusal::OutOfStep);
    board.ask(&samples(101, true), |response| {
        assert!(matches!(response, Response::Cycle { .. }), "{response:?}");
    });
}

#[test]
fn a_silent_simulation_ends() {
    let mut board = Board::new();
    board.done(&SIMULATE);
    let second = with(Cycle::default(), |it| it.samples = 20_000);
    let inputs = with(Inputs::default(), |it| it.enable = true);
    let silent = (0..60).take_while(|_| board.station.cycle(&second, inputs).is_none());
    assert_eq!(silent.count(), 10);
    // Off, and not because of an earlier enable input.
    for _ in 0..5 {
        let report = board.station.cycle(&second, inputs).unwrap();
        assert_eq!((report.state, report.command.amplitude), (State::Off, 0.0));
    }
    board
        .station
        .cycle(&second, Inputs::default())
        .expect("a cycle");
    let report = board.station.cycle(&second, inputs).unwrap();
    assert_eq!(report.state, State::Starting);
}

#[test]
fn no_fault_is_kept_while_the_drive_runs() {
    let mut board = Board::started(FOUND(Condition::Whole), StartCause::Reset);
    // Enabled, withdrawn for half a second, enabled again: the fault is acknowledged before the
    // link stores it.
    for cycle in 0..40 {
        board.enable = !(2..35).contains(&cycle);
        board.cycle();
    }
    assert_eq!(board.state(), State::Starting);
    board.keep_fault();
    assert!(board.service.store.faults.is_empty());
    board.enable = false;
    board.cycles(100);
    board.keep_fault();
    assert_eq!(board.service.store.faults.len(), 1);
}

/// A board without settings. They can be set one by one; only saved settings allow the drive to
/// run.
#[test]
fn a_board_without_its_settings_stays_off_until_some_are_saved() {
    for (condition, kept) in [
        (Condition::Never, Kept::Never),
        (Condition::Lost, Kept::Damaged),
        (Condition::Newer, Kept::Damaged),
    ] {
        let mut board = Board::with(FOUND(condition));
        let fault = |board: &mut Board| {
            // Half a second acknowledges a fault that can be acknowledged.
            for cycle in 0..30 {
                board.enable = !(1..27).contains(&cycle);
                board.cycle();
            }
            board.station.report().fault
        };
        let invalid = Some(kband_control::Fault::SettingsInvalid);
        assert_eq!(fault(&mut board), invalid);
        assert_eq!(board.self_test().settings, kept);
        board.done(&Request::set("gain", 2.0));
        board.done(&Request::Target(Target::K(0.5)));
        assert_eq!(fault(&mut board), invalid);
        board.done(&Request::Save);
        assert_eq!(board.self_test().settings, Kept::InUse);
        let found = board.service.store.found;
        assert_eq!((found.settings.gain, found.target), (2.0, Target::K(0.5)));
        assert_eq!(fault(&mut board), None);
    }
}

/// Defaults fit no machine. They must not drive, even where a board that may drive restores them.
#[test]
fn defaults_drive_nothing_until_settings_are_saved() {
    let mut board = Board::new();
    let state = |board: &mut Board| {
        for cycle in 0..32 {
            // Withdrawn long enough to acknowledge a fault, then enabled.
            board.enable = cycle >= 30;
            board.cycle();
        }
        let report = board.station.report();
        board.enable = false;
        board.cycles(100);
        (report.state, report.fault)
    };
    board.done(&Request::Save);
    assert_eq!(state(&mut board), (State::Starting, None));
    board.done(&Request::Defaults);
    let invalid = Some(kband_control::Fault::SettingsInvalid);
    assert_eq!(state(&mut board), (State::Fault, invalid));
    board.done(&Request::Save);
    assert_eq!(state(&mut board), (State::Starting, None));
}

#[test]
fn saves_are_refused_where_they_come_too_often() {
    let mut board = Board::new();
    for _ in 0..60 {
        board.done(&Request::Save);
    }
    board.refused(&Request::Save, Refusal::TooOften);
}

#[test]
fn a_fault_is_kept_beyond_a_loss_of_power() {
    let mut board = Board::new();
    board.enable = true;
    // A track that never moves.
    let until = (0..500).find(|_| {
        board.cycle();
        board.station.report().fault.is_some()
    });
    assert!(until.is_some());
    board.keep_fault();
    board.keep_fault();
    let number = (board.station.report().fault).map(kband_control::Fault::number);
    board.ask(&Request::Fault(0), |response| match response {
        Response::Fault(Some(kept)) => {
            assert_eq!(Some(kept.fault), number);
            assert_eq!((kept.low, kept.high), (2040, 2056));
            assert!(kept.expected > 0.0 && kept.output > 0.0, "{kept:?}");
        }
        other => panic!("{other:?}"),
    });
    board.ask(&Request::Fault(1), |response| {
        assert_eq!(response, Response::Fault(None));
    });
}
