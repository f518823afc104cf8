//! The server against a drive of the desk.

use super::*;
use crate::machine::{Authority, SaveProgress, Seen};
use crate::registers::{FIRST_SETTING, TABLE_VERSION};
use crate::{rtu, tcp};
use kband_control::wire::Record;
use kband_control::{Settings, State, Target};
use std::vec::Vec as List;

struct Desk {
    authority: Authority,
    state: State,
    writable: bool,
    settings: Settings,
    target: Target,
    saves: u32,
    commands: List<(bool, bool)>,
}

impl Default for Desk {
    fn default() -> Self {
        Self {
            authority: Authority::Acknowledge,
            state: State::Off,
            writable: true,
            settings: Settings::default(),
            target: Target::Gear { order: 1 },
            saves: 0,
            commands: List::new(),
        }
    }
}

impl Machine for Desk {
    fn seen(&self) -> Seen<'_> {
        let mut seen = Seen {
            authority: self.authority,
            target: self.target,
            writable: self.writable,
            image: "kband 0.1.0 0123456789ab",
            events: 3,
            ..Seen::default()
        };
        if self.saves > 0 {
            seen.save = SaveProgress::Done;
        }
        seen.telemetry.state = self.state.number();
        seen.telemetry.k = 1.25;
        seen.status.seconds = 0x0001_0002;
        seen
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

    fn command(&mut self, run: bool, acknowledge: bool) {
        self.commands.push((run, acknowledge));
    }

    fn set_target(&mut self, target: Target) -> Result<(), Exception> {
        if target == Target::K(20.0) {
            return Err(Exception::Value);
        }
        self.target = target;
        Ok(())
    }

    fn set_settings(&mut self, settings: &Settings) -> Result<(), Exception> {
        settings.check().map_err(|_| Exception::Value)?;
        self.settings = *settings;
        Ok(())
    }

    fn save(&mut self) -> Result<(), Exception> {
        self.saves += 1;
        Ok(())
    }
}

/// Answer of a new server to these bytes of unit 1.
fn ask(desk: &mut Desk, pdu: &[u8]) -> List<u8> {
    ask_server(&mut Server::default(), desk, pdu)
}

fn ask_server(server: &mut Server, desk: &mut Desk, pdu: &[u8]) -> List<u8> {
    let adu: List<u8> = [1].into_iter().chain(pdu.iter().copied()).collect();
    let mut answer = Answer::new();
    if server.answer(&adu, desk, &mut answer) {
        assert_eq!(answer[0], 1);
        answer[1..].to_vec()
    } else {
        List::new()
    }
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

fn exception(function: u8, exception: Exception) -> List<u8> {
    List::from([function | 0x80, exception as u8])
}

fn refuses(desk: &mut Desk, pdu: &[u8], why: Exception) {
    assert_eq!(ask(desk, pdu), exception(pdu[0], why), "{pdu:?}");
}

fn accepted(desk: &mut Desk, pdu: &[u8]) {
    assert_eq!(ask(desk, pdu), pdu[..5], "{pdu:?}");
}

#[test]
fn both_read_functions_read_the_same_registers() {
    let mut desk = Desk::default();
    let holding = ask(&mut desk, &read(32, 2));
    assert_eq!(holding, [3, 4, 0x3f, 0xa0, 0, 0]);
    let mut input = read(32, 2);
    input[0] = 4;
    assert_eq!(ask(&mut desk, &input)[1..], holding[1..]);
    // The scaled k, a long, a text and the last setting.
    assert_eq!(ask(&mut desk, &read(16, 1)), [3, 2, 0x04, 0xe2]);
    assert_eq!(ask(&mut desk, &read(64, 2)), [3, 4, 0, 1, 0, 2]);
    assert_eq!(ask(&mut desk, &read(1100, 3))[2..], *b"kband ");
    let found = ask(&mut desk, &read(80, 1));
    assert_eq!(found[2..], TABLE_VERSION.to_be_bytes());
    // The newest event first; before the first event there is none.
    let found = ask(&mut desk, &read(1000, 5));
    assert_eq!(found[2..], [0, 0, 0, 2, 0, 0, 0, 200, 0, 3]);
    assert_eq!(ask(&mut desk, &read(1024, 5))[2..], [0; 10]);
}

#[test]
fn a_read_of_no_register_is_refused_as_an_address() {
    let mut desk = Desk::default();
    let end = FIRST_SETTING + 2 * Settings::KEYS.len() as u16;
    assert_eq!(ask(&mut desk, &read(end - 2, 2)).len(), 6);
    for (address, count) in [
        (10, 1),
        (9, 2),
        (end, 1),
        (end - 1, 2),
        (0xffff, 2),
        (0xff00, 125),
    ] {
        let answer = ask(&mut desk, &read(address, count));
        assert_eq!(answer, exception(3, Exception::Address), "{address}");
    }
    assert_eq!(ask(&mut desk, &read(0, 10)).len(), 22);
}

#[test]
fn wrong_lengths_and_counts_are_refused_as_a_value() {
    let mut desk = Desk::default();
    let mut long = write(100, &[0; 123]);
    long[4] = 124;
    let mut uneven = write(0, &[0; 1]);
    uneven[5] = 3;
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
        &uneven,
        &write(0, &[0, 0])[..8],
        // The count says one register, the bytes are of two; and the other way around.
        &[16, 0, 0, 0, 1, 4, 0, 0, 0, 0],
        &[16, 0, 0, 0, 2, 2, 0, 0],
    ] {
        let answer = ask(&mut desk, pdu);
        assert_eq!(answer, exception(pdu[0], Exception::Value), "{pdu:?}");
    }
    assert!(desk.commands.is_empty());
}

#[test]
fn other_functions_are_refused_and_answers_are_ignored() {
    let mut desk = Desk::default();
    for function in 1..=0x7f {
        if !matches!(function, 3 | 4 | 6 | 8 | 16 | 43) {
            let answer = ask(&mut desk, &[function, 0, 0, 0, 1]);
            assert_eq!(answer, exception(function, Exception::Function));
        }
    }
    for function in [0, 0x80, 0x83, 0xff] {
        assert!(ask(&mut desk, &[function, 2]).is_empty());
    }
    // Only the echo of the diagnostics, only the identification of the encapsulated requests.
    let found = ask(&mut desk, &[8, 0, 0, 0xa5, 0x5a]);
    assert_eq!(found, [8, 0, 0, 0xa5, 0x5a]);
    refuses(&mut desk, &[8, 0, 1, 0, 0], Exception::Function);
    refuses(&mut desk, &[43, 13, 1, 0], Exception::Function);
}

#[test]
fn the_identification_names_vendor_product_and_revision() {
    let mut desk = Desk::default();
    let basic = ask(&mut desk, &[43, 14, 1, 0]);
    let objects = b"\x00\x05kband\x01\x06feeder\x02\x18kband 0.1.0 0123456789ab";
    assert_eq!(basic[..7], [43, 14, 1, 0x81, 0, 0, 3]);
    assert_eq!(basic[7..], objects[..]);
    let one = ask(&mut desk, &[43, 14, 4, 1]);
    let wanted = [&[43, 14, 4, 0x81, 0, 0, 1][..], b"\x01\x06feeder"].concat();
    assert_eq!(wanted, one);
    refuses(&mut desk, &[43, 14, 4, 3], Exception::Address);
    refuses(&mut desk, &[43, 14, 3, 0], Exception::Value);
    refuses(&mut desk, &[43, 14, 1], Exception::Value);
}

#[test]
fn without_authority_nothing_is_written() {
    let mut desk = Desk {
        authority: Authority::Read,
        ..Desk::default()
    };
    for pdu in [
        write(0, &[1]),
        write(1, &[2]),
        write(8, &[0]),
        write(9, &[1]),
        write(100, &float(60.0)),
    ] {
        refuses(&mut desk, &pdu, Exception::NotInControl);
    }
    refuses(&mut desk, &[6, 0, 0, 0, 1], Exception::NotInControl);
    assert!(desk.commands.is_empty() && desk.saves == 0);
    assert_eq!(desk.settings, Settings::default());
    assert_eq!(desk.target, Target::Gear { order: 1 });
}

#[test]
fn the_acknowledge_bit_needs_authority_and_an_edge() {
    let mut desk = Desk::default();
    let mut server = Server::default();
    for (word, acknowledge) in [(0x80, false), (0, false), (0x80, true), (0x81, false)] {
        ask_server(&mut server, &mut desk, &write(0, &[word]));
        let wanted = Some((word & 1 == 1, acknowledge));
        assert_eq!(wanted, desk.commands.pop(), "{word}");
    }
    let found = ask_server(&mut server, &mut desk, &read(0, 1));
    assert_eq!(found, [3, 2, 0, 0x81]);
    desk.authority = Authority::Command;
    ask_server(&mut server, &mut desk, &write(0, &[0]));
    let refused = ask_server(&mut server, &mut desk, &write(0, &[0x81]));
    assert_eq!(refused, exception(16, Exception::NotInControl));
    // The refused word is not the last one.
    let found = ask_server(&mut server, &mut desk, &read(0, 1));
    assert_eq!(found, [3, 2, 0, 0]);
    assert_eq!(desk.commands, [(false, false)]);
    refuses(&mut desk, &write(0, &[2]), Exception::Value);
}

#[test]
fn a_target_is_written_whole_and_in_its_range() {
    let mut desk = Desk::default();
    let with = |kind, number| {
        let [high, low] = float(number);
        write(1, &[kind, high, low])
    };
    accepted(&mut desk, &with(33, 0.4));
    assert_eq!(desk.target, Target::Amplitude(0.4));
    assert_eq!(ask(&mut desk, &read(1, 3))[2..], with(33, 0.4)[6..]);
    accepted(&mut desk, &with(36, 120.0));
    assert_eq!(desk.target, Target::PartsPerMinute(120.0));
    accepted(&mut desk, &with(33, 0.4));
    // Its number alone; a kind without number alone; the same kind again.
    accepted(&mut desk, &write(2, &float(0.5)));
    assert_eq!(desk.target, Target::Amplitude(0.5));
    accepted(&mut desk, &write(1, &[33]));
    accepted(&mut desk, &write(1, &[18]));
    assert_eq!(desk.target, Target::Locked { order: 2 });
    // A number without a kind for it, another kind without its number, no such kind.
    refuses(&mut desk, &write(2, &float(0.5)), Exception::Value);
    for kind in [0, 9, 16, 25, 32, 33, 34, 35, 49, 0xffff] {
        refuses(&mut desk, &write(1, &[kind]), Exception::Value);
    }
    for (kind, number) in [(37, 100.0), (32, f32::NAN), (32, f32::INFINITY), (32, 20.0)] {
        refuses(&mut desk, &with(kind, number), Exception::Value);
    }
    // Half a number has no address.
    refuses(&mut desk, &write(2, &[0]), Exception::Address);
    refuses(&mut desk, &write(1, &[33, 0]), Exception::Address);
    refuses(&mut desk, &write(3, &[0, 0]), Exception::Address);
    assert_eq!(desk.target, Target::Locked { order: 2 });
}

#[test]
fn a_refused_target_leaves_the_control_word() {
    let mut desk = Desk::default();
    let [high, low] = float(20.0);
    let refused = ask(&mut desk, &write(0, &[1, 32, high, low]));
    assert_eq!(refused, exception(16, Exception::Value));
    assert!(desk.commands.is_empty());
    let [high, low] = float(0.8);
    accepted(&mut desk, &write(0, &[1, 32, high, low]));
    let wanted = (Target::K(0.8), &[(true, false)][..]);
    assert_eq!(wanted, (desk.target, &desk.commands[..]));
}

#[test]
fn settings_are_written_at_rest_and_never_the_bus_ones() {
    let mut desk = Desk::default();
    let of = |name: &str| {
        let index = Settings::KEYS.iter().position(|key| key.name == name);
        FIRST_SETTING + 2 * index.unwrap() as u16
    };
    accepted(&mut desk, &write(of("frequency"), &float(60.0)));
    assert_eq!(desk.settings.frequency, 60.0);
    let found = ask(&mut desk, &read(of("frequency"), 2));
    assert_eq!(found[2..], [0x42, 0x70, 0, 0]);
    // Two that only fit together.
    let mut both = [0; 4];
    both[..2].copy_from_slice(&float(0.3));
    both[2..].copy_from_slice(&float(0.4));
    accepted(&mut desk, &write(of("restitution_low"), &both));
    assert_eq!(desk.settings.restitution_low, 0.3);
    let before = desk.settings;
    for bad in [f32::NAN, 4.9, 501.0] {
        let refused = ask(&mut desk, &write(of("frequency"), &float(bad)));
        assert_eq!(refused, exception(16, Exception::Value));
    }
    for own in [
        "bus",
        "bus_address",
        "bus_baud",
        "bus_parity",
        "bus_timeout",
    ] {
        let key = Settings::KEYS.iter().find(|key| key.name == own).unwrap();
        let other = if key.default == key.low {
            key.high
        } else {
            key.low
        };
        let refused = ask(&mut desk, &write(of(own), &float(other)));
        assert_eq!(refused, exception(16, Exception::NotInControl), "{own}");
        accepted(&mut desk, &write(of(own), &float(key.default)));
    }
    desk.state = State::Holding;
    for pdu in [write(of("frequency"), &float(50.0)), write(9, &[1])] {
        refuses(&mut desk, &pdu, Exception::Busy);
    }
    desk.state = State::Off;
    desk.writable = false;
    for pdu in [write(of("frequency"), &float(50.0)), write(9, &[1])] {
        refuses(&mut desk, &pdu, Exception::NotInControl);
    }
    assert_eq!((desk.settings, desk.saves), (before, 0));
    // Target and run need no writable settings.
    accepted(&mut desk, &write(1, &[2]));
}

#[test]
fn a_save_is_requested_by_one_and_a_recipe_by_zero_only() {
    let mut desk = Desk::default();
    accepted(&mut desk, &write(9, &[1]));
    assert_eq!(desk.saves, 1);
    assert_eq!(ask(&mut desk, &read(9, 1)), [3, 2, 0, 2]);
    refuses(&mut desk, &write(9, &[2]), Exception::Value);
    accepted(&mut desk, &write(8, &[0]));
    refuses(&mut desk, &write(8, &[1]), Exception::Value);
    refuses(&mut desk, &write(4, &[0]), Exception::Address);
    assert_eq!(desk.saves, 1);
}

#[test]
fn both_transports_answer_alike() {
    let mut desk = Desk::default();
    let mut answer = Answer::new();
    let mut server = Server::default();
    let mut frame = List::from([17, 3, 0, 0, 0, 10]);
    frame.extend(rtu::crc(&frame).to_le_bytes());
    assert!(rtu::answer(&mut server, 17, &frame, &mut desk, &mut answer));
    let serial = rtu::check(&answer).unwrap().to_vec();
    let network = [&[0xab, 0xcd, 0, 0, 0, 6][..], &frame[..6]].concat();
    assert_eq!(tcp::frame_length(&network), Ok(Some(12)));
    assert!(tcp::answer(&mut server, &network, &mut desk, &mut answer));
    assert_eq!(answer[..6], [0xab, 0xcd, 0, 0, 0, serial.len() as u8]);
    assert_eq!(answer[6..], serial[..]);
    assert_eq!(server.counters().requests, 2);
    // Other units, all units, damage, and what is no header.
    for unit in [0, 18] {
        assert!(!rtu::answer(
            &mut server,
            unit,
            &frame,
            &mut desk,
            &mut answer
        ));
    }
    let mut all = List::from([0, 6, 0, 0, 0, 1]);
    all.extend(rtu::crc(&all).to_le_bytes());
    assert!(!rtu::answer(&mut server, 17, &all, &mut desk, &mut answer));
    assert!(!rtu::answer(&mut server, 0, &all, &mut desk, &mut answer));
    assert_eq!(server.counters().damaged, 0);
    for bit in 0..8 * frame.len() {
        let mut flipped = frame.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        assert!(!rtu::answer(
            &mut server,
            17,
            &flipped,
            &mut desk,
            &mut answer
        ));
    }
    assert_eq!(server.counters().damaged, 64);
    assert_eq!(tcp::frame_length(&[0, 0, 0, 1, 0, 6]), Err(tcp::NotModbus));
    let found = tcp::frame_length(&[0, 0, 0, 0, 0, 255]);
    assert_eq!(found, Err(tcp::NotModbus));
    assert_eq!(tcp::frame_length(&network[..5]), Ok(None));
    assert!(desk.commands.is_empty());
}

#[test]
fn the_status_word_shows_each_of_its_bits() {
    let word = |change: fn(&mut Seen<'_>)| {
        let mut seen = Seen::default();
        change(&mut seen);
        seen.status_word()
    };
    assert_eq!(word(|_| {}), 0);
    let enable: fn(&mut Seen<'_>) = |seen| {
        seen.status.inputs.enable = true;
        seen.status.permitted = true;
    };
    assert_eq!(word(enable), 0b101);
    assert_eq!(word(|seen| seen.status.inputs.enable = true), 0b100);
    let found = word(|seen| seen.telemetry.state = State::Locked.number());
    assert_eq!(found, 0b10);
    let fault = |seen: &mut Seen<'_>| {
        seen.telemetry.state = State::Fault.number();
        seen.telemetry.fault = 4;
    };
    assert_eq!(word(fault), 0b1000);
    assert_eq!(word(|seen| seen.telemetry.limits = 1 << 4), 1 << 7);
    assert_eq!(word(|seen| seen.status.ready = true), 1 << 8);
    assert_eq!(word(|seen| seen.authority = Authority::Command), 1 << 9);
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
