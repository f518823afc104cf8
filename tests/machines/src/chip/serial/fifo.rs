//! Registers of a serial port of the STM32G474, with its FIFOs (RM0440, chapter 37).

use super::{EMPTY, RECEIVER, SENT, Serial, TRANSMITTER};

/// Bits of CR1 (37.8.1).
pub const ON: u32 = 1;
pub const FIFOS: u32 = 1 << 29;
/// Number of bytes in each FIFO.
pub const DEPTH: usize = 8;
/// Bits of ISR that a write to ICR clears: errors, idle, sent (37.8.11).
const CLEARED: u32 = 0x5f;

impl Serial {
    pub(super) fn read_fifo(&mut self, offset: u32) -> u32 {
        match offset {
            0x00..=0x08 => self.control[offset as usize / 4],
            0x0c => self.rate,
            0x1c => {
                let acknowledged = |part, bit: u32| u32::from(self.is_on(part)) << bit;
                self.flags() | acknowledged(TRANSMITTER, 21) | acknowledged(RECEIVER, 22)
            }
            0x24 => self.received.pop_front().unwrap_or(0).into(),
            _ => 0,
        }
    }

    pub(super) fn write_fifo(&mut self, offset: u32, value: u32, now: u64) {
        match offset {
            0x00 => {
                self.control[0] = value;
                // The port off: nothing is received or sent.
                if value & ON == 0 {
                    self.status = SENT | EMPTY;
                    self.received.clear();
                    self.waiting.clear();
                    self.shifting = None;
                }
            }
            0x04 | 0x08 => self.control[offset as usize / 4] = value,
            0x0c => self.rate = value & 0xffff,
            0x20 => self.status &= !(value & CLEARED),
            0x28 => self.send(value as u8, now),
            _ => {}
        }
    }
}
