//! A Modbus master on the fieldbus of a board on the rig.

use kband_bus::rtu::{check, crc, silence_us};

use crate::chip::clocks::TICKS;
use crate::rig::{Act, Rig};

/// Unit of the board.
pub const UNIT: u8 = 17;
/// Longest wait for an answer, s.
const ANSWER_TIMEOUT: f64 = 0.05;

/// Frame of a request to `unit`, with its checksum.
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
pub fn write(address: u16, registers: &[u16]) -> Vec<u8> {
    let ([a, b], count) = (address.to_be_bytes(), registers.len() as u8);
    let mut pdu = vec![16, a, b, 0, count, 2 * count];
    pdu.extend(registers.iter().flat_map(|word| word.to_be_bytes()));
    pdu
}

/// The two registers of a float.
pub fn float(number: f32) -> [u16; 2] {
    let bits = number.to_bits();
    [(bits >> 16) as u16, bits as u16]
}

/// A response with its times.
#[derive(Clone, Debug, PartialEq)]
pub struct TimedResponse {
    /// Function and data.
    pub pdu: Vec<u8>,
    /// Time from the end of the request to the beginning of the answer, s.
    pub after: f64,
    /// End of the last stop bit, ticks.
    pub end: u64,
}

impl Rig {
    /// Sends a request on the fieldbus, and runs until the response is complete and the line was
    /// silent. `None` without a response.
    pub fn bus(&mut self, pdu: &[u8]) -> Option<TimedResponse> {
        let port = &self.chip.board.fieldbus;
        let (first, character) = (port.sent.len(), port.other_byte());
        let (rate, _) = port.other_end;
        let silence = u64::from(silence_us(rate as u32)) * TICKS / 1_000_000;
        let request = frame(UNIT, pdu);
        let request_end = self.chip.board.now + request.len() as u64 * character;
        self.act(&Act::Bus(request));
        let limit = request_end as f64 / TICKS as f64 + ANSWER_TIMEOUT;
        loop {
            self.run_for(1e-4);
            let sent = &self.chip.board.fieldbus.sent[first..];
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
            return Some(TimedResponse {
                pdu: adu[1..].to_vec(),
                after: (sent[0].0 - character - request_end) as f64 / TICKS as f64,
                end: last,
            });
        }
    }

    /// Sends a request that must be answered.
    pub fn bus_answer(&mut self, pdu: &[u8]) -> Vec<u8> {
        let Some(answer) = self.bus(pdu) else {
            panic!("no answer to {pdu:?}");
        };
        answer.pdu
    }

    pub fn bus_word(&mut self, address: u16) -> u16 {
        match self.bus_answer(&read(address, 1))[..] {
            [3, 2, high, low] => u16::from_be_bytes([high, low]),
            ref other => panic!("{address}: {other:?}"),
        }
    }

    /// Writes registers that must be accepted.
    pub fn bus_write(&mut self, address: u16, registers: &[u16]) {
        let request = write(address, registers);
        assert_eq!(self.bus_answer(&request), request[..5], "{address}");
    }
}
