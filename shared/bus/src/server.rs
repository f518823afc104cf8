//! The server: takes a request, refuses what is not one, answers the rest.

use heapless::Vec;

use crate::access::access;
use crate::identification;
use crate::machine::{Machine, Refused};
use crate::registers::{self, Picture};

/// Largest request or answer, bytes: unit, function and 252 bytes of data.
pub const MAX_ADU_BYTES: usize = 254;
/// Bytes before the unit in the frames of TCP.
pub(crate) const HEADER: usize = 6;

/// Room for an answer, with the header of TCP or the checksum of RTU.
pub type Answer = Vec<u8, { MAX_ADU_BYTES + HEADER }>;

/// Function codes that are answered.
pub(crate) mod function {
    pub const READ_HOLDING: u8 = 3;
    pub const READ_INPUT: u8 = 4;
    pub const WRITE_ONE: u8 = 6;
    pub const DIAGNOSTICS: u8 = 8;
    pub const WRITE_SEVERAL: u8 = 16;
    pub const ENCAPSULATED: u8 = 43;
}

/// Exception codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exception {
    /// The function is not answered.
    Function = 1,
    /// There is no such register, it is not writable, or only a part of it was written.
    Address = 2,
    /// A number is out of range.
    Value = 3,
    /// The authority does not suffice, or the link is in control.
    NotInControl = 4,
    /// The drive runs, or the memory is busy.
    Busy = 6,
}

impl From<Refused> for Exception {
    fn from(refused: Refused) -> Self {
        match refused {
            Refused::Value => Self::Value,
            Refused::NotInControl => Self::NotInControl,
            Refused::Busy => Self::Busy,
        }
    }
}

/// Counters of a server since its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Requests that were answered.
    pub requests: u32,
    /// Of these, requests that were answered by an exception.
    pub exceptions: u32,
    /// Frames with a wrong checksum or length.
    pub damaged: u32,
}

/// The server of one board.
#[derive(Clone, Copy, Debug, Default)]
pub struct Server {
    pub(crate) counters: Counters,
    /// The control word written last; `None` before the first.
    pub(crate) control: Option<u16>,
}

impl Server {
    /// Counters since the start.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Counts a frame with a wrong checksum or length.
    pub fn count_damaged(&mut self) {
        self.counters.damaged = self.counters.damaged.wrapping_add(1);
    }

    /// Answers a request of unit, function and data; returns whether there is an answer, which then
    /// has the same parts.
    ///
    /// The caller has compared the unit. A function above 127 is no request: it has no answer.
    pub fn answer(&mut self, adu: &[u8], machine: &mut impl Machine, answer: &mut Answer) -> bool {
        answer.clear();
        let (&[unit, function, ..], 2..=MAX_ADU_BYTES) = (adu, adu.len()) else {
            self.count_damaged();
            return false;
        };
        if function == 0 || function > 0x7f {
            return false;
        }
        let result = match function {
            function::READ_HOLDING
            | function::READ_INPUT
            | function::WRITE_ONE
            | function::WRITE_SEVERAL => access(self, adu, machine, answer),
            function::DIAGNOSTICS => echo(adu, answer),
            function::ENCAPSULATED => identification::answer(adu, machine.seen().image, answer),
            _ => Err(Exception::Function),
        };
        self.counters.requests = self.counters.requests.wrapping_add(1);
        if let Err(exception) = result {
            self.counters.exceptions = self.counters.exceptions.wrapping_add(1);
            answer.clear();
            // Three bytes always fit.
            let _ = answer.extend_from_slice(&[unit, function | 0x80, exception as u8]);
        }
        true
    }

    /// Fills `bytes` with the registers from `address` on.
    pub(crate) fn read(
        &self,
        address: u16,
        bytes: &mut [u8],
        machine: &impl Machine,
    ) -> Result<(), Exception> {
        let (seen, settings) = (machine.seen(), machine.settings());
        let picture = Picture {
            seen: &seen,
            settings: &settings,
            counters: &self.counters,
            control: self.control.unwrap_or(0),
            event: &|number| machine.event(number),
        };
        let (words, _) = bytes.as_chunks_mut::<2>();
        for (offset, word) in (0..).zip(words) {
            let address = address.checked_add(offset).ok_or(Exception::Address)?;
            let register = registers::at(address).ok_or(Exception::Address)?;
            let content = register.word(address - register.address, &picture);
            *word = content.to_be_bytes();
        }
        Ok(())
    }
}

/// Diagnostics: subfunction 0 returns the request.
fn echo(adu: &[u8], answer: &mut Answer) -> Result<(), Exception> {
    match adu {
        [_, _, 0, 0, _, _, ..] => answer.extend_from_slice(adu).map_err(|_| Exception::Value),
        [_, _, 0, 0, ..] => Err(Exception::Value),
        _ => Err(Exception::Function),
    }
}

#[cfg(test)]
mod tests;
