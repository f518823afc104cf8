//! The registers themselves.

use super::Access::{self, AtRest, Read, Write};
use super::Form::{self, Float, Long, Word};
use super::Source::{self, Real, Whole};
use super::{Picture, Register, TABLE_VERSION, Words};
use crate::target;
use kband_control::wire::Record;
use kband_control::{Load, Settings};

// Addresses of the registers that a request writes, beside the settings.
pub const CONTROL: u16 = 0;
pub const KIND: u16 = 1;
pub const NUMBER: u16 = 2;
pub const RECIPE: u16 = 8;
pub const SAVE: u16 = 9;

/// A quantity of a drive cycle: unit of the integer, and content.
type Reading = (f32, fn(&Picture<'_>) -> f32);

/// A part of an event: offset, form and content.
type EventPart = (u16, Form, fn(&Record) -> u32);

/// Two lists in one: contents for the board, and descriptions, which its image lacks.
macro_rules! described {
    ($doc:literal $content:ident: $kind:ty, $words:ident;
     $([$name:literal, $unit:literal, $meaning:literal] => $value:expr;)*) => {
        #[doc = $doc]
        pub const $content: &[$kind] = &[$($value),*];
        #[doc = concat!("Words on ", stringify!($content), ".")]
        pub const $words: &[Words] = &[$(Words {
            name: $name,
            unit: $unit,
            accepted: "",
            meaning: $meaning,
        }),*];
    };
}

pub const fn row(address: u16, form: Form, access: Access, source: Source) -> Register {
    Register {
        address,
        form,
        access,
        source,
    }
}

fn load(picture: &Picture<'_>) -> Load {
    let none = Load {
        mass: f32::NAN,
        speed: f32::NAN,
        flow: f32::NAN,
    };
    picture.snapshot.telemetry.load.unwrap_or(none)
}

described! {
        "The quantities of a drive cycle: each is once an integer from 16, once a float from 32."
        READINGS: Reading, READING_WORDS;
        ["k", "", "measured; infinite at rest"] => (1e-3, |p| p.snapshot.telemetry.k);
        ["amplitude", "mm", "measured normal amplitude of the track (symbol b)"] => (1e-3, |p| 1e3 * p.snapshot.telemetry.amplitude);
        ["setpoint", "mm", "amplitude of the target; 0 without one"] => (1e-3, |p| 1e3 * p.snapshot.telemetry.setpoint);
        ["output", "%", "amplitude of the drive's output, of full output"] => (0.01, |p| 100.0 * p.snapshot.telemetry.output);
        ["impacts", "per cycle", "detected impacts"] => (1e-3, |p| p.snapshot.telemetry.rate);
        ["phase of the impacts", "rad", "mean phase of the track at the detected impacts"] => (1e-3, |p| p.snapshot.telemetry.phase);
        ["confidence", "%", "that the parts are in the wanted lock"] => (0.01, |p| 100.0 * p.snapshot.telemetry.confidence);
        ["share in gear", "%", "estimated share of the parts' time in gear"] => (0.01, |p| 100.0 * p.snapshot.telemetry.in_gear);
        ["error of the share", "%", "standard error; infinite where the share is a lower bound"] => (0.01, |p| 100.0 * p.snapshot.telemetry.in_gear_error);
        ["predicted share", "%", "predicted share of time in gear at the setpoint; 0 for a target other than gear"] => (0.01, |p| 100.0 * p.snapshot.telemetry.expected_in_gear);
        ["mass of the parts", "g", "estimated; none out of gear or without track_mass"] => (1.0, |p| load(p).mass);
        ["speed of the parts", "mm/s", "estimated, positive upwards; none as for the mass"] => (0.1, |p| load(p).speed);
        ["flow", "g/s", "estimated; 0 without track_length, none as for the mass"] => (0.1, |p| load(p).flow);
        ["lead", "rad", "phase lead of the track over the output"] => (1e-3, |p| p.snapshot.telemetry.lead);
        ["mean acceleration", "m/s^2", "over the last cycle; about 0 where sensor_zero is right"] => (0.01, |p| p.snapshot.status.mean);
        ["current", "A", "amplitude of the drive's current; 0 without a sensor"] => (0.01, |p| p.snapshot.status.current);
}

/// Address of the first reading as an integer.
pub const FIRST_INTEGER: u16 = 16;
/// Address of the first reading as a float.
pub const FIRST_FLOAT: u16 = 32;

/// Number of registers of [`FIXED`] before the readings.
pub const BEFORE_READINGS: usize = 9;

described! {
        "The registers before the readings, and those between the readings and the settings."
        FIXED: Register, FIXED_WORDS;
        ["control word", "", "bit 0: run; bit 7: acknowledge on a rising edge (authority 2); other bits: 0"] => row(CONTROL, Word, Write, Whole(|p| p.control.into()));
        ["kind of the target", "", "1 to 8: gear of this order; 17 to 24: lock of order 1 to 8; 32: k; 33: amplitude in mm; 34: speed in mm/s; 35: flow in g/s; 36: parts a minute, touching, of the setting part_length; 48: chaos; 0: another, set by the desk"] => row(KIND, Word, Write, Whole(|p| target::encode(p.snapshot.target).0.into()));
        ["number of the target", "", "of kinds 32 to 36; a new kind of these needs its number in the same request"] => row(NUMBER, Float, Write, Real(|p| target::encode(p.snapshot.target).1));
        ["status word", "", "bit 0: ready to start; 1: running; 2: enable input on; 3: fault; 7: limited; 8: target held; 9: bus in control"] => row(4, Word, Read, Whole(|p| p.snapshot.status_word().into()));
        ["state", "", "0 off, 1 starting, 2 holding, 3 capturing, 4 locked, 5 lost, 6 limiting, 7 fault, 8 stopping"] => row(5, Word, Read, Whole(|p| p.snapshot.telemetry.state.into()));
        ["fault", "", "number of the fault; 0 for none"] => row(6, Word, Read, Whole(|p| p.snapshot.telemetry.fault.into()));
        ["limits", "", "bit n: limit n holds the drive back"] => row(7, Word, Read, Whole(|p| p.snapshot.telemetry.limits.into()));
        ["recipe", "", "recipe in use, and to be used: 1 to 7; 0: none, the saved target"] => row(RECIPE, Word, Write, Whole(|p| p.snapshot.status.recipe.into()));
        ["save", "", "write 1 to save settings and target; 0: none requested since the start, 1: not done yet, 2: done, 3: failed"] => row(SAVE, Word, AtRest, Whole(|p| p.snapshot.save as u32));
        ["time", "s", "since the start"] => row(64, Long, Read, Whole(|p| p.snapshot.status.seconds));
        ["drive cycles", "", "since the start or the last change of settings"] => row(66, Long, Read, Whole(|p| p.snapshot.telemetry.cycle));
        ["missed deadlines", "", "drive cycles whose control was late"] => row(68, Long, Read, Whole(|p| p.snapshot.missed));
        ["events", "", "since the start; the newest has this number less one"] => row(70, Long, Read, Whole(|p| p.snapshot.events));
        ["requests", "", "answered over the bus"] => row(72, Long, Read, Whole(|p| p.counters.requests));
        ["exceptions", "", "requests that were answered by an exception"] => row(74, Long, Read, Whole(|p| p.counters.exceptions));
        ["damaged frames", "", "with a wrong checksum or length"] => row(76, Long, Read, Whole(|p| p.counters.damaged));
        ["version of the table", "", "raised with each new register other than a setting"] => row(80, Word, Read, Whole(|_| TABLE_VERSION.into()));
        ["number of settings", "", "from register 100 on"] => row(81, Word, Read, Whole(|_| Settings::KEYS.len() as u32));
}

/// Address of the image's name, after the settings and the events.
pub const NAME: u16 = 1100;

pub const NAME_WORDS: Words = Words {
    name: "image",
    unit: "",
    accepted: "",
    meaning: "name, version and commit",
};

described! {
        "Parts of an event."
        EVENT: EventPart, EVENT_WORDS;
        ["event: number", "", "of the newest; the older ones follow, 8 registers each"] => (0, Long, |record| record.number);
        ["event: drive cycle", "", "since the start or the last change of settings"] => (2, Long, |record| record.cycle);
        ["event: kind", "", "number of the event; 0 without one"] => (4, Word, |record| record.event.into());
        ["event: fault", "", "fault at that time; 0 for none"] => (5, Word, |record| record.fault.into());
        ["event: mass of the parts", "g", "where the event is a weighing, else 0"] => (6, Float, |record| record.mass.to_bits());
}
