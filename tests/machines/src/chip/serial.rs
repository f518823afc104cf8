//! Model of a serial port (RM0090, chapter 30).

use std::collections::VecDeque;

use super::clocks::TICKS;

/// Bits of SR (30.6.1).
const OVERRUN: u32 = 1 << 3;
const IDLE: u32 = 1 << 4;
const RECEIVED: u32 = 1 << 5;
const SENT: u32 = 1 << 6;
const EMPTY: u32 = 1 << 7;
/// Bits of CR1 (30.6.4).
const PARITY: u32 = 1 << 10;
const NINE_BITS: u32 = 1 << 12;
const RECEIVER: u32 = 1 << 2;
const TRANSMITTER: u32 = 1 << 3;
const ON: u32 = 1 << 13;
/// Bit of CR2 for a second stop bit (30.6.5).
const TWO_STOPS: u32 = 1 << 13;

/// Registers of the port and both directions of the line.
#[derive(Clone, Debug)]
pub struct Serial {
    status: u32,
    data: u32,
    rate: u32,
    control: [u32; 4],
    /// Bytes on the way to the chip, each with the tick at which it is complete.
    coming: VecDeque<(u64, u8)>,
    /// Bytes that the chip has sent, each with the tick at which it was complete.
    pub sent: Vec<(u64, u8)>,
    shifting: Option<(u64, u8)>,
    waiting: Option<u8>,
    idle_at: u64,
    /// Flags that a read of the status has returned; a read of the data clears them.
    seen: u32,
    /// Duration of a clock cycle of the port, ticks.
    cycle: u64,
    /// Characters of the other end: bits a second, and bits of a character.
    pub other_end: (u64, u64),
    /// Number of bytes lost because their rate differs from the port's.
    pub garbled: u64,
    /// Whether the transmitter has failed: the byte being sent never ends.
    pub stuck: bool,
    /// Number of bytes lost by overrun, or because they ended between a read of the status and of
    /// the data.
    pub lost: u64,
}

impl Default for Serial {
    fn default() -> Self {
        Self {
            status: SENT | EMPTY,
            data: 0,
            rate: 0,
            control: [0; 4],
            coming: VecDeque::new(),
            sent: Vec::new(),
            shifting: None,
            waiting: None,
            idle_at: u64::MAX,
            seen: 0,
            cycle: 63,
            other_end: (RATE, 10),
            garbled: 0,
            stuck: false,
            lost: 0,
        }
    }
}

/// Rate of the desk's end, bits a second.
pub const RATE: u64 = 115_200;

impl Serial {
    /// Resets the registers; bytes on the line still arrive.
    pub fn reset(&mut self) {
        *self = Self {
            coming: std::mem::take(&mut self.coming),
            sent: std::mem::take(&mut self.sent),
            garbled: self.garbled,
            lost: self.lost,
            cycle: self.cycle,
            other_end: self.other_end,
            ..Self::default()
        };
    }

    pub fn set_cycle(&mut self, cycle: u64) {
        self.cycle = cycle;
    }

    /// Sends bytes from the desk, one after the other from tick `at`.
    pub fn receive(&mut self, at: u64, bytes: &[u8]) {
        let byte = self.other_byte();
        let free = self.coming.back().map_or(0, |last| last.0);
        let mut time = at.max(free);
        for value in bytes {
            time += byte;
            self.coming.push_back((time, *value));
        }
    }

    /// Duration of a character of the other end, ticks.
    pub fn other_byte(&self) -> u64 {
        let (rate, bits) = self.other_end;
        bits * TICKS / rate
    }

    /// Bits of a character: start, data and parity, stop.
    fn bits(&self) -> u64 {
        let data = 8 + u64::from(self.control[0] & NINE_BITS != 0);
        1 + data + 1 + u64::from(self.control[1] & TWO_STOPS != 0)
    }

    /// Duration of a character at the port's rate (30.3.4, oversampling by 16), ticks.
    pub fn byte(&self) -> u64 {
        u64::from(self.rate.max(1)) * self.cycle * self.bits()
    }

    /// Whether the port can receive the other end's bytes: their form is equal and the rate within
    /// 3 %.
    fn hears(&self) -> bool {
        let ratio = self.byte() as f64 / self.other_byte() as f64;
        self.cycle > 0 && self.bits() == self.other_end.1 && (ratio - 1.0).abs() < 0.03
    }

    /// Whether a character has a parity bit.
    pub fn has_parity(&self) -> bool {
        self.control[0] & PARITY != 0
    }

    pub fn read(&mut self, offset: u32) -> u32 {
        match offset {
            0x00 => {
                self.seen = self.status;
                self.status
            }
            0x04 => {
                let unseen = self.status & RECEIVED != 0 && self.seen & RECEIVED == 0;
                self.lost += u64::from(unseen);
                self.status &= !RECEIVED;
                self.status &= !(self.seen & (OVERRUN | IDLE));
                self.seen = 0;
                self.data
            }
            0x08 => self.rate,
            0x0c..=0x18 => self.control[(offset as usize - 0x0c) / 4],
            _ => 0,
        }
    }

    pub fn write(&mut self, offset: u32, value: u32, now: u64) {
        match offset {
            0x00 => self.status &= value | !(RECEIVED | SENT),
            0x04 if self.control[0] & (ON | TRANSMITTER) == ON | TRANSMITTER => {
                self.status &= !SENT;
                let byte = value as u8;
                if self.shifting.is_none() {
                    self.shifting = Some((now + self.byte(), byte));
                } else {
                    self.waiting = Some(byte);
                    self.status &= !EMPTY;
                }
            }
            0x08 => self.rate = value & 0xffff,
            0x0c..=0x18 => self.control[(offset as usize - 0x0c) / 4] = value,
            _ => {}
        }
    }

    pub fn due(&self) -> u64 {
        let coming = self.coming.front().map_or(u64::MAX, |next| next.0);
        let going = self.shifting.filter(|_| !self.stuck);
        let going = going.map_or(u64::MAX, |shifted| shifted.0);
        coming.min(going).min(self.idle_at)
    }

    /// Executes all events up to tick `now`.
    pub fn happen(&mut self, now: u64) {
        if now >= self.idle_at {
            self.idle_at = u64::MAX;
            self.status |= IDLE;
        }
        while let Some(&(time, byte)) = self.coming.front()
            && time <= now
        {
            self.coming.pop_front();
            if self.control[0] & (ON | RECEIVER) != ON | RECEIVER {
                continue;
            }
            if !self.hears() {
                self.garbled += 1;
                continue;
            }
            if self.status & RECEIVED != 0 {
                self.status |= OVERRUN;
                self.lost += 1;
            } else {
                self.data = byte.into();
                self.status |= RECEIVED;
            }
            self.idle_at = time + self.byte();
        }
        if let Some((time, byte)) = self.shifting
            && time <= now
            && !self.stuck
        {
            self.sent.push((time, byte));
            self.shifting = self.waiting.take().map(|next| (time + self.byte(), next));
            self.status |= EMPTY;
            if self.shifting.is_none() {
                self.status |= SENT;
            }
        }
    }

    pub fn interrupts(&self) -> bool {
        let (status, control) = (self.status, self.control[0]);
        let asked = control & (IDLE | RECEIVED | SENT | EMPTY);
        let flags = status | (u32::from(status & OVERRUN != 0) * RECEIVED);
        control & ON != 0 && flags & asked != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn port() -> Serial {
        let mut serial = Serial::default();
        // 42 MHz / 115 200.
        serial.set_cycle(24);
        serial.write(0x08, 365, 0);
        serial.write(0x0c, ON | RECEIVER | TRANSMITTER | RECEIVED | IDLE, 0);
        serial
    }

    #[test]
    fn a_byte_is_received_and_the_line_idles_after_it() {
        let mut serial = port();
        serial.receive(0, b"k");
        assert_eq!(serial.due(), 10 * TICKS / RATE);
        serial.happen(serial.due());
        assert!(serial.interrupts());
        assert_eq!(serial.read(0) & RECEIVED, RECEIVED);
        assert_eq!(serial.read(4), u32::from(b'k'));
        assert!(!serial.interrupts());
        serial.happen(serial.due());
        assert!(serial.interrupts(), "idle");
        serial.read(0);
        serial.read(4);
        assert!(!serial.interrupts());
    }

    #[test]
    fn a_byte_not_fetched_in_time_is_overrun() {
        let mut serial = port();
        serial.receive(0, b"kb");
        serial.happen(TICKS);
        assert_eq!(serial.read(0) & OVERRUN, OVERRUN);
        assert_eq!(serial.read(4), u32::from(b'k'));
        assert_eq!(serial.read(0) & (OVERRUN | RECEIVED), 0);
        assert_eq!(serial.lost, 1);
    }

    #[test]
    fn a_byte_complete_between_status_and_data_is_lost() {
        let mut serial = port();
        serial.receive(0, b"kb");
        assert_eq!(serial.read(0) & RECEIVED, 0);
        serial.happen(serial.due());
        serial.read(4);
        assert_eq!((serial.lost, serial.read(0) & RECEIVED), (1, 0));
        serial.happen(TICKS);
        assert_eq!(serial.read(0) & RECEIVED, RECEIVED);
        assert_eq!(serial.read(4), u32::from(b'b'));
        assert_eq!(serial.lost, 1);
    }

    #[test]
    fn bytes_go_one_after_the_other_at_the_rate() {
        let mut serial = port();
        serial.write(0x04, 1, 0);
        assert_eq!(serial.read(0) & (EMPTY | SENT), EMPTY);
        serial.write(0x04, 2, 0);
        assert_eq!(serial.read(0) & EMPTY, 0);
        serial.happen(TICKS);
        serial.happen(TICKS);
        let byte = 365 * 24 * 10;
        assert_eq!(serial.sent, [(byte, 1), (2 * byte, 2)]);
        assert_eq!(serial.read(0) & (EMPTY | SENT), EMPTY | SENT);
    }

    #[test]
    fn another_clock_garbles_what_comes() {
        let mut serial = port();
        serial.set_cycle(16);
        serial.receive(0, b"kband");
        serial.happen(TICKS);
        assert_eq!(serial.garbled, 5);
    }
}
