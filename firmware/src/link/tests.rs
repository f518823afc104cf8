//! Tests of the link's board side, with a controller behind it, at the desk.

use super::*;
use crate::storage::last_words::LastWords;
use crate::storage::recipes::Recipes;
use crate::storage::store::tests::{G4_PAGE, Nor, SUPPLY_IS_GOOD, memory};
use crate::testing::{exchange, with};
use core::cell::Cell;
use core::pin::pin;
use embassy_futures::{block_on, poll_once};
use kband_control::wire::{
    Outgoing, Status, Stored, read_answer, write_identity_request, write_request,
};
use kband_control::{
    Cycle, Event, Fault, Inputs, Limits, Recipe, RecipeName, StartCause, State, Target,
};
use std::println;
use std::vec::Vec;

const LOADED: fn(Condition) -> LoadedSettings = |condition| LoadedSettings {
    target: Target::Locked { order: 1 },
    ..LoadedSettings::none(condition)
};

const IMAGE: Image = Image {
    identity: "kband test",
    stack_free: || 1000,
    set_up: SetUp::default,
    line_rate: 11_520,
    strapped: || false,
    slot: None,
};

const SIMULATE: Request<'static> = simulate(Target::Locked { order: 1 });

pub(crate) const fn simulate(target: Target) -> Request<'static> {
    let start = StartCause::Ordinary;
    Request::Simulate { target, start }
}

pub(crate) struct Board {
    pub service: Service<Nor<G4_PAGE>, Waiting>,
    pub station: Station,
    pub enable: bool,
    /// Mean acceleration, m/s^2.
    mean: f32,
}

pub(crate) fn board_with(settings: Settings) -> Board {
    let loaded = with(LOADED(Condition::Whole), |it| it.settings = settings);
    Board::started(loaded, StartCause::Ordinary)
}

impl Board {
    fn new() -> Self {
        Self::started(LOADED(Condition::Whole), StartCause::Ordinary)
    }

    pub fn started(loaded: LoadedSettings, start: StartCause) -> Self {
        Self::of(IMAGE, loaded, start)
    }

    fn of(image: Image, loaded: LoadedSettings, start: StartCause) -> Self {
        let mut words = LastWords::EMPTY;
        words.keep(format_args!("panic at lib.rs:7"));
        let controller = Station::controller(&loaded, start).unwrap();
        let station = Station::new(&loaded, &controller, exchange(), words);
        Self {
            service: Service::new(image, memory(&loaded), loaded.pin),
            station,
            enable: false,
            mean: 0.0,
        }
    }

    /// Runs one drive cycle with the track at rest and returns its telemetry.
    pub fn cycle(&mut self) -> Option<Vec<u8>> {
        let cycle = with(sensed(400), |it| it.mean = self.mean);
        let inputs = with(Inputs::default(), |it| it.enable = self.enable);
        self.station.cycle(&cycle, inputs);
        self.service.tick(&self.station).map(<[u8]>::to_vec)
    }

    fn send(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let answer =
            |byte: &u8| block_on(self.service.take(*byte, &self.station)).map(<[u8]>::to_vec);
        bytes.iter().filter_map(answer).collect()
    }

    pub fn ask(&mut self, request: &Request<'_>) -> Response<'static> {
        self.cycle();
        self.ask_now(request)
    }

    /// As [`Board::ask`], in the same drive cycle.
    pub fn ask_now(&mut self, request: &Request<'_>) -> Response<'static> {
        let mut buffer = [0; MAX_FRAME_BYTES];
        let frame = write_request(&mut buffer, 7, request).unwrap().to_vec();
        let answers = self.send(&frame);
        assert_eq!(answers.len(), 1, "{request:?}");
        let (sequence, response) = open(&answers[0]);
        assert_eq!(sequence, 7);
        response
    }

    fn self_test(&mut self) -> SelfTest {
        match self.ask(&Request::SelfTest) {
            Response::SelfTest(test) => test,
            other => panic!("{other:?}"),
        }
    }

    fn status(&mut self) -> Status {
        match self.ask(&Request::Status) {
            Response::Status(status) => status,
            other => panic!("{other:?}"),
        }
    }

    fn out_of_range(&mut self, request: &Request<'_>, named: &str) {
        match self.ask(request) {
            Response::Refused(Refusal::OutOfRange {
                parameter,
                accepted,
            }) => assert!(parameter == named && !accepted.is_empty(), "{parameter}"),
            other => panic!("{other:?}"),
        }
    }

    /// Runs drive cycles with this level of the enable input.
    pub fn run(&mut self, enable: bool, cycles: u32) {
        self.enable = enable;
        (0..cycles).for_each(|_| drop(self.cycle()));
    }

    fn saved(&mut self) -> LoadedSettings {
        block_on(self.service.store.load())
    }

    fn saved_recipes(&mut self) -> Recipes {
        block_on(self.service.store.recipes())
    }

    fn keep_fault(&mut self) {
        block_on(self.service.keep_fault(&self.station));
    }

    pub fn state(&self) -> State {
        self.station.report().state
    }

    pub fn done(&mut self, request: &Request<'_>) {
        assert_eq!(self.ask(request), Response::Done, "{request:?}");
    }

    pub fn refused(&mut self, request: &Request<'_>, refusal: Refusal<'_>) {
        assert_eq!(self.ask(request), Response::Refused(refusal), "{request:?}");
    }
}

/// Readings of a working sensor on a track at rest, over this number of samples.
pub(crate) fn sensed(samples: u16) -> Cycle {
    Cycle {
        samples,
        low: 2040,
        high: 2056,
        ..Cycle::default()
    }
}

/// Content of a frame. Its bytes are leaked, so that it outlives the receiver.
fn outgoing(frame: &[u8]) -> (u8, Outgoing<'static>) {
    let mut receiver = Receiver::new();
    let (last, body) = frame.split_last().unwrap();
    for byte in body {
        assert!(receiver.push(*byte).is_none());
    }
    let inside = receiver.push(*last).unwrap().unwrap();
    read_answer(inside.to_vec().leak()).unwrap()
}

fn open(frame: &[u8]) -> (u8, Response<'static>) {
    match outgoing(frame) {
        (sequence, Outgoing::Response(response)) => (sequence, response),
        other => panic!("{other:?}"),
    }
}

mod conversation;
mod draw;
mod interlock;
mod recipes;
mod update;

#[test]
fn settings_are_read_changed_and_saved_at_rest() {
    let mut board = Board::new();
    let frequency = |board: &mut Board, request: &Request<'_>| match board.ask(request) {
        Response::Setting(setting) => (setting.key == "frequency", setting.value),
        other => panic!("{other:?}"),
    };
    let by_key = Request::Get("frequency");
    for request in [by_key, Request::Setting(0)] {
        assert_eq!(frequency(&mut board, &request), (true, 50.0));
    }
    let set = |value| Request::set("frequency", value);
    board.done(&set(60.0));
    assert_eq!(frequency(&mut board, &by_key), (true, 60.0));
    assert_eq!(board.saved().settings.frequency, 50.0);
    let test = board.self_test();
    assert!(test.sensor && test.stack_free == 1000, "{test:?}");
    assert_eq!(test.settings, SavedSettings::Different);
    board.done(&Request::Save);
    assert_eq!(board.saved().settings.frequency, 60.0);
    board.done(&Request::Defaults);
    assert_eq!(frequency(&mut board, &by_key), (true, 50.0));
    for value in [4.9, 501.0, f32::NAN, f32::INFINITY] {
        board.out_of_range(&set(value), "frequency");
    }
    board.refused(&Request::Get("frequence"), Refusal::Unknown);
    board.refused(&Request::Setting(200), Refusal::Unknown);
    // Both bounds together must keep their order.
    let reversed = Request::set("restitution_high", 0.1);
    board.out_of_range(&reversed, "restitution_high");
}

#[test]
fn a_running_drive_is_not_worked_on_but_obeys() {
    let mut board = Board::new();
    board.run(true, 1);
    assert_eq!(board.state(), State::Starting);
    let refused = [
        Request::set("frequency", 60.0),
        Request::Save,
        Request::Defaults,
        Request::SelfTest,
        Request::Fault(0),
        SIMULATE,
    ];
    for request in refused {
        board.refused(&request, Refusal::Running);
    }
    let check_target = |board: &mut Board, target| {
        assert_eq!(board.ask(&Request::Held), Response::Held(target));
    };
    check_target(&mut board, Target::Locked { order: 1 });
    board.done(&Request::Target(Target::K(0.5)));
    check_target(&mut board, Target::K(0.5));
    board.out_of_range(&Request::Target(Target::K(f32::NAN)), "target k");
    check_target(&mut board, Target::K(0.5));
    let status = board.status();
    assert!(status.inputs.enable && !status.inputs.over_temperature && status.permitted);
    board.done(&Request::Enable(false));
    assert!(!board.status().permitted);
    board.cycle();
    assert_eq!(board.state(), State::Stopping);
    for request in refused {
        let running = Response::Refused(Refusal::Running);
        assert_eq!(board.ask_now(&request), running, "{request:?}");
    }
    // Without the enable input it stops all the same.
    board.run(false, 1);
    assert_eq!(board.state(), State::Stopping);
    let refused = Response::Refused(Refusal::Running);
    assert_eq!(board.ask_now(&SIMULATE), refused);
    let event = board.ask(&Request::Event(0));
    assert!(matches!(event, Response::Event(Some(record)) if record.number == 0));
    let none = board.ask(&Request::Event(1_000_000));
    assert_eq!(none, Response::Event(None));
    let words = board.ask(&Request::LastWords);
    assert_eq!(words, Response::LastWords(Some("panic at lib.rs:7")));
}

#[test]
fn sensor_above_gravity_at_rest_fails_the_self_test() {
    let mut board = Board::new();
    for (mean, expected) in [(9.8, true), (-9.8, true), (12.0, false), (-12.0, false)] {
        board.mean = mean;
        assert_eq!(board.self_test().sensor, expected, "{mean}");
    }
}

/// A line whose input repeats `bytes` and that accepts frames, or one that does neither.
#[derive(Default)]
struct FakeLine<'a> {
    bytes: Cell<&'a [u8]>,
    endless: bool,
    /// Numbers of milliseconds waited for the line, and of answers and telemetry frames sent.
    waited: Cell<u32>,
    answered: Cell<u32>,
    rows: Cell<u32>,
}

/// A service that sends telemetry in each cycle.
fn telemetering() -> Service<Nor<G4_PAGE>, Waiting> {
    let service = Service::new(IMAGE, memory(&LOADED(Condition::Never)), None);
    with(service, |it| it.telemetry_interval = 1)
}

impl Line for &FakeLine<'_> {
    async fn read(&mut self, bytes: &mut [u8]) -> usize {
        let input = self.bytes.get();
        let count = bytes.len().min(input.len());
        if count == 0 {
            core::future::pending::<()>().await;
        }
        bytes[..count].copy_from_slice(&input[..count]);
        if !self.endless {
            self.bytes.set(&input[count..]);
        }
        count
    }

    fn send(&mut self, frame: &[u8]) -> bool {
        if self.endless {
            // The identity frame is short.
            let is_answer = frame.len() < 50;
            let count = if is_answer {
                &self.answered
            } else {
                &self.rows
            };
            count.update(|count| count + 1);
        }
        self.endless
    }

    async fn millisecond(&mut self) {
        self.waited.update(|count| count + 1);
        yield_now().await;
    }
}

#[test]
fn an_answer_waits_100_ms_and_telemetry_does_not_wait() {
    let board = Board::new();
    let mut buffer = [0; MAX_FRAME_BYTES];
    let frame = (write_request(&mut buffer, 1, &Request::Alive).unwrap()).to_vec();
    let line = FakeLine {
        bytes: Cell::new(&frame),
        ..FakeLine::default()
    };
    let mut service = telemetering();
    let mut task = pin!(link(&mut service, &line, &board.station));
    for _ in 0..300 {
        assert!(poll_once(task.as_mut()).is_pending());
    }
    assert_eq!(line.waited.get(), ANSWER_WAIT_MS);
    board.station.cycle(&Cycle::default(), Inputs::default());
    for _ in 0..10 {
        assert!(poll_once(task.as_mut()).is_pending());
    }
    assert_eq!(line.waited.get(), ANSWER_WAIT_MS);
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
fn a_silent_link_brings_the_safe_amplitude_after_its_time() {
    let mut board = Board::new();
    // This is before the controller detects that the track never moves.
    board.done(&Request::set("link_timeout", 0.1));
    board.enable = true;
    board.done(&Request::Alive);
    let lost = |board: &Board| board.station.report().limits.contains(Limits::LINK_LOST);
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
    let frame = write_identity_request(&mut buffer, 1).unwrap().to_vec();
    let answers: usize = (0..100).map(|_| board.send(&frame).len()).sum();
    assert_eq!(answers, usize::from(MAX_REQUESTS_PER_CYCLE));
    let counters = board.service.counters;
    assert_eq!(counters.flooded, 100 - u32::from(MAX_REQUESTS_PER_CYCLE));
    board.cycle();
    assert_eq!(board.send(&frame).len(), 1);
}

#[test]
fn endless_input_blocks_neither_telemetry_nor_tasks() {
    let board = Board::new();
    let mut buffer = [0; MAX_FRAME_BYTES];
    let question = write_identity_request(&mut buffer, 1).unwrap().to_vec();
    for flood in [&question.repeat(5)[..], b"no frame at all", b"\0"] {
        let line = FakeLine {
            bytes: Cell::new(flood),
            endless: true,
            ..FakeLine::default()
        };
        let mut service = telemetering();
        let mut task = pin!(link(&mut service, &line, &board.station));
        for n in 0..10 {
            board.station.cycle(&Cycle::default(), Inputs::default());
            // The task yields after each block of input; otherwise this poll would never return.
            for _ in 0..12 {
                let before = line.answered.get();
                assert!(poll_once(task.as_mut()).is_pending());
                assert!(line.answered.get() - before <= 1, "two in a row");
            }
            assert_eq!(line.rows.get(), n + 1, "a flood of {flood:?}");
        }
        assert_eq!(line.answered.get() > 10, flood.len() > 20);
    }
}

#[test]
fn a_plant_simulated_by_the_desk_sees_the_closed_loop() {
    use kband_control::wire::{update_output_check, write_reading};
    use kband_control::{AdcCode, Signal};
    use kband_plant::{Bench, ClosedLoop, Scene};

    let scene = Scene::default();
    let mut board = Board::new();
    fn samples(codes: &[u8], end: Option<Inputs>) -> Request<'_> {
        Request::Samples { codes, end }
    }
    board.refused(&samples(&[], None), Refusal::OutOfStep);
    // This also holds if only the desk withholds the enable.
    board.done(&Request::Enable(false));
    board.enable = true;
    board.refused(&SIMULATE, Refusal::Running);
    board.run(false, 1);
    board.done(&Request::Enable(true));
    board.done(&simulate(scene.target));
    let mut closed = ClosedLoop::build(&scene).unwrap();
    let mut bench = Bench::build(&scene).unwrap();
    let mut signal = Signal::build(&scene.settings).unwrap();
    let mut before = 0;
    for n in 0..100 {
        // A cycle of the board that began before the simulation plans nothing more.
        assert!(!board.station.plan_own_step(), "cycle {n}");
        // Too few readings for a cycle, and an invalid reading after a valid one: both are refused.
        board.refused(&samples(&[4; 3], Some(bench.inputs())), Refusal::OutOfStep);
        board.refused(&samples(&[4, 0xff, 0xff, 0xff], None), Refusal::OutOfStep);
        let (mut bytes, mut used, mut check) = ([0; 200], 0, 0);
        loop {
            let AdcCode(code) = bench.sample();
            let phase = signal.phase();
            let sampled = signal.sample(AdcCode(code));
            bench.hold(sampled.output, (signal.phase() - phase).bits());
            check = update_output_check(check, sampled.output);
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
        let report = closed.cycle().report;
        let answer = board.ask(&samples(&bytes[..used], end));
        let outputs = check;
        assert_eq!(answer, Response::Cycle { outputs, report }, "cycle {n}");
        signal.command(report.command);
    }
    // A missing or surplus reading is refused.
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
    let response = board.ask(&samples(101, true));
    assert!(matches!(response, Response::Cycle { .. }), "{response:?}");
}

/// The board's fault outlives a simulation.
#[test]
fn only_silence_ends_a_simulation() {
    for (condition, start) in [
        (Condition::Whole, StartCause::Ordinary),
        (Condition::Whole, StartCause::Reset),
        (Condition::Lost, StartCause::PowerOn),
    ] {
        let mut board = Board::started(LOADED(condition), start);
        board.cycle();
        let before = board.station.report().fault;
        assert_eq!(before.is_none(), start == StartCause::Ordinary);
        board.done(&simulate(Target::K(0.41)));
        board.out_of_range(&Request::set("amplitude_limit", 0.046), "safe_amplitude");
        assert_eq!(board.station.target(), Target::K(0.41));
        let second = sensed(20_000);
        let inputs = with(Inputs::default(), |it| it.enable = true);
        let silent = (0..60).take_while(|_| board.station.cycle(&second, inputs).is_none());
        assert_eq!(silent.count(), 10);
        // The drive is off, and an earlier enable input has no effect.
        for _ in 0..5 {
            let report = board.station.cycle(&second, inputs).unwrap();
            let state = before.map_or(State::Off, |_| State::Fault);
            assert_eq!((report.state, report.fault), (state, before));
            assert_eq!(report.command.amplitude, 0.0);
        }
        assert!(board.station.cycle(&second, Inputs::default()).is_some());
        let report = board.station.cycle(&second, inputs).unwrap();
        assert_eq!(report.state == State::Starting, before.is_none());
    }
}

#[test]
fn no_fault_is_kept_while_the_drive_runs() {
    let mut board = Board::started(LOADED(Condition::Whole), StartCause::Reset);
    // A press of half a second acknowledges the fault before the link stores it.
    board.run(true, 2);
    board.run(false, 33);
    board.run(true, 5);
    assert_eq!(board.state(), State::Starting);
    board.keep_fault();
    assert_eq!(block_on(board.service.store.fault(0)), None);
    board.run(false, 100);
    board.keep_fault();
    assert!(block_on(board.service.store.fault(0)).is_some());
    assert_eq!(block_on(board.service.store.fault(1)), None);
}

/// Settings are missing or damaged, or the desk restores the defaults, which fit no machine. They
/// can be set singly; the drive runs only with saved settings.
#[test]
fn a_board_without_its_settings_stays_off_until_some_are_saved() {
    for (condition, record) in [
        (Condition::Never, SavedSettings::Never),
        (Condition::Lost, SavedSettings::Damaged),
        (Condition::Newer, SavedSettings::Damaged),
        (Condition::Whole, SavedSettings::InUse),
    ] {
        let mut board = Board::started(LOADED(condition), StartCause::Ordinary);
        let press = |board: &mut Board| {
            // Withdrawn long enough to acknowledge a fault, then enabled.
            board.run(false, 30);
            board.run(true, 2);
            let report = board.station.report();
            board.run(false, 100);
            (report.state, report.fault)
        };
        let started = (State::Starting, None);
        let refused = (State::Fault, Some(Fault::SettingsInvalid));
        if condition == Condition::Whole {
            assert_eq!(press(&mut board), started);
            board.done(&Request::Defaults);
        }
        assert_eq!(press(&mut board), refused);
        assert_eq!(board.self_test().settings, record);
        board.done(&Request::set("gain", 2.0));
        board.done(&Request::Target(Target::K(0.5)));
        assert_eq!(press(&mut board), refused);
        board.done(&Request::Save);
        assert_eq!(board.self_test().settings, SavedSettings::InUse);
        let loaded = board.saved();
        assert_eq!((loaded.settings.gain, loaded.target), (2.0, Target::K(0.5)));
        assert_eq!(press(&mut board), started);
    }
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
    // A track that never moves.
    board.run(true, 500);
    board.keep_fault();
    board.keep_fault();
    let number = board.station.report().fault.map(Fault::number);
    match board.ask(&Request::Fault(0)) {
        Response::Fault(Some(record)) => {
            assert_eq!(Some(record.fault), number);
            assert_eq!((record.low, record.high), (2040, 2056));
            assert!(record.expected > 0.0 && record.output > 0.0, "{record:?}");
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(board.ask(&Request::Fault(1)), Response::Fault(None));
}
