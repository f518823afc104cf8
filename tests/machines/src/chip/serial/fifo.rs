//! Registers of a serial port of the STM32G474, with its FIFOs (RM0440, chapter 37).

use super::{EMPTY, RECEIVED, RECEIVER, SENT, Serial, TRANSMITTER};

/// Bits of CR1 (37.8.1).
pub const ON: u32 = 1;
const FIFOS: u32 = 1 << 29;
/// Number of bytes in each FIFO.
const DEPTH: usize = 8;
/// Bits of ISR that a write to ICR clears: errors, idle, sent (37.8.11).
const CLEARED: u32 = 0x5f;

impl Serial {
    pub(super) fn fifo_depth(&self) -> usize {
        if self.control[0] & FIFOS != 0 {
            DEPTH
        } else {
            1
        }
    }

    pub(super) fn read_fifo(&mut self, offset: u32) -> u32 {
        match offset {
            0x00..=0x08 => self.control[offset as usize / 4],
            0x0c => self.rate,
            0x1c => {
                let acknowledged = |part, bit: u32| u32::from(self.is_on(part)) << bit;
                self.status | acknowledged(TRANSMITTER, 21) | acknowledged(RECEIVER, 22)
            }
            0x24 => {
                let value = self.data;
                match self.received.pop_front() {
                    Some(next) => self.data = next.into(),
                    None => self.status &= !RECEIVED,
                }
                value
            }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chip::clocks::TICKS;
    use crate::chip::kind::Kind;
    use crate::chip::serial::{IDLE, OVERRUN};

    /// 170 MHz / 115 200, with the interrupts of received bytes and of an idle line.
    fn port(fifos: u32) -> Serial {
        let mut serial = Serial::new(Kind::Stm32g474);
        serial.set_cycle(TICKS / 170_000_000);
        serial.write(0x0c, 1476, 0);
        let control = ON | fifos | RECEIVER | TRANSMITTER | RECEIVED | IDLE;
        serial.write(0x00, control, 0);
        serial
    }

    #[test]
    fn eight_bytes_wait_and_the_ninth_is_lost() {
        let mut serial = port(FIFOS);
        serial.receive(0, b"123456789");
        serial.happen(TICKS);
        assert_eq!((serial.lost, serial.garbled), (1, 0));
        assert_ne!(serial.read(0x1c) & OVERRUN, 0);
        for byte in b"12345678" {
            assert_ne!(serial.read(0x1c) & RECEIVED, 0);
            assert_eq!(serial.read(0x24), u32::from(*byte));
        }
        assert_eq!(serial.read(0x1c) & RECEIVED, 0);
        let mut single = port(0);
        single.receive(0, b"12");
        single.happen(TICKS);
        assert_eq!(single.lost, 1);
    }

    #[test]
    fn flags_are_cleared_by_their_own_register() {
        let mut serial = port(FIFOS);
        serial.receive(0, b"k");
        serial.happen(TICKS / 1000);
        serial.happen(TICKS);
        serial.read(0x24);
        assert!(serial.interrupts(), "idle");
        serial.write(0x20, IDLE, TICKS);
        assert!(!serial.interrupts());
    }

    #[test]
    fn bytes_that_fit_the_fifo_are_sent_in_order() {
        let mut serial = port(FIFOS);
        for byte in 1..=9 {
            assert_ne!(serial.read(0x1c) & EMPTY, 0, "{byte}");
            serial.write(0x28, byte, 0);
        }
        assert_eq!(serial.read(0x1c) & (EMPTY | SENT), 0, "full");
        for _ in 0..9 {
            serial.happen(TICKS);
        }
        let sent: Vec<u8> = serial.sent.iter().map(|(_, byte)| *byte).collect();
        assert_eq!(sent, [1, 2, 3, 4, 5, 6, 7, 8, 9]);
        assert_ne!(serial.read(0x1c) & SENT, 0);
    }
}
