//! The server: takes a request, refuses what is not one, answers the rest.
//!
//! `rmodbus` 0.13 reads and writes the frames of functions 3, 4, 6 and 16. It computes with counts
//! and lengths before it checks them. So it gets only requests whose lengths are right.

use heapless::Vec;
use rmodbus::server::{ModbusFrame, Read, Write};
use rmodbus::{ErrorKind, ModbusProto};

use crate::identification;
use crate::machine::{Machine, Refused};
use crate::registers::{self, Picture};
use crate::write;

/// Largest request or answer, bytes: unit, function and 252 bytes of data.
pub const MAX_ADU_BYTES: usize = 254;
/// Bytes before the unit in the frames of TCP, the one form of `rmodbus` without a checksum.
const HEADER: usize = 6;
/// Largest number of registers that a request reads.
const MAX_READ: u16 = 125;
/// Largest number of registers that a request writes.
pub(crate) const MAX_WRITE: u16 = 123;

/// Room for an answer, with the header of TCP or the checksum of RTU.
pub type Answer = Vec<u8, { MAX_ADU_BYTES + HEADER }>;

/// Function codes that are answered.
mod function {
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

impl From<Exception> for ErrorKind {
    fn from(exception: Exception) -> Self {
        Self::from_modbus_error(exception as u8)
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
            | function::WRITE_SEVERAL => self.access(adu, machine, answer),
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

    /// Reads or writes registers.
    fn access(
        &mut self,
        adu: &[u8],
        machine: &mut impl Machine,
        answer: &mut Answer,
    ) -> Result<(), Exception> {
        if !is_well_formed(adu) {
            return Err(Exception::Value);
        }
        let mut framed = [0; HEADER + MAX_ADU_BYTES];
        // The smallest length that is accepted; the length of the slice counts.
        framed[HEADER - 1] = HEADER as u8;
        let framed = &mut framed[..HEADER + adu.len()];
        framed[HEADER..].copy_from_slice(adu);
        let failed = |_| Exception::Value;
        let mut frame =
            ModbusFrame::new(adu[0], framed, ModbusProto::TcpUdp, answer).with_broadcast_units(&[]);
        frame.parse().map_err(failed)?;
        if frame.readonly {
            if let Read::Words(read) = frame.get_external_read().map_err(failed)? {
                self.read(read.address, read.buf, machine)?;
            }
        } else {
            if let Write::Words(words) = frame.get_external_write().map_err(failed)? {
                write::write(self, words.address, words.data, machine)?;
            }
            frame.process_external_write(Ok(())).map_err(failed)?;
        }
        answer.copy_within(HEADER.., 0);
        answer.truncate(answer.len().saturating_sub(HEADER));
        Ok(())
    }

    /// Fills `bytes` with the registers from `address` on.
    fn read(
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

/// Whether the lengths of a request to read or write registers are right.
fn is_well_formed(adu: &[u8]) -> bool {
    match *adu {
        [
            _,
            function::READ_HOLDING | function::READ_INPUT,
            _,
            _,
            high,
            low,
        ] => (1..=MAX_READ).contains(&u16::from_be_bytes([high, low])),
        [_, function::WRITE_ONE, _, _, _, _] => true,
        [
            _,
            function::WRITE_SEVERAL,
            _,
            _,
            high,
            low,
            bytes,
            ref data @ ..,
        ] => {
            let count = u16::from_be_bytes([high, low]);
            (1..=MAX_WRITE).contains(&count)
                && u16::from(bytes) == 2 * count
                && data.len() == usize::from(bytes)
        }
        _ => false,
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
