//! Frames on the link: raw bytes, and messages behind a valid checksum.

use kband_control::wire::{
    Incoming, MAX_FRAME_BYTES, Outgoing, Receiver, Request, SCHEMA, VERSION, crc32, read_answer,
    read_reading, read_request, write_request, write_response, write_update_answer,
    write_update_request,
};

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
    let mut inside = [head, message].concat();
    inside.extend(crc32(&inside).to_le_bytes());
    let mut frame = Vec::with_capacity(inside.len() + 4);
    for block in inside.split(|byte| *byte == 0) {
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

/// Payload of a written frame.
///
/// # Panics
/// If it is not a frame.
pub fn inside(frame: &[u8]) -> Vec<u8> {
    let mut receiver = Receiver::new();
    let (end, bytes) = frame.split_last().expect("a frame has an end");
    for byte in bytes {
        assert!(receiver.push(*byte).is_none(), "it ends before its end");
    }
    let inside = receiver.push(*end).expect("it ends at its end");
    inside.expect("a frame that was written is sound").to_vec()
}

/// A parsed message is the same after writing and parsing it again.
fn read(bytes: &[u8]) -> bool {
    let mut known = false;
    if let Ok(Incoming::Request { sequence, request }) = read_request(bytes) {
        known = true;
        if let Request::Samples { mut codes, .. } = request {
            let mut code = 0;
            while let Some(next) = read_reading(&mut codes, code) {
                code = next;
            }
        }
        let mut buffer = [0; MAX_FRAME_BYTES];
        if let Ok(frame) = write_request(&mut buffer, sequence, &request) {
            // Compares the printed forms, in which NaN equals itself.
            let original = format!("{request:?}");
            match read_request(&inside(frame)) {
                Ok(Incoming::Request { request, .. }) => {
                    assert_eq!(format!("{request:?}"), original)
                }
                other => panic!("{original}: {other:?}"),
            }
        }
    }
    if let Ok(Incoming::Update { sequence, request }) = read_request(bytes) {
        known = true;
        let mut buffer = [0; MAX_FRAME_BYTES];
        if let Ok(frame) = write_update_request(&mut buffer, sequence, &request) {
            let again = inside(frame);
            assert_eq!(read_request(&again), read_request(bytes));
        }
    }
    if let Ok(Outgoing::Update { sequence, answer }) = read_answer(bytes) {
        known = true;
        let mut buffer = [0; MAX_FRAME_BYTES];
        if let Ok(frame) = write_update_answer(&mut buffer, sequence, &answer) {
            let again = inside(frame);
            assert_eq!(read_answer(&again), read_answer(bytes));
        }
    }
    if let Ok(Outgoing::Response { sequence, response }) = read_answer(bytes) {
        known = true;
        let mut buffer = [0; MAX_FRAME_BYTES];
        if let Ok(frame) = write_response(&mut buffer, sequence, &response) {
            let original = format!("{response:?}");
            match read_answer(&inside(frame)) {
                Ok(Outgoing::Response { response, .. }) => {
                    assert_eq!(format!("{response:?}"), original)
                }
                other => panic!("{original}: {other:?}"),
            }
        }
    }
    known
}

/// Raw bytes from the line, and the same bytes behind a valid checksum.
pub fn frames(input: &[u8]) -> bool {
    let mut receiver = Receiver::new();
    let mut known = false;
    for byte in input {
        if let Some(Ok(inside)) = receiver.push(*byte) {
            known |= read(inside);
        }
    }
    if let Some((sequence, message)) = input.split_first() {
        let frames = [
            framed(*sequence, message),
            framed_update(*sequence, message),
        ];
        for frame in frames.into_iter().flatten() {
            known |= read(&inside(&frame));
        }
    }
    known
}
