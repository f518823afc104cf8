//! The link between board and desk: messages in checked frames.
//!
//! A frame on the line is COBS (Cheshire and Baker 1997) with a zero at its end. A receiver
//! therefore finds the next frame after any garbage. A frame contains, in this order:
//!
//! | bytes | content |
//! |---|---|
//! | 1 | version: [`VERSION`], or 0 for the identity request and its answer |
//! | 2 | schema: the low half of [`SCHEMA`]; absent with version 0 |
//! | 1 | sequence: the board repeats the number of the request; telemetry has 0 |
//! | | the message: postcard of [`Request`] or [`Response`] |
//! | 4 | CRC-32 (IEEE 802.3) of all before it |
//!
//! The identity request is a frame of version 0 without a message. Its answer is [`Identity`]:
//! version, schema (4 bytes) and name of the image. These two frames never change, so any desk can
//! identify any board. Everything else may change with [`VERSION`] and [`SCHEMA`]. A frame with
//! another version or schema is refused.
//!
//! Unreadable frames are refused and counted ([`Counters`]). Nothing is guessed, clipped or half
//! done.

mod frame;
mod message;
mod receiver;
mod report;

pub use frame::{
    Identity, Incoming, Outgoing, Unsendable, crc32, read_answer, read_request, write_identity,
    write_question, write_request, write_response,
};
pub use message::{
    Access, Counters, Inputs, Kept, KeptFault, Pin, Record, Refusal, Request, Response, SelfTest,
    SetUp, Setting, StartCause, Status, TELEMETRY_FRAME, Target, Telemetry, fold_output,
    read_reading, write_reading,
};
pub use receiver::{FRAME_MOST, Receiver, Unreadable};
pub use report::{
    Identification, Identified, Load, Margin, Report, Shape, Unidentified, UpperTone,
};

/// Version of all frames but the identity request and its answer.
pub const VERSION: u8 = 1;

/// Hash of the golden frames; every change of a message changes it.
pub const SCHEMA: u32 = 0x46b7_6982;

#[cfg(test)]
mod tests;
