//! Recording of a board's messages in a file, and its replay. A record has the bytes from the
//! board, after a frame with its identity. Damage loses only the affected frames.

use std::io::Read;

use kband_control::wire::{Outgoing, Receiver, SCHEMA, VERSION, read_answer};
use kband_link::BoardMessage;

use crate::refusal::{Refusal, Result};

/// Unusable content of a record.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Damage {
    pub unreadable: u64,
    /// Number of bytes after the last complete frame.
    pub cut: u64,
}

pub(crate) const NEXT: &str = "give the path of a file that kband monitor --record wrote";

/// Reads a record and passes its messages to `take`, until `take` returns false.
pub fn replay(
    mut record: impl Read,
    mut take: impl FnMut(BoardMessage) -> Result<bool>,
) -> Result<Damage> {
    let mut receiver = Receiver::new();
    let mut damage = Damage::default();
    let mut identified = false;
    let mut piece = [0; 4096];
    loop {
        let cause = |error| format!("the record cannot be read: {error}");
        let read = record.read(&mut piece);
        let count = read.map_err(|error| Refusal::new(cause(error), NEXT))?;
        if count == 0 {
            break;
        }
        for &byte in &piece[..count] {
            damage.cut = if byte == 0 { 0 } else { damage.cut + 1 };
            let Some(frame) = receiver.push(byte) else {
                continue;
            };
            let Ok(answer) = frame.and_then(read_answer) else {
                damage.unreadable += 1;
                continue;
            };
            if !identified {
                check_header(&answer)?;
                identified = true;
                continue;
            }
            if let Some(message) = BoardMessage::from_frame(answer)
                && !take(message)?
            {
                return Ok(damage);
            }
        }
    }
    if identified {
        return Ok(damage);
    }
    let frames = format!("{} frames in it cannot be read", damage.unreadable);
    let cause = format!("this is no record: {frames}, and none identifies the board");
    Err(Refusal::new(cause, NEXT))
}

/// Refuses a record unless its first frame is an identity of this version and schema.
fn check_header((_, answer): &(u8, Outgoing<'_>)) -> Result<()> {
    let Outgoing::Identity(identity) = answer else {
        let cause = "the record does not begin with the identity of the board";
        return Err(Refusal::new(cause, NEXT));
    };
    if (identity.version, identity.schema) == (VERSION, SCHEMA) {
        return Ok(());
    }
    let cause = format!(
        "the record is of kband {}, which speaks version {}, schema {:08x}; \
         this desk speaks {VERSION}, {SCHEMA:08x}",
        identity.image, identity.version, identity.schema
    );
    let next = "replay it with the kband that recorded it";
    Err(Refusal::new(cause, next))
}

#[cfg(test)]
mod tests {
    use kband_control::wire::{
        Identity, MAX_FRAME_BYTES, Response, Telemetry, write_identity, write_response,
    };

    use super::*;

    const CYCLES: u32 = 40;

    fn header(schema: u32) -> Vec<u8> {
        let identity = Identity {
            version: VERSION,
            schema,
            image: "kband test",
        };
        let mut buffer = [0; MAX_FRAME_BYTES];
        let frame = write_identity(&mut buffer, 0, &identity);
        frame.unwrap().to_vec()
    }

    /// A record, and the ends of its frames.
    fn recorded() -> (Vec<u8>, Vec<usize>) {
        let mut bytes = header(SCHEMA);
        let mut ends = vec![bytes.len()];
        for cycle in 0..CYCLES {
            let response = Response::Telemetry(Telemetry {
                cycle,
                k: 0.43,
                ..Telemetry::default()
            });
            let mut buffer = [0; MAX_FRAME_BYTES];
            bytes.extend_from_slice(write_response(&mut buffer, 0, &response).unwrap());
            ends.push(bytes.len());
        }
        (bytes, ends)
    }

    fn cycles(bytes: &[u8]) -> Result<(Vec<u32>, Damage)> {
        let mut cycles = Vec::new();
        let damage = replay(bytes, |message| {
            match message {
                BoardMessage::Telemetry(telemetry) => cycles.push(telemetry.cycle),
                other => panic!("{other:?}"),
            }
            Ok(true)
        })?;
        Ok((cycles, damage))
    }

    #[test]
    fn a_record_cut_after_any_byte_keeps_every_whole_frame() {
        let (bytes, ends) = recorded();
        for cut in 0..=bytes.len() {
            let whole = ends.iter().filter(|end| **end <= cut).count();
            match cycles(&bytes[..cut]) {
                Ok((cycles, damage)) => {
                    let expected = 0..whole as u32 - 1;
                    assert!(cycles.into_iter().eq(expected), "cut at {cut}");
                    let last = ends.iter().rev().find(|end| **end <= cut).unwrap();
                    assert_eq!((damage.unreadable, damage.cut as usize), (0, cut - last));
                }
                Err(refusal) => {
                    assert_eq!(whole, 0, "cut at {cut}: {refusal}");
                    assert!(refusal.to_string().contains("no record"));
                }
            }
        }
    }

    #[test]
    fn a_wrong_byte_loses_two_frames_at_most_and_is_counted() {
        let (bytes, ends) = recorded();
        for at in ends[0]..bytes.len() {
            for change in [0x01, 0xff, bytes[at]] {
                let mut bad = bytes.clone();
                bad[at] ^= change;
                let (cycles, damage) = cycles(&bad).unwrap();
                assert!(cycles.len() >= CYCLES as usize - 2, "byte {at}: {cycles:?}");
                // An incomplete frame at the end is not counted.
                let all = cycles.len() as u64 + damage.unreadable + u64::from(damage.cut > 0);
                assert!(all >= u64::from(CYCLES) - 1, "byte {at}: {damage:?}");
            }
        }
    }

    /// tests/wrong_inputs.txt has a file that is no record.
    #[test]
    fn records_of_other_versions_are_refused() {
        let message = cycles(&header(SCHEMA ^ 1)).unwrap_err().to_string();
        assert!(message.contains("replay it with the kband"), "{message}");
        assert!(cycles(&header(SCHEMA)).unwrap().0.is_empty());
    }
}
