//! The registers themselves.

use kband_control::wire::Record;
use kband_control::{Load, Settings};

use super::Access::{self, AtRest, Read, Write};
use super::Form::{self, Float, Long, Word};
use super::Source::{self, Real, Whole};
use super::{Picture, Register, TABLE_VERSION};
use crate::target;

/// Address of the control word.
pub const CONTROL: u16 = 0;
/// Address of the target's kind.
pub const KIND: u16 = 1;
/// Address of the target's number.
pub const NUMBER: u16 = 2;
/// Address of the recipe.
pub const RECIPE: u16 = 8;
/// Address of the request to save.
pub const SAVE: u16 = 9;

/// Number of registers of the image's name, two characters each.
pub const NAME_REGISTERS: u16 = 32;

/// A quantity of a drive cycle: name and unit, unit of the integer, content, meaning.
type Reading = (
    [&'static str; 2],
    f32,
    fn(&Picture<'_>) -> f32,
    &'static str,
);

/// A part of an event: offset, form, name and unit, content, meaning.
type EventPart = (
    u16,
    Form,
    [&'static str; 2],
    fn(&Record) -> u32,
    &'static str,
);

pub const fn row(
    address: u16,
    form: Form,
    [name, unit]: [&'static str; 2],
    access: Access,
    source: Source,
    meaning: &'static str,
) -> Register {
    Register {
        address,
        form,
        name,
        unit,
        access,
        accepted: "",
        meaning,
        source,
    }
}

fn load(picture: &Picture<'_>) -> Load {
    let none = Load {
        mass: f32::NAN,
        speed: f32::NAN,
        flow: f32::NAN,
    };
    picture.seen.telemetry.load.unwrap_or(none)
}

/// The quantities of a drive cycle: each is once an integer from 16, once a float from 32.
pub const READINGS: [Reading; 16] = [
    (
        ["k", ""],
        1e-3,
        |p| p.seen.telemetry.k,
        "measured; infinite at rest",
    ),
    (
        ["amplitude", "mm"],
        1e-3,
        |p| 1e3 * p.seen.telemetry.amplitude,
        "measured normal amplitude of the track (symbol b)",
    ),
    (
        ["setpoint", "mm"],
        1e-3,
        |p| 1e3 * p.seen.telemetry.setpoint,
        "amplitude of the target; 0 without one",
    ),
    (
        ["output", "%"],
        0.01,
        |p| 100.0 * p.seen.telemetry.output,
        "amplitude of the drive's output, of full output",
    ),
    (
        ["impacts", "per cycle"],
        1e-3,
        |p| p.seen.telemetry.rate,
        "detected impacts",
    ),
    (
        ["phase of the impacts", "rad"],
        1e-3,
        |p| p.seen.telemetry.phase,
        "mean phase of the track at the detected impacts",
    ),
    (
        ["confidence", "%"],
        0.01,
        |p| 100.0 * p.seen.telemetry.confidence,
        "that the parts are in the wanted lock",
    ),
    (
        ["share in gear", "%"],
        0.01,
        |p| 100.0 * p.seen.telemetry.in_gear,
        "estimated share of the parts' time in gear",
    ),
    (
        ["error of the share", "%"],
        0.01,
        |p| 100.0 * p.seen.telemetry.in_gear_error,
        "standard error; infinite where the share is a lower bound",
    ),
    (
        ["predicted share", "%"],
        0.01,
        |p| 100.0 * p.seen.telemetry.expected_in_gear,
        "predicted share of time in gear at the setpoint; 0 for a target other than gear",
    ),
    (
        ["mass of the parts", "g"],
        1.0,
        |p| load(p).mass,
        "estimated; none out of gear or without track_mass",
    ),
    (
        ["speed of the parts", "mm/s"],
        0.1,
        |p| load(p).speed,
        "estimated, positive upwards; none as for the mass",
    ),
    (
        ["flow", "g/s"],
        0.1,
        |p| load(p).flow,
        "estimated; 0 without track_length, none as for the mass",
    ),
    (
        ["lead", "rad"],
        1e-3,
        |p| p.seen.telemetry.lead,
        "phase lead of the track over the output",
    ),
    (
        ["mean acceleration", "m/s^2"],
        0.01,
        |p| p.seen.status.mean,
        "over the last cycle; about 0 where sensor_zero is right",
    ),
    (
        ["current", "A"],
        0.01,
        |p| p.seen.status.current,
        "amplitude of the drive's current; 0 without a sensor",
    ),
];

/// Address of the first reading as an integer.
pub const FIRST_INTEGER: u16 = 16;
/// Address of the first reading as a float.
pub const FIRST_FLOAT: u16 = 32;

/// The registers before the readings, and those between the readings and the settings.
pub const FIXED: [Register; 18] = [
    row(
        CONTROL,
        Word,
        ["control word", ""],
        Write,
        Whole(|p| p.control.into()),
        "bit 0: run; bit 7: acknowledge on a rising edge (authority 2); other bits: 0",
    ),
    row(
        KIND,
        Word,
        ["kind of the target", ""],
        Write,
        Whole(|p| target::encode(p.seen.target).0.into()),
        "1 to 8: gear of this order; 17 to 24: lock of order 1 to 8; 32: k; 33: amplitude in mm; 34: speed in mm/s; 35: flow in g/s; 36: parts a minute (refused: no counter); 48: chaos; 0: another, set by the desk",
    ),
    row(
        NUMBER,
        Float,
        ["number of the target", ""],
        Write,
        Real(|p| target::encode(p.seen.target).1),
        "of kinds 32 to 35; a new kind of these needs its number in the same request",
    ),
    row(
        4,
        Word,
        ["status word", ""],
        Read,
        Whole(|p| p.seen.status_word().into()),
        "bit 0: ready to start; 1: running; 2: enable input on; 3: fault; 7: limited; 8: target held; 9: bus in control",
    ),
    row(
        5,
        Word,
        ["state", ""],
        Read,
        Whole(|p| p.seen.telemetry.state.into()),
        "0 off, 1 starting, 2 holding, 3 capturing, 4 locked, 5 lost, 6 limiting, 7 fault, 8 stopping",
    ),
    row(
        6,
        Word,
        ["fault", ""],
        Read,
        Whole(|p| p.seen.telemetry.fault.into()),
        "number of the fault; 0 for none",
    ),
    row(
        7,
        Word,
        ["limits", ""],
        Read,
        Whole(|p| p.seen.telemetry.limits.into()),
        "bit n: limit n holds the drive back",
    ),
    row(
        RECIPE,
        Word,
        ["recipe", ""],
        Write,
        Whole(|p| p.seen.recipe.into()),
        "0: none",
    ),
    row(
        SAVE,
        Word,
        ["save", ""],
        AtRest,
        Whole(|p| p.seen.save as u32),
        "write 1 to save settings and target; 0: none requested since the start, 1: not done yet, 2: done, 3: failed",
    ),
    row(
        64,
        Long,
        ["time", "s"],
        Read,
        Whole(|p| p.seen.status.seconds),
        "since the start",
    ),
    row(
        66,
        Long,
        ["drive cycles", ""],
        Read,
        Whole(|p| p.seen.telemetry.cycle),
        "since the start or the last change of settings",
    ),
    row(
        68,
        Long,
        ["missed deadlines", ""],
        Read,
        Whole(|p| p.seen.missed),
        "drive cycles whose control was late",
    ),
    row(
        70,
        Long,
        ["events", ""],
        Read,
        Whole(|p| p.seen.events),
        "since the start; the newest has this number less one",
    ),
    row(
        72,
        Long,
        ["requests", ""],
        Read,
        Whole(|p| p.counters.requests),
        "answered over the bus",
    ),
    row(
        74,
        Long,
        ["exceptions", ""],
        Read,
        Whole(|p| p.counters.exceptions),
        "requests that were answered by an exception",
    ),
    row(
        76,
        Long,
        ["damaged frames", ""],
        Read,
        Whole(|p| p.counters.damaged),
        "with a wrong checksum or length",
    ),
    row(
        80,
        Word,
        ["version of the table", ""],
        Read,
        Whole(|_| TABLE_VERSION.into()),
        "raised with each new register other than a setting",
    ),
    row(
        81,
        Word,
        ["number of settings", ""],
        Read,
        Whole(|_| Settings::KEYS.len() as u32),
        "from register 100 on",
    ),
];

/// Address of the image's name, after the settings and the events.
pub const NAME: u16 = 1100;

/// Parts of an event.
pub const EVENT: [EventPart; 5] = [
    (
        0,
        Long,
        ["event: number", ""],
        |record| record.number,
        "of the newest; the older ones follow, 8 registers each",
    ),
    (
        2,
        Long,
        ["event: drive cycle", ""],
        |record| record.cycle,
        "since the start or the last change of settings",
    ),
    (
        4,
        Word,
        ["event: kind", ""],
        |record| record.event.into(),
        "number of the event; 0 without one",
    ),
    (
        5,
        Word,
        ["event: fault", ""],
        |record| record.fault.into(),
        "fault at that time; 0 for none",
    ),
    (
        6,
        Float,
        ["event: mass of the parts", "g"],
        |record| record.mass.to_bits(),
        "where the event is a weighing, else 0",
    ),
];
