//! Modbus RTU: the checksum of a frame, and the silence between two.

use crate::machine::Machine;
use crate::protocol::Answer;
use crate::server::Server;

/// Largest frame, bytes: the request and its checksum.
pub const MAX_FRAME_BYTES: usize = crate::MAX_ADU_BYTES + CHECK_BYTES;
/// Size of the checksum, bytes.
const CHECK_BYTES: usize = 2;
/// Unit address of broadcasts; they are neither answered nor carried out.
pub const BROADCAST: u8 = 0;

/// Silence in us that ends a frame: 3.5 characters; above 19200 baud 1.75 ms.
pub fn silence_us(baud: u32) -> u32 {
    if baud > 19_200 {
        return 1_750;
    }
    // Seven half characters of 11 bits each, with start, parity and stop.
    (7 * 11 * 500_000_u32).div_ceil(baud.max(1))
}

/// Answers a frame to `unit`, checksum included; returns whether there is an answer.
///
/// Frames to other units and broadcasts are not answered.
pub fn answer(
    server: &mut Server,
    unit: u8,
    frame: &[u8],
    machine: &mut impl Machine,
    answer: &mut Answer,
) -> bool {
    answer.clear();
    let Some(adu) = check(frame) else {
        server.count_damaged();
        return false;
    };
    let is_addressed = adu.first().is_some_and(|first| *first == unit) && unit != BROADCAST;
    if !(is_addressed && server.answer(adu, machine, answer)) {
        return false;
    }
    let check = crc(answer);
    answer.extend_from_slice(&check.to_le_bytes()).is_ok()
}

/// The request of a frame with a valid checksum; `None` if it is damaged.
pub fn check(frame: &[u8]) -> Option<&[u8]> {
    let (adu, check) = frame.split_last_chunk::<CHECK_BYTES>()?;
    let valid =
        (2..=crate::MAX_ADU_BYTES).contains(&adu.len()) && crc(adu) == u16::from_le_bytes(*check);
    valid.then_some(adu)
}

/// Checksum of RTU frames: CRC-16 with the reversed polynomial 0xa001, from 0xffff.
pub fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| {
            (crc >> 1) ^ if crc & 1 == 1 { 0xa001 } else { 0 }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_the_specification() {
        // Modbus over serial line V1.02, appendix B: 02 07 gives 41 12.
        assert_eq!(crc(&[0x02, 0x07]).to_le_bytes(), [0x41, 0x12]);
    }

    #[test]
    fn the_silence_is_three_and_a_half_characters() {
        assert_eq!(silence_us(9_600), 4_011);
        assert_eq!(silence_us(19_200), 2_006);
        assert_eq!(silence_us(19_201), 1_750);
        assert_eq!(silence_us(115_200), 1_750);
    }
}
