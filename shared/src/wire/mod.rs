//! The link between board and desk: messages in checked frames.
//!
//! A frame on the line is COBS (Cheshire & Baker 1997) with a zero at its end, so that a receiver finds
//! the next frame after any garbage. Inside are, in this order:
//!
//! | bytes | what |
//! |---|---|
//! | 1 | version: [`VERSION`], or 0 for the question and the answer who is there |
//! | 2 | schema: the low half of [`SCHEMA`]; absent with version 0 |
//! | 1 | sequence: the board answers with the one it was asked with; telemetry has 0 |
//! | | the message: postcard of [`Request`] or [`Response`] |
//! | 4 | CRC-32 (IEEE 802.3) of all before it |
//!
//! The question who is there is a frame of version 0 without a message; its answer is [`Identity`] as
//! version, schema (4 bytes) and the name of the image. These two never change, so that any desk can
//! tell any board what it speaks. Everything else may change with [`VERSION`] and [`SCHEMA`], and is
//! refused where they differ.
//!
//! Whatever cannot be read is refused and counted ([`Counters`]); nothing is guessed, clipped or
//! half done.

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

/// Version of everything but the question who is there.
pub const VERSION: u8 = 1;

/// Hash of the golden frames: it changes with every message.
pub const SCHEMA: u32 = 0x46b7_6982;

#[cfg(test)]
mod tests;
