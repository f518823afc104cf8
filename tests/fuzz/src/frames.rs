//! Frames on the link: raw bytes, and messages with a valid checksum.

use kband_control::wire::{
    Incoming, MAX_FRAME_BYTES, Outgoing, Receiver, Request, SCHEMA, VERSION, crc32, read_answer,
    read_reading, read_request, write_request, write_response, write_update_answer,
    write_update_request,
};

/// Words of messages.
pub const WORDS: &str = "amplitude_limit|frequency|stm32f405rg";

/// A frame with a valid checksum and its end byte; `None` if it is too long.
pub fn framed(sequence: u8, message: &[u8]) -> Option<Vec<u8>> {
    let [low, high, ..] = SCHEMA.to_le_bytes();
    framed_behind(&[VERSION, low, high, sequence], message)
}

/// As [`framed`], for a message of an update.
pub fn framed_update(sequence: u8, message: &[u8]) -> Option<Vec<u8>> {
    framed_behind(&[0, sequence, b'u'], message)
}

fn framed_behind(head: &[u8], message: &[u8]) -> Option<Vec<u8>> {
    let mut payload = [head, message].concat();
    payload.extend(crc32(&payload).to_le_bytes());
    let mut frame = Vec::with_capacity(payload.len() + 4);
    for block in payload.split(|byte| *byte == 0) {
        let mut rest = block;
        while rest.len() >= 254 {
            frame.push(255);
            frame.extend_from_slice(&rest[..254]);
            rest = &rest[254..];
        }
        frame.push(rest.len() as u8 + 1);
        frame.extend_from_slice(rest);
    }
    frame.push(0);
    (frame.len() <= MAX_FRAME_BYTES).then_some(frame)
}

/// Payload of a written frame. It panics if it is not a frame.
pub fn payload(frame: &[u8]) -> Vec<u8> {
    let mut receiver = Receiver::new();
    let (end, bytes) = frame.split_last().expect("a frame has an end");
    for byte in bytes {
        assert!(receiver.push(*byte).is_none(), "it ends before its end");
    }
    let payload = receiver.push(*end).expect("it ends at its end");
    payload.expect("a frame that was written is sound").to_vec()
}

/// A parsed message is the same after writing and parsing it again. The test compares printed
/// forms, in which NaN equals itself.
fn read(bytes: &[u8]) -> bool {
    let mut buffer = [0; MAX_FRAME_BYTES];
    let incoming = read_request(bytes);
    let rewritten = match &incoming {
        Ok((sequence, Incoming::Request(request))) => {
            if let Request::Samples { codes, .. } = request {
                let (mut codes, mut code) = (*codes, 0);
                while let Some(next) = read_reading(&mut codes, code) {
                    code = next;
                }
            }
            Some(write_request(&mut buffer, *sequence, request))
        }
        Ok((sequence, Incoming::Update(request))) => {
            Some(write_update_request(&mut buffer, *sequence, request))
        }
        _ => None,
    };
    if let Some(Ok(frame)) = rewritten {
        let decoded = payload(frame);
        let decoded = read_request(&decoded);
        assert_eq!(format!("{decoded:?}"), format!("{incoming:?}"));
    }
    let is_valid = rewritten.is_some();
    let outgoing = read_answer(bytes);
    let answered = match &outgoing {
        Ok((sequence, Outgoing::Response(response))) => {
            Some(write_response(&mut buffer, *sequence, response))
        }
        Ok((sequence, Outgoing::Update(answer))) => {
            Some(write_update_answer(&mut buffer, *sequence, answer))
        }
        _ => None,
    };
    if let Some(Ok(frame)) = answered {
        let decoded = payload(frame);
        let decoded = read_answer(&decoded);
        assert_eq!(format!("{decoded:?}"), format!("{outgoing:?}"));
    }
    is_valid || answered.is_some()
}

/// Raw bytes from the line, and the same bytes with a valid checksum.
pub fn frames(input: &[u8]) -> bool {
    let mut receiver = Receiver::new();
    let mut is_valid = false;
    for byte in input {
        if let Some(Ok(payload)) = receiver.push(*byte) {
            is_valid |= read(payload);
        }
    }
    if let Some((sequence, message)) = input.split_first() {
        let frames = [framed, framed_update].map(|frame| frame(*sequence, message));
        for frame in frames.into_iter().flatten() {
            is_valid |= read(&payload(&frame));
        }
    }
    is_valid
}
