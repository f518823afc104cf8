//! Sizes, function codes and exceptions of Modbus, and the counters of a server.

use crate::tcp::HEADER_BYTES;
use heapless::Vec;

/// Largest request or answer, bytes: unit, function and 252 bytes of data.
pub const MAX_ADU_BYTES: usize = 254;

/// Buffer for an answer, with the header of TCP or the checksum of RTU.
pub type Answer = Vec<u8, { MAX_ADU_BYTES + HEADER_BYTES }>;

/// Function codes that are answered.
pub(crate) mod function {
    pub const READ_HOLDING: u8 = 3;
    pub const READ_INPUT: u8 = 4;
    pub const WRITE_ONE: u8 = 6;
    pub const DIAGNOSTICS: u8 = 8;
    pub const WRITE_SEVERAL: u8 = 16;
    pub const ENCAPSULATED: u8 = 43;
}

/// Exception codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exception {
    /// The function is not supported.
    Function = 1,
    /// The register does not exist, is not writable, or was written only in part.
    Address = 2,
    /// A number is out of range.
    Value = 3,
    /// The authority is not sufficient, or the link is in control.
    NotInControl = 4,
    /// The drive runs, or the memory is busy.
    Busy = 6,
}

/// Counters of a server since its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Answered requests.
    pub requests: u32,
    /// Requests answered by an exception, which also count as requests.
    pub exceptions: u32,
    /// Frames with a wrong checksum or length.
    pub damaged: u32,
}
