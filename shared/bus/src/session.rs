//! State of a server, and its picture of the registers.

use crate::machine::Machine;
use crate::protocol::{Counters, Exception};
use crate::registers::{self, Picture};

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
