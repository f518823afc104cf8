//! Modbus TCP: the header of a frame (MBAP).

use crate::protocol::{Answer, MAX_ADU_BYTES};

/// Size of the header before unit, function and data, bytes: transaction, protocol, length.
pub const HEADER_BYTES: usize = 6;

/// Length of the frame that begins so, with its header; `None` with less than a header. Close a
/// refused stream.
///
/// # Errors
/// The header is not a Modbus TCP header.
pub fn frame_length(bytes: &[u8]) -> Result<Option<usize>, NotModbus> {
    let Some(header) = bytes.first_chunk::<HEADER_BYTES>() else {
        return Ok(None);
    };
    let protocol = u16::from_be_bytes([header[2], header[3]]);
    let length = usize::from(u16::from_be_bytes([header[4], header[5]]));
    match (protocol, length) {
        (0, 2..=MAX_ADU_BYTES) => Ok(Some(HEADER_BYTES + length)),
        _ => Err(NotModbus),
    }
}

/// Error: the header is not a Modbus TCP header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotModbus;

/// Puts the header of an answer to `frame` before unit, function and data; false without room.
pub fn wrap(frame: &[u8], answer: &mut Answer) -> bool {
    let Some(header) = frame.first_chunk::<HEADER_BYTES>() else {
        return false;
    };
    let used = answer.len();
    if answer.resize(HEADER_BYTES + used, 0).is_err() {
        return false;
    }
    answer.copy_within(..used, HEADER_BYTES);
    answer[..4].copy_from_slice(&header[..4]);
    answer[4..HEADER_BYTES].copy_from_slice(&(used as u16).to_be_bytes());
    true
}
