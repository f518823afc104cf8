//! Golden frames, and rejection of invalid frames.

use super::*;
use crate::testing::with;
use crate::{
    Command, Event, Events, Fault, GearMargin, Identification, Identified, Inputs, Limits, Load,
    Recipe, RecipeName, Report, Shape, StartCause, State, Target, Unidentified, UpperTone,
};
use kband::arithmetic::Phase;
use kband::regime::classify::{Regime, Verdict};
use proptest::prelude::*;
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

fn requests() -> Vec<Request<'static>> {
    let samples = |codes, end| Request::Samples { codes, end };
    let set_recipe = |number, recipe| Request::SetRecipe { number, recipe };
    let inputs = with(Inputs::default(), |it| {
        (it.enable, it.link_heard) = (true, true)
    });
    std::vec![
        Request::Setting(3),
        Request::Get("frequency"),
        Request::set("restitution_low", 0.18),
        Request::Save,
        Request::Defaults,
        Request::Target(Target::Locked { order: 1 }),
        Request::Target(Target::Chaotic),
        Request::Target(Target::K(0.41)),
        Request::Target(Target::Amplitude(0.25)),
        Request::Target(Target::Speed(12.5)),
        Request::Target(Target::Flow(46.75)),
        Request::Target(Target::PartsPerMinute(120.0)),
        Request::Target(Target::Identify),
        Request::Target(Target::Gear { order: 1 }),
        Request::Target(Target::Tones {
            k: 0.35,
            shape: SHAPE,
        }),
        Request::Enable(true),
        Request::Telemetry(5),
        Request::Event(300),
        Request::SelfTest,
        Request::Counters,
        Request::LastWords,
        Request::Alive,
        Request::Simulate {
            target: Target::Locked { order: 1 },
            start: StartCause::Ordinary,
        },
        samples(&[1, 2, 3], None),
        samples(&[], Some(inputs)),
        Request::Identification,
        Request::Held,
        Request::Fault(3),
        Request::Status,
        Request::Lock(Pin::parse("0420")),
        Request::Lock(None),
        Request::Unlock(Pin::parse("12345678").unwrap()),
        Request::Recipe(7),
        set_recipe(2, Some((recipe_name(), recipe()))),
        set_recipe(3, None),
        Request::SaveRecipes,
        Request::UseRecipe(2),
        Request::Bus(&[1, 3, 0, 5, 0, 1]),
    ]
}

const MARGIN: GearMargin = GearMargin {
    trace: -0.5,
    restitution: 0.25,
    error: 0.125,
    scatter: 0.0625,
    flip: 0.5,
    to_loss: 1000.0,
};

const SHAPE: Shape = Shape::new(UpperTone::new(0.15, 2.356), UpperTone::new(0.05, 5.3));

const LOAD: Load = Load {
    mass: 250.0,
    speed: 93.5,
    flow: 46.75,
};

fn recipe_name() -> RecipeName {
    RecipeName::parse("M3 screws").unwrap()
}

fn recipe() -> Recipe {
    Recipe {
        target: Target::K(0.41),
        values: [0.18, 0.22, 0.05, 0.3, 0.5, 0.75, 12.0, 0.4],
    }
}

fn responses() -> Vec<Response<'static>> {
    std::vec![
        Response::Done,
        Response::Refused(Refusal::Unknown),
        Response::Refused(Refusal::OutOfRange {
            parameter: "frequency",
            accepted: "5..500 Hz",
        }),
        Response::Refused(Refusal::Running),
        Response::Refused(Refusal::Store),
        Response::Refused(Refusal::OutOfStep),
        Response::Refused(Refusal::TooOften),
        Response::Refused(Refusal::ReadOnly(Access::Strapped)),
        Response::Refused(Refusal::WrongPin),
        Response::Refused(Refusal::Wait(59)),
        Response::Refused(Refusal::Faster(2)),
        Response::Refused(Refusal::SupplyLow),
        Response::Refused(Refusal::NoRecipe),
        Response::Refused(Refusal::NoSettings),
        Response::Refused(Refusal::NotInControl),
        Response::Setting(Setting {
            number: 0,
            key: "frequency",
            unit: "Hz",
            value: 50.0,
            low: 5.0,
            high: 500.0,
            default: 50.0,
        }),
        Response::Event(Some(Record {
            number: 300,
            cycle: 70_000,
            event: 26,
            fault: 0,
            mass: 250.0,
            flow: 46.75,
        })),
        Response::Event(None),
        Response::SelfTest(SelfTest {
            sensor: true,
            settings: SavedSettings::Different,
            stack_free: 20_000,
            missed: 0,
            set_up: SetUp {
                brown_out: 2700,
                watchdog: true,
                sample: 1000,
                control: 20_000,
            },
        }),
        Response::Counters(Counters {
            requests: 1,
            oversized: 2,
            corrupt: 3,
            foreign: 4,
            unknown: 5,
            flooded: 600,
            rows_dropped: 7,
            answers_dropped: 8,
        }),
        Response::LastWords(Some("panic at lib.rs:7")),
        Response::LastWords(None),
        Response::Telemetry(Telemetry {
            cycle: 500,
            k: 0.41,
            amplitude: 0.000_25,
            setpoint: 0.000_25,
            lead: -1.5,
            output: 0.3,
            shape: SHAPE,
            overtones: [[0.1, -0.2], [0.3, 0.05]],
            rate: 1.0,
            phase: 0.7,
            confidence: 0.95,
            in_gear: 0.75,
            in_gear_error: 0.03125,
            expected_in_gear: 0.85,
            target_band: Some([0.375, 0.4375]),
            margin: Some(MARGIN),
            load: Some(LOAD),
            state: 4,
            fault: 0,
            limits: 2,
        }),
        Response::Cycle {
            outputs: 0x0102_0304,
            report: Report::default(),
        },
        Response::Identification(Identification::Idle),
        Response::Identification(Identification::Listening { hops: 16 }),
        Response::Identification(Identification::Found(Identified {
            restitution: 0.3,
            deviation: 0.01,
            k: 0.55,
            scatter: 0.05,
            hops: 64,
        })),
        Response::Identification(Identification::NotFound(Unidentified::Quiet)),
        Response::Identification(Identification::NotFound(Unidentified::Unsteady)),
        Response::Held(Target::Locked { order: 3 }),
        Response::Held(Target::K(0.41)),
        Response::Fault(None),
        Response::Status(Status {
            inputs: Inputs {
                enable: true,
                supply_low: true,
                ..Inputs::default()
            },
            permitted: true,
            access: Access::Locked,
            ready: false,
            mean: -0.25,
            current: 1.5,
            seconds: 4711,
            recipe: 2,
        }),
        Response::Recipe(Stored::None),
        Response::Recipe(Stored::Recipe(recipe_name(), recipe())),
        Response::Recipe(Stored::Newer),
        Response::Fault(Some(FaultRecord {
            number: 300,
            seconds: 70_000,
            fault: 4,
            state: 2,
            amplitude: 0.000_25,
            expected: 0.000_5,
            output: 0.5,
            low: 2040,
            high: 2056,
        })),
    ]
}

/// A report of each regime; the index of a regime is its code on the line.
fn regimes() -> impl Iterator<Item = Response<'static>> {
    // The compiler requires an entry for each new variant.
    let after = |regime: &Regime| match regime {
        Regime::Rest => Some(Regime::HopAndRest { cycles: 2 }),
        Regime::HopAndRest { .. } => Some(Regime::Locked { order: 2 }),
        Regime::Locked { .. } => Some(Regime::Doubled {
            order: 2,
            doublings: 1,
        }),
        Regime::Doubled { .. } => Some(Regime::Periodic {
            impacts: 3,
            cycles: 4,
        }),
        Regime::Periodic { .. } => Some(Regime::Chaotic),
        Regime::Chaotic => Some(Regime::Undecided),
        Regime::Undecided => None,
    };
    core::iter::successors(Some(Regime::Rest), after).map(|regime| Response::Cycle {
        outputs: 0,
        report: Report {
            regime: Some(Verdict {
                regime,
                confidence: 0.75,
            }),
            ..Report::default()
        },
    })
}

/// The fields of the report all differ from their defaults.
#[test]
fn a_report_has_the_bytes_that_it_always_had() {
    let mut events = Events::default();
    for event in [
        Event::Started,
        Event::NotIdentified,
        Event::Faulted,
        Event::Locked,
    ] {
        events.push(event);
    }
    let report = Report {
        cycle: 70_000,
        k: 0.41,
        amplitude: 1.5e-3,
        lead: -1.5,
        shape: Shape::new(UpperTone::new(0.125, 2.25), UpperTone::new(0.0625, -1.25)),
        reference: 1.4e-3,
        setpoint: 1.6e-3,
        rate: 1.25,
        phase: 0.7,
        concentration: 0.9,
        regime: Some(Verdict {
            regime: Regime::Doubled {
                order: 2,
                doublings: 1,
            },
            confidence: 0.75,
        }),
        frequency: 50.0,
        confidence: 0.95,
        in_gear: 0.75,
        in_gear_error: 0.03125,
        gear: 1,
        to_loss: 500.0,
        margin: Some(MARGIN),
        expected_in_gear: 0.85,
        target_band: Some([0.375, 0.4375]),
        load: Some(LOAD),
        attempts: 2,
        identification: Identification::NotFound(Unidentified::Dead),
        state: State::Fault,
        fault: Some(Fault::StackLow),
        limits: Limits::try_from(Limits::OUTPUT.bits() | Limits::LINK_LOST.bits()).unwrap(),
        events,
        command: Command {
            amplitude: 0.3,
            lead: Phase::from_bits(1 << 27),
            overtones: [[0.25, -0.5], [0.125, 0.0625]],
            step: 10_737_418,
            immediate: true,
            average_from: Some(Phase::from_bits(1 << 30)),
            whole: false,
        },
    };
    let mut buffer = [0; 256];
    let bytes = postcard::to_slice(&report, &mut buffer).unwrap();
    // Of its postcard encoding by an independent program.
    assert_eq!((bytes.len(), crc32(bytes)), (184, 0x6d4b_610f));
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A message as text, and its bytes in a frame, without version, schema and CRC.
fn golden<M: serde::Serialize + core::fmt::Debug>(message: M) -> (String, String) {
    let mut buffer = [0; 256];
    let bytes = postcard::to_slice(&message, &mut buffer).unwrap();
    (format!("{message:?}"), hex(bytes))
}

#[test]
fn the_schema_is_the_hash_of_the_golden_messages() {
    let responses = responses().into_iter().chain(regimes());
    let lines = requests().into_iter().map(golden);
    let lines: Vec<_> = lines.chain(responses.map(golden)).collect();
    let bytes = (lines.iter()).flat_map(|(_, hex)| hex.bytes().chain([b'\n']));
    let hash = bytes.fold(0x811c_9dc5, |sum, byte| {
        (sum ^ u32::from(byte)).wrapping_mul(0x0100_0193)
    });
    assert_eq!(
        SCHEMA, hash,
        "a message changed: set wire::SCHEMA to {hash:#010x}, and add a request or response here for a new \
         message; raise wire::VERSION if the meaning of a message changed too. They are now:\n{lines:#?}"
    );
}

#[test]
fn the_frozen_frames_never_change() {
    let mut buffer = [0; MAX_FRAME_BYTES];
    let identity = Identity {
        version: 1,
        schema: 0x0102_0304,
        image: "kband",
    };
    // Computed by an independent program, with another library's CRC-32.
    let request = write_identity_request(&mut buffer, 0x2a).unwrap();
    assert_eq!(hex(request), "01062a29db629a00", "who is there");
    let answer = write_identity(&mut buffer, 0x2a, &identity).unwrap();
    let expected = "01102a01040302016b62616e64cad5fdf800";
    assert_eq!(hex(answer), expected, "the answer");
}

fn update_requests() -> [UpdateRequest<'static>; 8] {
    [
        UpdateRequest::State,
        UpdateRequest::Unlock(Pin::parse("0420").unwrap()),
        UpdateRequest::Key(&[7; 32]),
        UpdateRequest::Begin {
            board: "stm32f405rg",
            length: 300_000,
        },
        UpdateRequest::Bytes {
            offset: 256,
            bytes: &[1, 2, 3, 4],
        },
        UpdateRequest::End(&[9; 64]),
        UpdateRequest::Confirm,
        UpdateRequest::Signed {
            board: "stm32g474re",
            length: 300_000,
            sum: &[5; 64],
            signature: &[9; 64],
        },
    ]
}

const UPDATE_ANSWERS: [UpdateAnswer<'static>; 19] = {
    use UpdateRefusal::*;
    [
        UpdateAnswer::Done,
        UpdateAnswer::Refused(Running),
        UpdateAnswer::Refused(ReadOnly),
        UpdateAnswer::Refused(WrongPin),
        UpdateAnswer::Refused(Wait(60)),
        UpdateAnswer::Refused(NotInControl),
        UpdateAnswer::Refused(NoSlot),
        UpdateAnswer::Refused(NoKey),
        UpdateAnswer::Refused(HasKey),
        UpdateAnswer::Refused(Length),
        UpdateAnswer::Refused(OtherBoard),
        UpdateAnswer::Refused(Order(300)),
        UpdateAnswer::Refused(Signature),
        UpdateAnswer::Refused(OnTrial),
        UpdateAnswer::Refused(SupplyLow),
        UpdateAnswer::Refused(Store),
        UpdateAnswer::State {
            board: "stm32f405rg",
            size: 393_216,
            has_key: true,
            on_trial: false,
        },
        UpdateAnswer::Refused(TooOften),
        UpdateAnswer::Loader,
    ]
};

#[test]
fn the_frames_of_an_update_never_change() {
    let mut buffer = [0; MAX_FRAME_BYTES];
    // Of the requests, then of the answers, encoded by an independent program.
    let mut frames = include_str!("update_frames.txt").lines();
    let mut check = |frame: &[u8]| {
        assert_eq!(Some(hex(frame).as_str()), frames.next());
        receive(frame).remove(0).unwrap()
    };
    for (sequence, request) in (42..).zip(update_requests()) {
        let inside = check(write_update_request(&mut buffer, sequence, &request).unwrap());
        let expected = Ok((sequence, Incoming::Update(request)));
        assert_eq!(read_request(&inside), expected);
        assert_eq!(read_frozen_request(&inside), expected);
    }
    for (sequence, answer) in (42..).zip(UPDATE_ANSWERS) {
        let inside = check(write_update_answer(&mut buffer, sequence, &answer).unwrap());
        let expected = Ok((sequence, Outgoing::Update(answer)));
        assert_eq!(read_answer(&inside), expected);
    }
    assert_eq!(frames.next(), None);
    let largest = UpdateRequest::Bytes {
        offset: u32::MAX,
        bytes: &[0; MAX_UPDATE_BYTES],
    };
    assert!(write_update_request(&mut buffer, 255, &largest).is_ok());
}

fn receive(bytes: &[u8]) -> Vec<Result<Vec<u8>, Unreadable>> {
    let mut receiver = Receiver::new();
    let take = |byte: &u8| receiver.push(*byte).map(|frame| frame.map(<[u8]>::to_vec));
    bytes.iter().filter_map(take).collect()
}

#[test]
fn every_message_arrives_as_it_was_sent() {
    let mut buffer = [0; MAX_FRAME_BYTES];
    for (sequence, request) in (0..).zip(requests()) {
        let frame = write_request(&mut buffer, sequence, &request).unwrap();
        let inside = receive(frame).remove(0).unwrap();
        let expected = Ok((sequence, Incoming::Request(request)));
        assert_eq!(read_request(&inside), expected);
    }
    for (sequence, response) in (0..).zip(responses()) {
        let frame = write_response(&mut buffer, sequence, &response).unwrap();
        let inside = receive(frame).remove(0).unwrap();
        let expected = Ok((sequence, Outgoing::Response(response)));
        assert_eq!(read_answer(&inside), expected);
    }
    let inside = receive(write_identity_request(&mut buffer, 9).unwrap()).remove(0);
    assert_eq!(read_request(&inside.unwrap()), Ok((9, Incoming::Identity)));
    let identity = Identity {
        version: VERSION,
        schema: SCHEMA,
        image: "kband 0.1.0",
    };
    let inside = receive(write_identity(&mut buffer, 9, &identity).unwrap()).remove(0);
    let expected = Ok((9, Outgoing::Identity(identity)));
    assert_eq!(read_answer(&inside.unwrap()), expected);
}

#[test]
fn no_frame_of_telemetry_is_longer_than_the_line_plans_for() {
    let report = Report {
        margin: Some(GearMargin::default()),
        load: Some(Load::default()),
        target_band: Some([0.0; 2]),
        ..Report::default()
    };
    // Numbers of variable length at their largest size.
    let telemetry = Telemetry {
        cycle: u32::MAX,
        k: f32::MAX,
        state: u8::MAX,
        fault: u8::MAX,
        limits: u16::MAX,
        ..Telemetry::from(&report)
    };
    let mut buffer = [0; MAX_FRAME_BYTES];
    let frame = write_response(&mut buffer, 0, &Response::Telemetry(telemetry)).unwrap();
    assert_eq!(frame.len(), TELEMETRY_FRAME);
}

#[test]
fn a_pin_is_4_to_8_digits() {
    for digits in ["0000", "0420", "12345678", "00000001"] {
        let pin = Pin::parse(digits).unwrap();
        assert_eq!(Pin::from_number(pin.number()), Some(pin), "{digits}");
        assert_eq!(pin.number().to_string(), format!("1{digits}"));
    }
    for text in ["", "123", "123456789", "12a4", "+123", "１２３４"] {
        assert_eq!(Pin::parse(text), None, "{text}");
    }
    for number in [0, 1, 999, 1_999, 20_000, 99_999, 1_000_000_000, u32::MAX] {
        assert_eq!(Pin::from_number(number), None, "{number}");
    }
}

#[test]
fn a_frame_is_refused_for_what_is_wrong_with_it() {
    let mut buffer = [0; MAX_FRAME_BYTES];
    let frame = write_request(&mut buffer, 7, &Request::Get("frequency"));
    let frame = frame.unwrap().to_vec();
    let refusal = |bytes: &[u8]| match receive(bytes).pop()? {
        Ok(inside) => read_request(&inside).err(),
        Err(reason) => Some(reason),
    };
    for cut in 1..frame.len() - 1 {
        let short = [&frame[..cut], &[0]].concat();
        assert_eq!(refusal(&short), Some(Unreadable::Corrupt), "cut at {cut}");
    }
    let long = [&[1; MAX_FRAME_BYTES + 1][..], &[0]].concat();
    assert_eq!(refusal(&long), Some(Unreadable::Oversized));
    // Another version, another schema, a trailing byte, an unknown message.
    let inside = receive(&frame).remove(0).unwrap();
    let content = &inside[..inside.len() - 4];
    let foreign = |at: usize| {
        let mut content = content.to_vec();
        content[at] ^= 0x40;
        content
    };
    let unknown = [&content[..4], &[0x7f]].concat();
    let trailing = [content, &[1]].concat();
    let question = std::vec![0, 1, 2];
    let update = std::vec![0, 1, b'u', 7];
    let update_and_more = std::vec![0, 1, b'u', 0, 0];
    let unknown = [unknown, trailing, question, update, update_and_more];
    let unknown = unknown.map(|content| (content, Unreadable::Unknown));
    let foreign = [0, 1, 2].map(|at| (foreign(at), Unreadable::Foreign));
    for (content, reason) in foreign.into_iter().chain(unknown) {
        let mut buffer = [0; MAX_FRAME_BYTES];
        let bytes = frame::write_inside(&mut buffer, &content).to_vec();
        assert_eq!(refusal(&bytes), Some(reason), "{content:x?}");
    }
    // Zeros between frames are nothing; the receiver resynchronizes after any garbage.
    assert_eq!(receive(&[0; 5]), []);
    let resynchronised = [&long[..], &[3, 1, 0][..], &frame[..]].concat();
    assert_eq!(refusal(&resynchronised), None);
}

proptest! {
    #![proptest_config(crate::testing::seeded())]
    #[test]
    fn readings_are_read_as_written(codes: Vec<u16>) {
        let mut bytes = [0; 1024];
        let (mut used, mut before) = (0, 0);
        for &code in &codes {
            let more = write_reading(&mut bytes[used..], before, code);
            prop_assert!(more > 0);
            used += more;
            before = code;
        }
        let (mut rest, mut before) = (&bytes[..used], 0);
        for &code in &codes {
            before = read_reading(&mut rest, before).unwrap();
            prop_assert_eq!(before, code);
        }
        prop_assert_eq!(read_reading(&mut rest, before), None);
    }

    #[test]
    fn readings_of_garbage_end(bytes: Vec<u8>, before: u16) {
        let mut rest = &bytes[..];
        let mut count = 0;
        while read_reading(&mut rest, before).is_some() {
            count += 1;
        }
        prop_assert!(count <= bytes.len());
    }

    #[test]
    fn one_wrong_bit_is_never_taken(at in 0_usize..4096, bit in 0_u8..8) {
        let mut buffer = [0; MAX_FRAME_BYTES];
        let request = Request::Set { key: "restitution_low", value: 0.18 };
        let mut frame = write_request(&mut buffer, 7, &request).unwrap().to_vec();
        let at = at % (frame.len() - 1);
        frame[at] ^= 1 << bit;
        for inside in receive(&frame).into_iter().flatten() {
            prop_assert!(read_request(&inside).is_err());
        }
    }
}

#[test]
fn a_chunk_is_of_whole_words_and_follows_the_last() {
    let check = |offset, size, written| check_chunk(offset, &[0; 300][..size], 1000, written);
    assert_eq!(check(0, 4, 0), Ok(Some(4)));
    assert_eq!(check(4, MAX_UPDATE_BYTES, 4), Ok(Some(260)));
    assert_eq!(check(0, 4, 4), Ok(None));
    assert_eq!(check(8, 4, 4), Err(UpdateRefusal::Order(4)));
    for size in [0, 1, 2, 3, 6, MAX_UPDATE_BYTES + 4] {
        assert_eq!(check(0, size, 0), Err(UpdateRefusal::Length), "{size}");
    }
    assert_eq!(check(992, 8, 992), Ok(Some(1000)));
    assert_eq!(check(996, 8, 996), Err(UpdateRefusal::Length));
    assert_eq!(check(u32::MAX, 4, 0), Err(UpdateRefusal::Length));
}
