//! A Modbus master on the fieldbus of a board on the rig.

use kband_bus::rtu::{check, crc, silence_us};

use crate::chip::clocks::TICKS;
use crate::rig::{Act, Rig};

/// Unit of the board.
pub const UNIT: u8 = 17;
/// Longest wait for an answer, s.
const ANSWER_TIMEOUT: f64 = 0.05;

/// Frame of a request to `unit`, checksum included.
pub fn frame(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut frame = vec![unit];
    frame.extend(pdu);
    frame.extend(crc(&frame).to_le_bytes());
    frame
}

/// Request to read registers.
pub fn read(address: u16, count: u16) -> [u8; 5] {
    let ([a, b], [c, d]) = (address.to_be_bytes(), count.to_be_bytes());
    [3, a, b, c, d]
}

/// Request to write registers.
pub fn write(address: u16, words: &[u16]) -> Vec<u8> {
    let mut pdu = vec![16];
    pdu.extend(address.to_be_bytes());
    pdu.extend((words.len() as u16).to_be_bytes());
    pdu.push(2 * words.len() as u8);
    pdu.extend(words.iter().flat_map(|word| word.to_be_bytes()));
    pdu
}

/// The two registers of a float.
pub fn float(number: f32) -> [u16; 2] {
    let bits = number.to_bits();
    [(bits >> 16) as u16, bits as u16]
}

/// An answer with its times.
#[derive(Clone, Debug, PartialEq)]
pub struct Answered {
    /// Function and data.
    pub pdu: Vec<u8>,
    /// Time from the end of the request to the beginning of the answer, s.
    pub after: f64,
    /// End of the last stop bit, ticks.
    pub end: u64,
}

impl Rig {
    /// Sends a request on the fieldbus, and runs until the answer is complete and the line was
    /// silent. `None` without an answer.
    ///
    /// # Panics
    /// The answer is damaged.
    pub fn bus(&mut self, pdu: &[u8]) -> Option<Answered> {
        let port = &self.chip.board.serials[3];
        let (first, character) = (port.sent.len(), port.other_byte());
        let (rate, _) = port.other_end;
        let silence = u64::from(silence_us(rate as u32)) * TICKS / 1_000_000;
        let request = frame(UNIT, pdu);
        let asked = self.chip.board.now + request.len() as u64 * character;
        self.act(&Act::Bus(request));
        let limit = asked as f64 / TICKS as f64 + ANSWER_TIMEOUT;
        loop {
            self.run(self.time() + 1e-4);
            let sent = &self.chip.board.serials[3].sent[first..];
            let (last, wait) = match sent.last() {
                Some((last, _)) => (*last, silence),
                None if self.time() > limit => return None,
                None => continue,
            };
            if self.chip.board.now < last + wait {
                continue;
            }
            let bytes: Vec<u8> = sent.iter().map(|(_, byte)| *byte).collect();
            let adu = check(&bytes).expect("a valid checksum");
            assert_eq!(adu[0], UNIT);
            return Some(Answered {
                pdu: adu[1..].to_vec(),
                after: (sent[0].0 - character - asked) as f64 / TICKS as f64,
                end: last,
            });
        }
    }

    /// Sends a request that must be answered.
    ///
    /// # Panics
    /// There is no answer.
    pub fn bus_answer(&mut self, pdu: &[u8]) -> Vec<u8> {
        let answered = self.bus(pdu);
        answered
            .unwrap_or_else(|| panic!("no answer to {pdu:?}"))
            .pdu
    }

    /// Reads a register.
    ///
    /// # Panics
    /// It is not answered or refused.
    pub fn bus_word(&mut self, address: u16) -> u16 {
        match self.bus_answer(&read(address, 1))[..] {
            [3, 2, high, low] => u16::from_be_bytes([high, low]),
            ref other => panic!("{address}: {other:?}"),
        }
    }

    /// Writes registers that must be accepted.
    ///
    /// # Panics
    /// It is not answered or refused.
    pub fn bus_write(&mut self, address: u16, words: &[u16]) {
        let request = write(address, words);
        assert_eq!(self.bus_answer(&request), request[..5], "{address}");
    }
}
