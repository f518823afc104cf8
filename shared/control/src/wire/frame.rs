//! Frames: content and CRC by consistent overhead byte stuffing (COBS: Cheshire and Baker 1999),
//! which removes zeros. `receiver` finds them in a stream of bytes and undoes the stuffing.

use super::message::{Request, Response};
use super::receiver::{MAX_FRAME_BYTES, Unreadable};
use super::update::{UpdateAnswer, UpdateRequest};
use super::{SCHEMA, VERSION};
use serde::{Deserialize, Serialize};

/// Largest content of a frame, in bytes with its CRC: COBS adds two, the final zero one.
const MAX_INSIDE_BYTES: usize = MAX_FRAME_BYTES - 3;
/// Bytes of the CRC.
const CHECK_BYTES: usize = 4;
/// Version of frames whose format never changes.
const FROZEN: u8 = 0;
/// Byte after the sequence of a frozen frame of an update; an identity has its version there.
const UPDATE: u8 = b'u';

/// Error: a message too long for a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unsendable;

/// Buffer for one frame.
pub type FrameBuffer = [u8; MAX_FRAME_BYTES];

/// Bytes of a frame, with its final zero.
pub type Encoded<'b> = Result<&'b [u8], Unsendable>;

/// Content of a frame received by a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Incoming<'a> {
    /// The identity request.
    Identity,
    /// A request.
    Request(Request<'a>),
    /// A request of an update.
    Update(UpdateRequest<'a>),
}

/// Identity of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity<'a> {
    /// [`VERSION`] of the board.
    pub version: u8,
    /// [`SCHEMA`] of the board.
    pub schema: u32,
    /// Name, version and build of the image.
    pub image: &'a str,
}

/// Content of a frame received by a desk.
// A value lives during the decoding of one frame only, and there is no heap for a box.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outgoing<'a> {
    /// The response to the identity request.
    Identity(Identity<'a>),
    /// A response.
    Response(Response<'a>),
    /// The answer to a request of an update.
    Update(UpdateAnswer<'a>),
}

/// Encodes a request.
pub fn write_request<'b>(
    buffer: &'b mut FrameBuffer,
    sequence: u8,
    request: &Request<'_>,
) -> Encoded<'b> {
    write_message(buffer, current_head(sequence), request)
}

/// Encodes a response.
pub fn write_response<'b>(
    buffer: &'b mut FrameBuffer,
    sequence: u8,
    response: &Response<'_>,
) -> Encoded<'b> {
    write_message(buffer, current_head(sequence), response)
}

/// Encodes a request of an update; its format never changes.
pub fn write_update_request<'b>(
    buffer: &'b mut FrameBuffer,
    sequence: u8,
    request: &UpdateRequest<'_>,
) -> Encoded<'b> {
    write_message(buffer, [FROZEN, sequence, UPDATE], request)
}

/// Encodes the answer to a request of an update; its format never changes.
pub fn write_update_answer<'b>(
    buffer: &'b mut FrameBuffer,
    sequence: u8,
    answer: &UpdateAnswer<'_>,
) -> Encoded<'b> {
    write_message(buffer, [FROZEN, sequence, UPDATE], answer)
}

/// Encodes the identity request; its format never changes.
pub fn write_identity_request(buffer: &mut FrameBuffer, sequence: u8) -> Encoded<'_> {
    // A unit has no bytes.
    write_message(buffer, [FROZEN, sequence], &())
}

/// Encodes the response to the identity request; its format never changes.
pub fn write_identity<'b>(
    buffer: &'b mut FrameBuffer,
    sequence: u8,
    identity: &Identity<'_>,
) -> Encoded<'b> {
    let mut inside = [0; MAX_INSIDE_BYTES];
    let image = identity.image.as_bytes();
    let length = 7 + image.len();
    inside[..3].copy_from_slice(&[FROZEN, sequence, identity.version]);
    inside[3..7].copy_from_slice(&identity.schema.to_le_bytes());
    let place = inside.get_mut(7..length).ok_or(Unsendable)?;
    place.copy_from_slice(image);
    finish(buffer, &mut inside, length)
}

/// Decodes a frame received by a board: the sequence for the response, and the content.
pub fn read_request(inside: &[u8]) -> Result<(u8, Incoming<'_>), Unreadable> {
    match check_frame(inside)? {
        (FROZEN, rest) => frozen_request(rest),
        (version, rest) => {
            let (sequence, request) = read(version, rest)?;
            Ok((sequence, Incoming::Request(request)))
        }
    }
}

/// As [`read_request`], of a frame of version 0; others are foreign.
pub fn read_frozen_request(inside: &[u8]) -> Result<(u8, Incoming<'_>), Unreadable> {
    match check_frame(inside)? {
        (FROZEN, rest) => frozen_request(rest),
        _ => Err(Unreadable::Foreign),
    }
}

fn frozen_request(rest: &[u8]) -> Result<(u8, Incoming<'_>), Unreadable> {
    match rest {
        [sequence] => Ok((*sequence, Incoming::Identity)),
        [sequence, UPDATE, message @ ..] => Ok((*sequence, Incoming::Update(parse(message)?))),
        _ => Err(Unreadable::Unknown),
    }
}

/// Decodes a frame received by a desk: the sequence of the request, 0 without one, and the content.
pub fn read_answer(inside: &[u8]) -> Result<(u8, Outgoing<'_>), Unreadable> {
    match check_frame(inside)? {
        (FROZEN, [sequence, UPDATE, message @ ..]) => {
            Ok((*sequence, Outgoing::Update(parse(message)?)))
        }
        (FROZEN, [sequence, version, a, b, c, d, image @ ..]) => {
            let identity = Identity {
                version: *version,
                schema: u32::from_le_bytes([*a, *b, *c, *d]),
                image: core::str::from_utf8(image).map_err(|_| Unreadable::Unknown)?,
            };
            Ok((*sequence, Outgoing::Identity(identity)))
        }
        (FROZEN, _) => Err(Unreadable::Unknown),
        (version, rest) => {
            let (sequence, response) = read(version, rest)?;
            Ok((sequence, Outgoing::Response(response)))
        }
    }
}

/// Bytes before a message of this version and schema.
fn current_head(sequence: u8) -> [u8; 4] {
    let [low, high, ..] = SCHEMA.to_le_bytes();
    [VERSION, low, high, sequence]
}

fn write_message<'b, const HEAD: usize>(
    buffer: &'b mut FrameBuffer,
    head: [u8; HEAD],
    message: &impl Serialize,
) -> Encoded<'b> {
    let mut inside = [0; MAX_INSIDE_BYTES];
    inside[..HEAD].copy_from_slice(&head);
    let payload = (inside.get_mut(HEAD..MAX_INSIDE_BYTES - CHECK_BYTES)).ok_or(Unsendable)?;
    let length = (postcard::to_slice(message, payload).map_err(|_| Unsendable)?).len();
    finish(buffer, &mut inside, HEAD + length)
}

/// The message in these bytes, without a byte left over.
fn parse<'a, M: Deserialize<'a>>(message: &'a [u8]) -> Result<M, Unreadable> {
    match postcard::take_from_bytes(message) {
        Ok((message, [])) => Ok(message),
        _ => Err(Unreadable::Unknown),
    }
}

fn read<'a, M: Deserialize<'a>>(version: u8, rest: &'a [u8]) -> Result<(u8, M), Unreadable> {
    let [low, high, ..] = SCHEMA.to_le_bytes();
    match rest {
        [a, b, sequence, message @ ..] if version == VERSION && [*a, *b] == [low, high] => {
            Ok((*sequence, parse(message)?))
        }
        _ => Err(Unreadable::Foreign),
    }
}

/// Appends the CRC to the first `length` bytes and encodes them by COBS.
fn finish<'b>(
    buffer: &'b mut FrameBuffer,
    inside: &mut [u8; MAX_INSIDE_BYTES],
    length: usize,
) -> Encoded<'b> {
    let (content, rest) = inside.split_at_mut_checked(length).ok_or(Unsendable)?;
    let check = rest.first_chunk_mut().ok_or(Unsendable)?;
    *check = crc32(content).to_le_bytes();
    let checked = inside.get(..length + CHECK_BYTES).ok_or(Unsendable)?;
    let mut put = |at: usize, byte: u8| {
        let slot = buffer.get_mut(at).ok_or(Unsendable)?;
        *slot = byte;
        Ok(())
    };
    let mut code_at = 0;
    let mut end = 1;
    let mut code = 1_u8;
    for &byte in checked {
        if byte != 0 {
            put(end, byte)?;
            end += 1;
            code += 1;
        }
        if byte == 0 || code == u8::MAX {
            put(code_at, code)?;
            code_at = end;
            end += 1;
            code = 1;
        }
    }
    put(code_at, code)?;
    put(end, 0)?;
    buffer.get(..=end).ok_or(Unsendable)
}

/// A frame with arbitrary content and a valid CRC.
#[cfg(test)]
pub(super) fn write_inside<'b>(buffer: &'b mut FrameBuffer, content: &[u8]) -> &'b [u8] {
    let mut inside = [0; MAX_INSIDE_BYTES];
    inside[..content.len()].copy_from_slice(content);
    finish(buffer, &mut inside, content.len()).unwrap()
}

/// Checks the CRC; returns the version and the bytes after it.
fn check_frame(inside: &[u8]) -> Result<(u8, &[u8]), Unreadable> {
    let (content, check) = (inside.split_last_chunk::<CHECK_BYTES>()).ok_or(Unreadable::Corrupt)?;
    if crc32(content) != u32::from_le_bytes(*check) {
        return Err(Unreadable::Corrupt);
    }
    let (version, rest) = content.split_first().ok_or(Unreadable::Corrupt)?;
    Ok((*version, rest))
}

/// CRC-32 (IEEE 802.3) by half-byte table lookup: 64 bytes, some twelve instructions a byte.
pub fn crc32(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 16] = {
        let mut table = [0; 16];
        let mut nibble = 0;
        while nibble < 16 {
            let mut value = nibble as u32;
            let mut bit = 0;
            while bit < 4 {
                value = (value >> 1) ^ (0xedb8_8320 & (value & 1).wrapping_neg());
                bit += 1;
            }
            table[nibble] = value;
            nibble += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |sum, byte| {
        let sum = sum ^ u32::from(*byte);
        let sum = (sum >> 4) ^ TABLE[(sum & 15) as usize];
        (sum >> 4) ^ TABLE[(sum & 15) as usize]
    })
}
