//! The table of registers: address and form of each quantity, and its write access.
//!
//! The server's answers, `kband registers` and the manual's page come from it. An address never
//! changes its meaning. New registers get free addresses; new settings are appended to their list.

use crate::machine::Snapshot;
use crate::protocol::Counters;
use kband_control::Settings;
use kband_control::wire::Record;

mod list;

use list::{
    BEFORE_READINGS, EVENT, EVENT_WORDS, FIRST_FLOAT, FIRST_INTEGER, FIXED, FIXED_WORDS, NAME,
    NAME_WORDS, READING_WORDS, READINGS, row,
};
pub(crate) use list::{CONTROL, KIND, NUMBER, RECIPE, SAVE};

/// Version of the table, in a register: raised with each new register other than a setting.
pub(crate) const TABLE_VERSION: u16 = 1;
/// Address of the first setting; setting n is at this plus 2 n.
pub const FIRST_SETTING: u16 = 100;
const FIRST_EVENT: u16 = 1000;
/// Number of events that the table shows, the newest first.
pub const EVENTS: u16 = 8;
const EVENT_REGISTERS: u16 = 8;

/// Form of a register's content.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// 16 bits without sign.
    Word,
    /// 16 bits with sign, in this unit; at most 32767 or -32767, and -32768 for a missing value.
    Scaled(f32),
    /// 32 bits without sign, the high word first.
    Long,
    /// IEEE 754 single precision, the high word first.
    Float,
    /// ASCII text, two characters per register, the first in the high byte; padded with zeros.
    Text(u16),
}

impl Form {
    /// Number of registers.
    pub const fn registers(self) -> u16 {
        match self {
            Self::Word | Self::Scaled(_) => 1,
            Self::Long | Self::Float => 2,
            Self::Text(registers) => registers,
        }
    }
}

/// Write access.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Nothing.
    Read,
    /// With authority 1; all registers in one request.
    Write,
    /// With authority 1 while the drive is at rest; all registers in one request.
    AtRest,
}

/// Data from which all registers are filled.
#[derive(Clone, Copy)]
pub(crate) struct Picture<'a> {
    pub snapshot: &'a Snapshot<'a>,
    pub settings: &'a Settings,
    pub counters: &'a Counters,
    pub control: u16,
    pub event: &'a dyn Fn(u32) -> Option<Record>,
}

#[derive(Clone, Copy)]
enum Source {
    Whole(fn(&Picture<'_>) -> u32),
    Real(fn(&Picture<'_>) -> f32),
    Image,
    Setting(usize),
    Event { age: u16, part: fn(&Record) -> u32 },
}

/// A quantity in the table.
#[derive(Clone, Copy)]
pub struct Register {
    /// Address of its first register, as in the frame: from 0.
    pub address: u16,
    /// Form of its content.
    pub form: Form,
    /// Write access.
    pub access: Access,
    source: Source,
}

/// Description of a register for the manual.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Words {
    /// Its name.
    pub name: &'static str,
    /// Unit; empty for a pure number.
    pub unit: &'static str,
    /// Accepted range in words for a setting; otherwise empty.
    pub accepted: &'static str,
    /// Its meaning.
    pub meaning: &'static str,
}

impl Register {
    /// Address after its last register.
    pub fn end(&self) -> u16 {
        self.address + self.form.registers()
    }

    /// Content of its register `offset` from its first.
    pub(crate) fn word(&self, offset: u16, picture: &Picture<'_>) -> u16 {
        let number = match self.source {
            Source::Whole(of) => of(picture),
            Source::Real(of) => match self.form {
                Form::Scaled(unit) => return scaled(of(picture), unit),
                _ => of(picture).to_bits(),
            },
            Source::Image => return letters(picture.snapshot.image, offset),
            Source::Setting(number) => (picture.settings.values().get(number))
                .copied()
                .unwrap_or_default()
                .to_bits(),
            Source::Event { age, part } => (picture.snapshot.events)
                .checked_sub(1 + u32::from(age))
                .and_then(picture.event)
                .map_or(0, |record| part(&record)),
        };
        match (self.form, offset) {
            (Form::Long | Form::Float, 0) => (number >> 16) as u16,
            _ => number as u16,
        }
    }

    /// Index of its setting in [`Settings::KEYS`]; `None` if it is not a setting.
    pub(crate) fn setting(&self) -> Option<usize> {
        match self.source {
            Source::Setting(number) => Some(number),
            _ => None,
        }
    }
}

/// A quantity in units of `unit`, rounded, as 16 bits with sign.
fn scaled(quantity: f32, unit: f32) -> u16 {
    if quantity.is_nan() {
        return i16::MIN as u16;
    }
    let limit = f32::from(i16::MAX);
    libm::roundf(quantity / unit).clamp(-limit, limit) as i16 as u16
}

/// The pair of characters at `offset` of a text.
fn letters(text: &str, offset: u16) -> u16 {
    let at = 2 * usize::from(offset);
    let letter = |at: usize| text.as_bytes().get(at).copied().unwrap_or(0);
    u16::from_be_bytes([letter(at), letter(at + 1)])
}

fn reading(index: usize, form: Form) -> Option<Register> {
    let &(unit, of) = READINGS.get(index)?;
    let n = index as u16;
    let (address, form) = match form {
        Form::Float => (FIRST_FLOAT + 2 * n, Form::Float),
        _ => (FIRST_INTEGER + n, Form::Scaled(unit)),
    };
    Some(row(address, form, Access::Read, Source::Real(of)))
}

fn setting(index: usize) -> Option<Register> {
    let address = FIRST_SETTING + 2 * index as u16;
    let register = row(address, Form::Float, Access::AtRest, Source::Setting(index));
    (index < Settings::KEYS.len()).then_some(register)
}

fn event(age: u16, part: usize) -> Option<Register> {
    let &(offset, form, part) = EVENT.get(part)?;
    let address = FIRST_EVENT + EVENT_REGISTERS * age + offset;
    let register = row(address, form, Access::Read, Source::Event { age, part });
    (age < EVENTS).then_some(register)
}

const IMAGE: Register = row(NAME, Form::Text(32), Access::Read, Source::Image);

/// The register that contains this address; `None` if there is none.
pub(crate) fn at(address: u16) -> Option<Register> {
    let within = |register: &Register| (register.address..register.end()).contains(&address);
    let found = match address {
        FIRST_INTEGER..FIRST_FLOAT => {
            reading(usize::from(address - FIRST_INTEGER), Form::Scaled(1.0))
        }
        FIRST_FLOAT..64 => reading(usize::from(address - FIRST_FLOAT) / 2, Form::Float),
        FIRST_SETTING..FIRST_EVENT => setting(usize::from(address - FIRST_SETTING) / 2),
        FIRST_EVENT..NAME => {
            let offset = address - FIRST_EVENT;
            let mut parts = (0..EVENT.len()).filter_map(|n| event(offset / EVENT_REGISTERS, n));
            parts.find(within)
        }
        NAME.. => Some(IMAGE),
        _ => FIXED.iter().copied().find(within),
    };
    found.filter(within)
}

/// Every register with its description, in the order of addresses; of the events only the newest.
pub fn all() -> impl Iterator<Item = (Register, Words)> {
    let fixed = || FIXED.iter().copied().zip(FIXED_WORDS.iter().copied());
    let readings = [Form::Scaled(1.0), Form::Float].map(|form| {
        ((0..).map_while(move |n| reading(n, form))).zip(READING_WORDS.iter().copied())
    });
    let settings = Settings::KEYS.iter().map(|key| Words {
        name: key.name,
        unit: key.unit,
        accepted: key.accepted,
        meaning: key.meaning,
    });
    let events = (0..).map_while(|part| event(0, part));
    fixed()
        .take(BEFORE_READINGS)
        .chain(readings.into_iter().flatten())
        .chain(fixed().skip(BEFORE_READINGS))
        .chain((0..).map_while(setting).zip(settings))
        .chain(events.zip(EVENT_WORDS.iter().copied()))
        .chain(core::iter::once((IMAGE, NAME_WORDS)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::vec::Vec;

    #[test]
    fn no_address_is_used_twice_and_each_is_found() {
        let mut addresses = BTreeSet::new();
        let mut before = 0;
        for (register, words) in all() {
            assert!(register.address >= before, "{}", words.name);
            before = register.end();
            for address in register.address..register.end() {
                assert!(addresses.insert(address), "{address}");
                let found = at(address).map(|found| (found.address, found.form));
                assert_eq!(found, Some((register.address, register.form)));
            }
        }
        for age in 1..EVENTS {
            let first = FIRST_EVENT + EVENT_REGISTERS * age;
            addresses.extend(first..first + EVENT_REGISTERS);
        }
        let found: Vec<u16> = ((0..=u16::MAX).filter(|at| super::at(*at).is_some())).collect();
        assert!(addresses.into_iter().eq(found));
    }

    #[test]
    fn integers_saturate_and_mark_what_is_missing() {
        assert_eq!(scaled(0.8004, 1e-3), 800);
        assert_eq!(scaled(-0.0006, 1e-3) as i16, -1);
        assert_eq!(scaled(f32::INFINITY, 1.0), 0x7fff);
        assert_eq!(scaled(-1e9, 1.0), 0x8001);
        assert_eq!(scaled(f32::NAN, 1.0), 0x8000);
    }
}
