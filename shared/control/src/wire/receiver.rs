//! Receiver of frames, byte by byte.

use super::message::Counters;

/// Largest size of a frame on the line in bytes, with its final zero.
pub const MAX_FRAME_BYTES: usize = 320;

/// Reason for a rejected frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unreadable {
    /// Longer than any message.
    Oversized,
    /// Shorter than any message, not COBS, or with a wrong CRC.
    Corrupt,
    /// Another version or schema.
    Foreign,
    /// Valid, with an unknown message.
    Unknown,
}

impl Counters {
    /// Counts a rejected frame.
    pub fn count(&mut self, reason: Unreadable) {
        let counter = match reason {
            Unreadable::Oversized => &mut self.oversized,
            Unreadable::Corrupt => &mut self.corrupt,
            Unreadable::Foreign => &mut self.foreign,
            Unreadable::Unknown => &mut self.unknown,
        };
        *counter = counter.wrapping_add(1);
    }
}

/// Collects the bytes of one frame, at most [`MAX_FRAME_BYTES`].
#[derive(Clone, Debug)]
pub struct Receiver {
    buffer: [u8; MAX_FRAME_BYTES],
    length: usize,
    overrun: bool,
}

impl Default for Receiver {
    fn default() -> Self {
        Self::new()
    }
}

impl Receiver {
    /// An empty receiver.
    pub const fn new() -> Self {
        Self {
            buffer: [0; MAX_FRAME_BYTES],
            length: 0,
            overrun: false,
        }
    }

    /// Adds a byte; at the end of a frame returns its content or the reason for its rejection.
    /// Zeros between frames are ignored.
    pub fn push(&mut self, byte: u8) -> Option<Result<&[u8], Unreadable>> {
        if byte != 0 {
            match self.buffer.get_mut(self.length) {
                Some(slot) => {
                    *slot = byte;
                    self.length += 1;
                }
                None => self.overrun = true,
            }
            return None;
        }
        let length = core::mem::take(&mut self.length);
        if core::mem::take(&mut self.overrun) {
            return Some(Err(Unreadable::Oversized));
        }
        if length == 0 {
            return None;
        }
        let inside = self.buffer.get_mut(..length).and_then(decode);
        let inside = inside.and_then(|inside| self.buffer.get(..inside));
        Some(inside.ok_or(Unreadable::Corrupt))
    }
}

/// Decodes COBS in place; returns the length of the content.
fn decode(frame: &mut [u8]) -> Option<usize> {
    let (mut from, mut to) = (0, 0);
    while let Some(&code) = frame.get(from) {
        let code = usize::from(code);
        let end = from + code;
        if code == 0 || end > frame.len() {
            return None;
        }
        for at in from + 1..end {
            let byte = *frame.get(at)?;
            *frame.get_mut(to)? = byte;
            to += 1;
        }
        from = end;
        if from < frame.len() && code != usize::from(u8::MAX) {
            *frame.get_mut(to)? = 0;
            to += 1;
        }
    }
    Some(to)
}
