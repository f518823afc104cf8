//! Writing registers: the whole request is checked before any of it takes effect.

use crate::machine::{Authority, Machine};
use crate::protocol::Exception;
use crate::registers::{self, Access, CONTROL, KIND, NUMBER, RECIPE, SAVE};
use crate::server::Server;
use crate::target;
use kband_control::{Settings, Target};

/// Bit of the control word: run.
pub const RUN: u16 = 1 << 0;
/// Bit of the control word: acknowledge, on a rising edge.
const ACKNOWLEDGE: u16 = 1 << 7;

/// Values that a request writes.
#[derive(Default)]
struct Written {
    control: Option<u16>,
    kind: Option<u16>,
    number: Option<f32>,
    recipe: Option<u16>,
    save: Option<u16>,
    settings: Option<Settings>,
}

/// Writes the registers from `address` on with these words, the high byte first.
pub fn write(
    server: &mut Server,
    address: u16,
    words: &[u8],
    machine: &mut impl Machine,
) -> Result<(), Exception> {
    let snapshot = machine.snapshot();
    let (at_rest, writable) = (snapshot.at_rest(), snapshot.writable);
    let (authority, target) = (snapshot.authority, snapshot.target);
    let written = read_request(address, words, &machine.settings())?;
    if authority < Authority::Command {
        return Err(Exception::NotInControl);
    }
    // Before the first control word the acknowledge bit has no edge.
    let acknowledge = (written.control).is_some_and(|word| word & ACKNOWLEDGE != 0)
        && (server.control).is_some_and(|before| before & ACKNOWLEDGE == 0);
    if acknowledge && authority < Authority::Acknowledge {
        return Err(Exception::NotInControl);
    }
    let new_target = new_target(target, &written)?;
    match written.save {
        None => {}
        Some(1) if !writable => return Err(Exception::NotInControl),
        Some(1) if !at_rest => return Err(Exception::Busy),
        Some(1) => {}
        Some(_) => return Err(Exception::Value),
    }
    if let Some(settings) = &written.settings {
        let of_bus = |it: &Settings| {
            let address = [it.bus, it.bus_address, it.bus_timeout];
            (address, it.bus_baud, it.bus_parity)
        };
        if !writable || of_bus(settings) != of_bus(&machine.settings()) {
            return Err(Exception::NotInControl);
        }
        if !at_rest {
            return Err(Exception::Busy);
        }
        machine.set_settings(settings)?;
    }
    if let Some(recipe) = written.recipe {
        machine.select_recipe(recipe)?;
    }
    if let Some(target) = new_target {
        machine.set_target(target)?;
    }
    if written.save.is_some() {
        machine.save()?;
    }
    if let Some(word) = written.control {
        server.control = Some(word);
        server.run_was_off |= word & RUN == 0;
        server.acknowledge |= acknowledge;
    }
    Ok(())
}

/// Reads the words of a request as the registers that they fill.
fn read_request(address: u16, bytes: &[u8], settings: &Settings) -> Result<Written, Exception> {
    let mut written = Written::default();
    let (mut words, _) = bytes.as_chunks::<2>();
    let mut address = address;
    while let Some((first, _)) = words.split_first() {
        let register = registers::at(address)
            .filter(|register| register.address == address && register.access != Access::Read)
            .ok_or(Exception::Address)?;
        let length = usize::from(register.form.registers());
        let (number, rest) = words.split_at_checked(length).ok_or(Exception::Address)?;
        let high = u16::from_be_bytes(*first);
        let low = number.last().map_or(0, |word| u16::from_be_bytes(*word));
        let float = f32::from_bits(u32::from(high) << 16 | u32::from(low));
        match (register.address, register.setting()) {
            (_, Some(number)) => {
                let key = Settings::KEYS.get(number).ok_or(Exception::Address)?;
                let changed = written.settings.get_or_insert(*settings);
                changed.set(key.name, float).map_err(|_| Exception::Value)?;
            }
            (CONTROL, _) if high & !(RUN | ACKNOWLEDGE) != 0 => return Err(Exception::Value),
            (CONTROL, _) => written.control = Some(high),
            (KIND, _) => written.kind = Some(high),
            (NUMBER, _) => written.number = Some(float),
            (RECIPE, _) => written.recipe = Some(high),
            (SAVE, _) => written.save = Some(high),
            _ => return Err(Exception::Address),
        }
        (address, words) = (register.end(), rest);
    }
    Ok(written)
}

/// The target that a request sets; `None` if it is the present one.
///
/// A kind with a number never reuses the number of another kind: k = 0.8 must not become 0.8 mm.
fn new_target(present: Target, written: &Written) -> Result<Option<Target>, Exception> {
    let (kind_now, number_now) = target::encode(present);
    let (kind, number) = match (written.kind, written.number) {
        (None, None) => return Ok(None),
        (None, _) if !target::has_number(kind_now) => return Err(Exception::Value),
        (Some(kind), None) if target::has_number(kind) && kind != kind_now => {
            return Err(Exception::Value);
        }
        (kind, number) => (kind.unwrap_or(kind_now), number.unwrap_or(number_now)),
    };
    let target = target::decode(kind, number).ok_or(Exception::Value)?;
    Ok((target != present).then_some(target))
}
