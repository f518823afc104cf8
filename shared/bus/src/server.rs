//! The server: takes a request, rejects invalid ones, answers the rest.

use crate::identification;
use crate::machine::Machine;
use crate::protocol::{Answer, Counters, Exception, MAX_ADU_BYTES, function};
use crate::registers::{self, Picture};
use crate::write;
use kband_control::BusCommand;

/// Largest number of registers in a request.
const MAX_READ: u16 = 125;
const MAX_WRITE: u16 = 123;

/// The server of one board.
#[derive(Clone, Copy, Debug, Default)]
pub struct Server {
    pub(crate) counters: Counters,
    /// The control word written last; `None` before the first.
    pub(crate) control: Option<u16>,
    /// Whether, since the last call of [`Server::take_command`], the run bit was 0, the acknowledge
    /// bit rose, and a request was answered.
    pub(crate) run_was_off: bool,
    pub(crate) acknowledge: bool,
    is_active: bool,
}

impl Server {
    /// Counters since the start.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// The commands since the last call, and whether a request was answered. A run bit that was 0
    /// at any time is 0 in one of the commands.
    ///
    /// The drive decides whether it starts. After power-on and after a fault the run bit must be 0
    /// once, and without the enable input nothing starts.
    pub fn take_command(&mut self) -> (BusCommand, bool) {
        let was_off = core::mem::take(&mut self.run_was_off);
        let run = self.control.map(|word| word & write::RUN != 0);
        let command = BusCommand {
            run: if was_off { Some(false) } else { run },
            acknowledge: core::mem::take(&mut self.acknowledge),
        };
        (command, core::mem::take(&mut self.is_active))
    }

    /// Counts a frame with a wrong checksum or length.
    pub(crate) fn count_damaged(&mut self) {
        self.counters.damaged = self.counters.damaged.wrapping_add(1);
    }

    /// Answers a request of unit, function and data; returns whether there is an answer, of these.
    ///
    /// The caller has compared the unit. A function above 127 is not a request and gets no answer.
    // A board calls it from its bus and from its link: one copy saves 3 KiB of flash.
    #[inline(never)]
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
            function::ENCAPSULATED => identification::answer(adu, machine.snapshot().image, answer),
            _ => Err(Exception::Function),
        };
        self.is_active = true;
        self.counters.requests = self.counters.requests.wrapping_add(1);
        if let Err(exception) = result {
            self.counters.exceptions = self.counters.exceptions.wrapping_add(1);
            answer.clear();
            // Three bytes always fit into the answer.
            let _ = answer.extend_from_slice(&[unit, function | 0x80, exception as u8]);
        }
        true
    }
}

/// Functions 3, 4, 6 and 16: reading and writing registers.
fn access(
    server: &mut Server,
    adu: &[u8],
    machine: &mut impl Machine,
    answer: &mut Answer,
) -> Result<(), Exception> {
    let full = |_| Exception::Value;
    let &[unit, function, high, low, ref rest @ ..] = adu else {
        return Err(Exception::Value);
    };
    let address = u16::from_be_bytes([high, low]);
    match (function, rest) {
        (function::READ_HOLDING | function::READ_INPUT, &[high, low]) => {
            let count = u16::from_be_bytes([high, low]);
            if !(1..=MAX_READ).contains(&count) {
                return Err(Exception::Value);
            }
            let head = [unit, function, 2 * count as u8];
            answer.extend_from_slice(&head).map_err(full)?;
            let (snapshot, settings) = (machine.snapshot(), machine.settings());
            let picture = Picture {
                snapshot: &snapshot,
                settings: &settings,
                counters: &server.counters,
                control: server.control.unwrap_or(0),
                event: &|number| machine.event(number),
            };
            for offset in 0..count {
                let address = address.checked_add(offset).ok_or(Exception::Address)?;
                let register = registers::at(address).ok_or(Exception::Address)?;
                let content = register.word(address - register.address, &picture);
                (answer.extend_from_slice(&content.to_be_bytes())).map_err(full)?;
            }
            Ok(())
        }
        (function::WRITE_ONE, word @ [_, _]) => {
            write::write(server, address, word, machine)?;
            answer.extend_from_slice(adu).map_err(full)
        }
        (function::WRITE_SEVERAL, &[high, low, bytes, ref words @ ..]) => {
            let count = u16::from_be_bytes([high, low]);
            if !(1..=MAX_WRITE).contains(&count)
                || u16::from(bytes) != 2 * count
                || words.len() != usize::from(bytes)
            {
                return Err(Exception::Value);
            }
            write::write(server, address, words, machine)?;
            answer.extend_from_slice(&adu[..6]).map_err(full)
        }
        _ => Err(Exception::Value),
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
