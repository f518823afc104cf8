//! Tests of the server with a simulated drive.

use super::*;
use crate::machine::{Authority, SaveProgress, Snapshot};
use crate::registers::{FIRST_SETTING, TABLE_VERSION};
use crate::{rtu, tcp};
use kband_control::wire::Record;
use kband_control::{Settings, State, Target};
use std::vec::Vec as List;

struct TestDrive {
    snapshot: Snapshot<'static>,
    settings: Settings,
    saves: u32,
    server: Server,
}

impl Default for TestDrive {
    fn default() -> Self {
        let mut snapshot = Snapshot {
            authority: Authority::Acknowledge,
            target: Target::Gear { order: 1 },
            image: "kband 0.1.0 0123456789ab",
            events: 3,
            ..Snapshot::default()
        };
        snapshot.telemetry.k = 1.25;
        snapshot.status.seconds = 0x0001_0002;
        Self {
            snapshot,
            settings: Settings::default(),
            saves: 0,
            server: Server::default(),
        }
    }
}

impl Machine for TestDrive {
    fn snapshot(&self) -> Snapshot<'_> {
        self.snapshot
    }

    fn settings(&self) -> Settings {
        self.settings
    }

    fn event(&self, number: u32) -> Option<Record> {
        (number < 3).then_some(Record {
            number,
            cycle: 100 * number,
            event: 1 + number as u8,
            fault: 0,
            mass: 0.0,
            flow: 0.0,
        })
    }

    fn set_target(&mut self, target: Target) -> Result<(), Exception> {
        if target == Target::K(20.0) {
            return Err(Exception::Value);
        }
        self.snapshot.target = target;
        Ok(())
    }

    fn set_settings(&mut self, settings: &Settings) -> Result<(), Exception> {
        settings.check().map_err(|_| Exception::Value)?;
        self.settings = *settings;
        Ok(())
    }

    fn save(&mut self) -> Result<(), Exception> {
        self.saves += 1;
        self.snapshot.save = SaveProgress::Done;
        Ok(())
    }
}

/// Answer to these bytes of unit 1; empty without an answer.
fn request(drive: &mut TestDrive, pdu: &[u8]) -> List<u8> {
    let adu = [&[1], pdu].concat();
    let (mut server, mut answer) = (drive.server, Answer::new());
    let is_answered = server.answer(&adu, drive, &mut answer);
    drive.server = server;
    assert!(!is_answered || answer[0] == 1);
    answer.get(1..).unwrap_or_default().to_vec()
}

fn assert_no_command(server: &mut Server) {
    assert_eq!(server.take_command().0, BusCommand::default());
}

fn read(address: u16, count: u16) -> [u8; 5] {
    let ([a, b], [c, d]) = (address.to_be_bytes(), count.to_be_bytes());
    [3, a, b, c, d]
}

fn write(address: u16, words: &[u16]) -> List<u8> {
    let mut pdu = List::from([16]);
    pdu.extend(address.to_be_bytes());
    pdu.extend((words.len() as u16).to_be_bytes());
    pdu.push(2 * words.len() as u8);
    pdu.extend(words.iter().flat_map(|word| word.to_be_bytes()));
    pdu
}

fn float(number: f32) -> [u16; 2] {
    let bits = number.to_bits();
    [(bits >> 16) as u16, bits as u16]
}

fn refuses(drive: &mut TestDrive, pdu: &[u8], code: Exception) {
    assert_eq!(request(drive, pdu), [pdu[0] | 0x80, code as u8], "{pdu:?}");
}

fn accepted(drive: &mut TestDrive, pdu: &[u8]) {
    assert_eq!(request(drive, pdu), pdu[..5], "{pdu:?}");
}

#[test]
fn both_read_functions_read_the_same_registers() {
    let mut drive = TestDrive::default();
    let holding = request(&mut drive, &read(32, 2));
    assert_eq!(holding, [3, 4, 0x3f, 0xa0, 0, 0]);
    let mut input = read(32, 2);
    input[0] = 4;
    assert_eq!(request(&mut drive, &input)[1..], holding[1..]);
    // The scaled k, a long, a text and the last setting.
    assert_eq!(request(&mut drive, &read(16, 1)), [3, 2, 0x04, 0xe2]);
    assert_eq!(request(&mut drive, &read(64, 2)), [3, 4, 0, 1, 0, 2]);
    assert_eq!(request(&mut drive, &read(1100, 3))[2..], *b"kband ");
    let actual = request(&mut drive, &read(80, 1));
    assert_eq!(actual[2..], TABLE_VERSION.to_be_bytes());
    // The newest event first; before the first event there is none.
    let actual = request(&mut drive, &read(1000, 5));
    assert_eq!(actual[2..], [0, 0, 0, 2, 0, 0, 0, 200, 0, 3]);
    assert_eq!(request(&mut drive, &read(1024, 5))[2..], [0; 10]);
}

#[test]
fn a_read_of_no_register_is_refused_as_an_address() {
    let mut drive = TestDrive::default();
    let end = FIRST_SETTING + 2 * Settings::KEYS.len() as u16;
    assert_eq!(request(&mut drive, &read(end - 2, 2)).len(), 6);
    let absent = [(10, 1), (9, 2), (0xffff, 2), (0xff00, 125)];
    for (address, count) in absent.into_iter().chain([(end, 1), (end - 1, 2)]) {
        refuses(&mut drive, &read(address, count), Exception::Address);
    }
    assert_eq!(request(&mut drive, &read(0, 10)).len(), 22);
}

#[test]
fn wrong_lengths_and_counts_are_refused_as_a_value() {
    let mut drive = TestDrive::default();
    let mut long = write(100, &[0; 123]);
    long[4] = 124;
    let mut odd_length = write(0, &[0; 1]);
    odd_length[5] = 3;
    for pdu in [
        &read(0, 0)[..],
        &read(0, 126),
        &read(0, 0xffff),
        &read(0, 1)[..4],
        &[3],
        &[4, 0, 0, 0, 1, 0],
        &[6, 0, 0, 0],
        &[6, 0, 0, 0, 0, 0],
        &write(0, &[]),
        &long,
        &odd_length,
        &write(0, &[0, 0])[..8],
        // The count is one register, the bytes are two registers; then the reverse.
        &[16, 0, 0, 0, 1, 4, 0, 0, 0, 0],
        &[16, 0, 0, 0, 2, 2, 0, 0],
    ] {
        refuses(&mut drive, pdu, Exception::Value);
    }
    assert_no_command(&mut drive.server);
}

#[test]
fn other_functions_are_refused_and_answers_are_ignored() {
    let mut drive = TestDrive::default();
    for function in 1..=0x7f {
        if !matches!(function, 3 | 4 | 6 | 8 | 16 | 43) {
            refuses(&mut drive, &[function, 0, 0, 0, 1], Exception::Function);
        }
    }
    for function in [0, 0x80, 0x83, 0xff] {
        assert!(request(&mut drive, &[function, 2]).is_empty());
    }
    // Only the diagnostics' echo and the encapsulated requests' identification are supported.
    let actual = request(&mut drive, &[8, 0, 0, 0xa5, 0x5a]);
    assert_eq!(actual, [8, 0, 0, 0xa5, 0x5a]);
    refuses(&mut drive, &[8, 0, 1, 0, 0], Exception::Function);
    refuses(&mut drive, &[43, 13, 1, 0], Exception::Function);
}

#[test]
fn the_identification_names_vendor_product_and_revision() {
    let mut drive = TestDrive::default();
    let basic = request(&mut drive, &[43, 14, 1, 0]);
    let objects = b"\x00\x05kband\x01\x06feeder\x02\x18kband 0.1.0 0123456789ab";
    assert_eq!(basic[..7], [43, 14, 1, 0x81, 0, 0, 3]);
    assert_eq!(basic[7..], objects[..]);
    let one = request(&mut drive, &[43, 14, 4, 1]);
    let expected = [&[43, 14, 4, 0x81, 0, 0, 1][..], b"\x01\x06feeder"].concat();
    assert_eq!(expected, one);
    refuses(&mut drive, &[43, 14, 4, 3], Exception::Address);
    refuses(&mut drive, &[43, 14, 3, 0], Exception::Value);
    refuses(&mut drive, &[43, 14, 1], Exception::Value);
}

#[test]
fn without_authority_nothing_is_written() {
    let mut drive = TestDrive::default();
    drive.snapshot.authority = Authority::Read;
    for pdu in [
        write(0, &[1]),
        write(1, &[2]),
        write(8, &[0]),
        write(9, &[1]),
        write(100, &float(60.0)),
    ] {
        refuses(&mut drive, &pdu, Exception::NotInControl);
    }
    refuses(&mut drive, &[6, 0, 0, 0, 1], Exception::NotInControl);
    assert_no_command(&mut drive.server);
    assert_eq!(drive.saves, 0);
    assert_eq!(drive.settings, Settings::default());
    assert_eq!(drive.snapshot.target, Target::Gear { order: 1 });
}

#[test]
fn the_acknowledge_bit_needs_authority_and_an_edge() {
    let mut drive = TestDrive::default();
    for (word, acknowledge) in [(0x80, false), (0, false), (0x80, true), (0x81, false)] {
        accepted(&mut drive, &write(0, &[word]));
        let run = Some(word & 1 == 1);
        let expected = (BusCommand { run, acknowledge }, true);
        assert_eq!(drive.server.take_command(), expected, "{word}");
    }
    assert_eq!(request(&mut drive, &read(0, 1)), [3, 2, 0, 0x81]);
    drive.snapshot.authority = Authority::Command;
    accepted(&mut drive, &write(0, &[0]));
    refuses(&mut drive, &write(0, &[0x81]), Exception::NotInControl);
    // The refused word is not the last one.
    assert_eq!(request(&mut drive, &read(0, 1)), [3, 2, 0, 0]);
    // The run bit was 0 in between: the first command is a stop.
    accepted(&mut drive, &write(0, &[1]));
    for (run, is_active) in [(false, true), (true, false)] {
        let (command, active) = drive.server.take_command();
        let expected = (Some(run), false, is_active);
        assert_eq!((command.run, command.acknowledge, active), expected);
    }
    refuses(&mut drive, &write(0, &[2]), Exception::Value);
}

#[test]
fn a_target_is_written_whole_and_in_its_range() {
    let mut drive = TestDrive::default();
    let with = |kind, number| {
        let [high, low] = float(number);
        write(1, &[kind, high, low])
    };
    accepted(&mut drive, &with(33, 0.4));
    assert_eq!(drive.snapshot.target, Target::Amplitude(0.4));
    assert_eq!(request(&mut drive, &read(1, 3))[2..], with(33, 0.4)[6..]);
    accepted(&mut drive, &with(36, 120.0));
    assert_eq!(drive.snapshot.target, Target::PartsPerMinute(120.0));
    accepted(&mut drive, &with(33, 0.4));
    // A number alone; a kind without a number; the same kind again.
    accepted(&mut drive, &write(2, &float(0.5)));
    assert_eq!(drive.snapshot.target, Target::Amplitude(0.5));
    accepted(&mut drive, &write(1, &[33]));
    accepted(&mut drive, &write(1, &[18]));
    assert_eq!(drive.snapshot.target, Target::Locked { order: 2 });
    // A number without a kind for it, another kind without its number, an undefined kind.
    refuses(&mut drive, &write(2, &float(0.5)), Exception::Value);
    for kind in [0, 9, 16, 25, 32, 33, 34, 35, 49, 0xffff] {
        refuses(&mut drive, &write(1, &[kind]), Exception::Value);
    }
    for (kind, number) in [(37, 100.0), (32, f32::NAN), (32, f32::INFINITY), (32, 20.0)] {
        refuses(&mut drive, &with(kind, number), Exception::Value);
    }
    // Half a number has no address.
    refuses(&mut drive, &write(2, &[0]), Exception::Address);
    refuses(&mut drive, &write(1, &[33, 0]), Exception::Address);
    refuses(&mut drive, &write(3, &[0, 0]), Exception::Address);
    assert_eq!(drive.snapshot.target, Target::Locked { order: 2 });
}

#[test]
fn a_refused_target_leaves_the_control_word() {
    let mut drive = TestDrive::default();
    let [high, low] = float(20.0);
    refuses(&mut drive, &write(0, &[1, 32, high, low]), Exception::Value);
    assert_no_command(&mut drive.server);
    let [high, low] = float(0.8);
    accepted(&mut drive, &write(0, &[1, 32, high, low]));
    assert_eq!(drive.snapshot.target, Target::K(0.8));
    assert_eq!(drive.server.take_command().0.run, Some(true));
}

#[test]
fn settings_are_written_at_rest_and_never_the_bus_ones() {
    let mut drive = TestDrive::default();
    let of = |name: &str| {
        let index = Settings::KEYS.iter().position(|key| key.name == name);
        FIRST_SETTING + 2 * index.unwrap() as u16
    };
    accepted(&mut drive, &write(of("frequency"), &float(60.0)));
    assert_eq!(drive.settings.frequency, 60.0);
    let actual = request(&mut drive, &read(of("frequency"), 2));
    assert_eq!(actual[2..], [0x42, 0x70, 0, 0]);
    // Two values that are accepted only together.
    let both = [float(0.3), float(0.4)].concat();
    accepted(&mut drive, &write(of("restitution_low"), &both));
    assert_eq!(drive.settings.restitution_low, 0.3);
    let before = drive.settings;
    for invalid in [f32::NAN, 4.9, 501.0] {
        let frequency = write(of("frequency"), &float(invalid));
        refuses(&mut drive, &frequency, Exception::Value);
    }
    let bus_keys = (Settings::KEYS.iter()).filter(|key| key.name.starts_with("bus"));
    assert_eq!(bus_keys.clone().count(), 5);
    for key in bus_keys {
        let is_low = key.default == key.low;
        let other = if is_low { key.high } else { key.low };
        let name = key.name;
        let changed = write(of(name), &float(other));
        refuses(&mut drive, &changed, Exception::NotInControl);
        accepted(&mut drive, &write(of(name), &float(key.default)));
    }
    drive.snapshot.telemetry.state = State::Holding.number();
    let pdus = [write(of("frequency"), &float(50.0)), write(9, &[1])];
    for pdu in &pdus {
        refuses(&mut drive, pdu, Exception::Busy);
    }
    drive.snapshot.telemetry.state = State::Off.number();
    drive.snapshot.writable = false;
    for pdu in &pdus {
        refuses(&mut drive, pdu, Exception::NotInControl);
    }
    assert_eq!((drive.settings, drive.saves), (before, 0));
    // Target and run bit need no writable settings.
    accepted(&mut drive, &write(1, &[2]));
}

#[test]
fn a_save_is_requested_by_one_and_a_recipe_by_zero_only() {
    let mut drive = TestDrive::default();
    accepted(&mut drive, &write(9, &[1]));
    assert_eq!(drive.saves, 1);
    assert_eq!(request(&mut drive, &read(9, 1)), [3, 2, 0, 2]);
    refuses(&mut drive, &write(9, &[2]), Exception::Value);
    accepted(&mut drive, &write(8, &[0]));
    refuses(&mut drive, &write(8, &[1]), Exception::Value);
    refuses(&mut drive, &write(4, &[0]), Exception::Address);
    assert_eq!(drive.saves, 1);
}

#[test]
fn both_transports_answer_alike() {
    let mut drive = TestDrive::default();
    let mut answer = Answer::new();
    let mut server = Server::default();
    let mut frame = List::from([17, 3, 0, 0, 0, 10]);
    frame.extend(rtu::crc(&frame).to_le_bytes());
    let answered = rtu::answer(&mut server, 17, &frame, &mut drive, &mut answer);
    assert!(answered);
    let serial = rtu::check(&answer).unwrap().to_vec();
    let network = [&[0xab, 0xcd, 0, 0, 0, 6][..], &frame[..6]].concat();
    assert_eq!(tcp::frame_length(&network), Ok(Some(12)));
    let adu = &network[tcp::HEADER_BYTES..];
    assert!(server.answer(adu, &mut drive, &mut answer) && tcp::wrap(&network, &mut answer));
    assert_eq!(answer[..6], [0xab, 0xcd, 0, 0, 0, serial.len() as u8]);
    assert_eq!(answer[6..], serial[..]);
    assert_eq!(server.counters().requests, 2);
    // Other units, broadcasts, damaged frames, and invalid headers.
    for unit in [0, 18] {
        let answered = rtu::answer(&mut server, unit, &frame, &mut drive, &mut answer);
        assert!(!answered, "{unit}");
    }
    let mut all = List::from([0, 6, 0, 0, 0, 1]);
    all.extend(rtu::crc(&all).to_le_bytes());
    assert!(!rtu::answer(&mut server, 17, &all, &mut drive, &mut answer));
    assert!(!rtu::answer(&mut server, 0, &all, &mut drive, &mut answer));
    assert_eq!(server.counters().damaged, 0);
    for bit in 0..8 * frame.len() {
        let mut flipped = frame.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        let answered = rtu::answer(&mut server, 17, &flipped, &mut drive, &mut answer);
        assert!(!answered, "{bit}");
    }
    assert_eq!(server.counters().damaged, 64);
    for header in [[0, 0, 0, 1, 0, 6], [0, 0, 0, 0, 0, 255]] {
        assert_eq!(tcp::frame_length(&header), Err(tcp::NotModbus));
    }
    assert_eq!(tcp::frame_length(&network[..5]), Ok(None));
    assert_no_command(&mut server);
}

#[test]
fn the_status_word_shows_each_of_its_bits() {
    let mut snapshot = Snapshot::default();
    assert_eq!(snapshot.status_word(), 0);
    snapshot.status.inputs.enable = true;
    assert_eq!(snapshot.status_word(), 0b100);
    snapshot.status.permitted = true;
    assert_eq!(snapshot.status_word(), 0b101);
    snapshot.telemetry.state = State::Locked.number();
    assert_eq!(snapshot.status_word(), 0b110);
    snapshot.telemetry.limits = 1 << 4;
    assert_eq!(snapshot.status_word(), 0b1000_0110);
    snapshot.status.ready = true;
    assert_eq!(snapshot.status_word(), 0b1_1000_0110);
    snapshot.authority = Authority::Command;
    assert_eq!(snapshot.status_word(), 0b11_1000_0110);
    (snapshot.telemetry.state, snapshot.telemetry.fault) = (State::Fault.number(), 4);
    assert_eq!(snapshot.status_word(), 0b11_1000_1100);
}

#[test]
fn authority_needs_an_address() {
    let of = |bus, bus_address| {
        Authority::of(&Settings {
            bus,
            bus_address,
            ..Settings::default()
        })
    };
    assert_eq!(Authority::of(&Settings::default()), Authority::Read);
    assert_eq!(of(2.0, 0.0), Authority::Read);
    assert_eq!(of(0.0, 17.0), Authority::Read);
    assert_eq!(of(1.0, 17.0), Authority::Command);
    assert_eq!(of(2.0, 17.0), Authority::Acknowledge);
}
