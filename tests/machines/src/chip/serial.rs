//! Model of a serial port (RM0090, chapter 30); for the STM32G474 see `serial/fifo.rs`.

use std::collections::VecDeque;

use super::clocks::{START_CYCLE, TICKS};
use super::kind::Kind;

mod fifo;

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
#[derive(Clone, Debug, Default)]
pub struct Serial {
    status: u32,
    rate: u32,
    control: [u32; 4],
    /// Bytes on the way to the chip, each with the tick at which it is complete.
    coming: VecDeque<(u64, u8)>,
    /// Bytes that the chip has sent, each with the tick at which it was complete.
    pub sent: Vec<(u64, u8)>,
    shifting: Option<(u64, u8)>,
    waiting: VecDeque<u8>,
    /// Received bytes that were not read yet.
    received: VecDeque<u8>,
    kind: Kind,
    idle_at: u64,
    /// Flags that a read of the status has returned; a read of the data clears them.
    read_flags: u32,
    /// Duration of a clock cycle of the port, ticks.
    pub cycle: u64,
    /// Character format of the other end: bit/s, and bits in a character.
    pub other_end: (u64, u64),
    /// Whether the transmitter has failed: the byte being sent never ends.
    pub stuck: bool,
    /// Number of bytes lost by overrun, or that ended between a read of status and one of data.
    pub lost: u64,
}

/// Rate of the desk's end, bit/s.
const RATE: u64 = 115_200;

impl Serial {
    /// Builds a port of a chip.
    pub fn new(kind: Kind) -> Self {
        Self {
            status: SENT | EMPTY,
            kind,
            idle_at: u64::MAX,
            cycle: START_CYCLE,
            other_end: (RATE, 10),
            ..Self::default()
        }
    }

    /// Resets the registers; bytes on the line still arrive.
    pub fn reset(&mut self) {
        *self = Self {
            coming: std::mem::take(&mut self.coming),
            sent: std::mem::take(&mut self.sent),
            lost: self.lost,
            cycle: self.cycle,
            other_end: self.other_end,
            ..Self::new(self.kind)
        };
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

    fn bits(&self) -> u64 {
        let data = 8 + u64::from(self.control[0] & NINE_BITS != 0);
        1 + data + 1 + u64::from(self.control[1] & TWO_STOPS != 0)
    }

    /// Duration of a character at the port's rate (30.3.4, oversampling by 16), ticks.
    pub fn byte(&self) -> u64 {
        u64::from(self.rate.max(1)) * self.cycle * self.bits()
    }

    /// Whether the port understands the other end: equal format, and a rate within 3 %.
    fn is_receiving(&self) -> bool {
        let ratio = self.byte() as f64 / self.other_byte() as f64;
        self.cycle > 0 && self.bits() == self.other_end.1 && (ratio - 1.0).abs() < 0.03
    }

    /// Whether a character has a parity bit.
    pub fn has_parity(&self) -> bool {
        self.control[0] & PARITY != 0
    }

    /// Status with the flag of a received byte.
    fn flags(&self) -> u32 {
        self.status | (u32::from(!self.received.is_empty()) * RECEIVED)
    }

    pub fn read(&mut self, offset: u32) -> u32 {
        if self.kind == Kind::Stm32g474 {
            return self.read_fifo(offset);
        }
        match offset {
            0x00 => {
                self.read_flags = self.flags();
                self.read_flags
            }
            0x04 => {
                let flags = std::mem::take(&mut self.read_flags);
                let unseen = !self.received.is_empty() && flags & RECEIVED == 0;
                self.lost += u64::from(unseen);
                self.status &= !(flags & (OVERRUN | IDLE));
                self.received.pop_front().unwrap_or(0).into()
            }
            0x08 => self.rate,
            0x0c..=0x18 => self.control[(offset as usize - 0x0c) / 4],
            _ => 0,
        }
    }

    pub fn write(&mut self, offset: u32, value: u32, now: u64) {
        if self.kind == Kind::Stm32g474 {
            return self.write_fifo(offset, value, now);
        }
        match offset {
            0x00 => self.status &= value | !SENT,
            0x04 => self.send(value as u8, now),
            0x08 => self.rate = value & 0xffff,
            0x0c..=0x18 => self.control[(offset as usize - 0x0c) / 4] = value,
            _ => {}
        }
    }

    fn send(&mut self, byte: u8, now: u64) {
        if !self.is_on(TRANSMITTER) {
            return;
        }
        self.status &= !SENT;
        if self.shifting.is_none() {
            self.shifting = Some((now + self.byte(), byte));
            return;
        }
        self.waiting.truncate(self.depth() - 1);
        self.waiting.push_back(byte);
        if self.waiting.len() == self.depth() {
            self.status &= !EMPTY;
        }
    }

    /// Whether the port and its receiver or transmitter are on.
    fn is_on(&self, part: u32) -> bool {
        let on = match self.kind {
            Kind::Stm32f405 => ON,
            Kind::Stm32g474 => fifo::ON,
        };
        self.control[0] & (on | part) == on | part
    }

    /// Capacity in bytes of each direction.
    fn depth(&self) -> usize {
        let fifos = self.kind == Kind::Stm32g474 && self.control[0] & fifo::FIFOS != 0;
        if fifos { fifo::DEPTH } else { 1 }
    }

    pub fn due(&self) -> u64 {
        let coming = self.coming.front().map_or(u64::MAX, |next| next.0);
        let going = self.shifting.filter(|_| !self.stuck);
        let going = going.map_or(u64::MAX, |shifted| shifted.0);
        coming.min(going).min(self.idle_at)
    }

    /// Executes all events up to tick `now`.
    pub fn run_events(&mut self, now: u64) {
        if now >= self.idle_at {
            self.idle_at = u64::MAX;
            self.status |= IDLE;
        }
        while let Some((time, byte)) = self.coming.pop_front_if(|next| next.0 <= now) {
            if !self.is_on(RECEIVER) || !self.is_receiving() {
                continue;
            }
            if self.received.len() < self.depth() {
                self.received.push_back(byte);
            } else {
                self.status |= OVERRUN;
                self.lost += 1;
            }
            self.idle_at = time + self.byte();
        }
        if let Some((time, byte)) = self.shifting
            && time <= now
            && !self.stuck
        {
            self.sent.push((time, byte));
            let next = self.waiting.pop_front();
            self.shifting = next.map(|next| (time + self.byte(), next));
            self.status |= EMPTY;
            if self.shifting.is_none() {
                self.status |= SENT;
            }
        }
    }

    pub fn interrupts(&self) -> bool {
        let (status, control) = (self.flags(), self.control[0]);
        let enabled_flags = control & (IDLE | RECEIVED | SENT | EMPTY);
        let flags = status | (u32::from(status & OVERRUN != 0) * RECEIVED);
        self.is_on(0) && flags & enabled_flags != 0
    }
}
