//! Link protocol between board and desk: messages in frames with a checksum (docs/link.md).
//!
//! Encoded by COBS, a frame ends with a zero, at which receivers resynchronize. That page lists its
//! bytes.
//!
//! Frames of version 0 never change, so any desk can identify and update any board. Without a
//! message one is the identity request. The response is [`Identity`]: version, schema (4 bytes),
//! name. With the letter `u` it holds the postcard of [`UpdateRequest`] or [`UpdateAnswer`].
//!
//! Unreadable frames are rejected and counted ([`Counters`]), and never applied in part.

mod frame;
mod message;
mod receiver;
mod update;

pub use frame::{
    Encoded, FrameBuffer, Identity, Incoming, Outgoing, Unsendable, crc32, read_answer,
    read_frozen_request, read_request, write_identity, write_identity_request, write_request,
    write_response, write_update_answer, write_update_request,
};
pub use message::{
    Access, Counters, FaultRecord, Pin, Record, Refusal, Request, Response, SavedSettings,
    SelfTest, SetUp, Setting, Status, Stored, TELEMETRY_FRAME, Telemetry, read_reading,
    update_output_check, write_reading,
};
pub use receiver::{MAX_FRAME_BYTES, Receiver, Unreadable};
pub use update::{
    MAX_UPDATE_BYTES, MAX_UPDATES_PER_START, UpdateAnswer, UpdateRefusal, UpdateRequest,
    check_chunk,
};

/// Protocol version of all frames except those of identity and update.
pub const VERSION: u8 = 1;

/// Hash of the golden frames; it changes with every message.
pub const SCHEMA: u32 = 0xbe5c_e348;

#[cfg(test)]
mod tests;
