//! Recording of a board's messages to a file, and its replay.
//!
//! A record is the bytes of the line, after a frame with the board's identity. The reader
//! resynchronizes at the next frame after damaged bytes. A cut or damaged record therefore loses
//! only the frames at the damage.

use std::io::Read;

use kband_control::wire::{
    Outgoing, Receiver, Record, Response, SCHEMA, Telemetry, VERSION, read_answer,
};

use crate::refusal::Refusal;

/// One message of a board.
#[derive(Clone, Debug, PartialEq)]
pub enum Said {
    /// A drive cycle.
    Telemetry(Telemetry),
    /// A record of the event log.
    Event(Record),
    /// The board restarted with this image.
    Started(String),
    /// Key and value of a setting.
    Setting(String, f32),
}

/// Unusable content of a record.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Remains {
    /// Number of unreadable frames.
    pub unreadable: u64,
    /// Number of bytes after the last whole frame.
    pub cut: u64,
}

/// Reads a record and passes its messages to `take`, until that stops.
pub fn replay(
    mut record: impl Read,
    mut take: impl FnMut(Said) -> Result<bool, Refusal>,
) -> Result<Remains, Refusal> {
    let mut receiver = Receiver::new();
    let mut remains = Remains::default();
    let mut known = false;
    let mut piece = [0; 4096];
    loop {
        let count = match record.read(&mut piece) {
            Ok(0) => break,
            Ok(count) => count,
            Err(error) => {
                return Err(Refusal::new(
                    format!("the record cannot be read: {error}"),
                    "give the path of a file that kband monitor --record wrote",
                ));
            }
        };
        for &byte in &piece[..count] {
            remains.cut = if byte == 0 { 0 } else { remains.cut + 1 };
            let Some(frame) = receiver.push(byte) else {
                continue;
            };
            let Ok(answer) = frame.and_then(read_answer) else {
                remains.unreadable += 1;
                continue;
            };
            if !known {
                begins(&answer)?;
                known = true;
                continue;
            }
            if let Some(said) = said(answer)
                && !take(said)?
            {
                return Ok(remains);
            }
        }
    }
    if known {
        return Ok(remains);
    }
    Err(Refusal::new(
        format!(
            "this is no record: {} frames in it cannot be read, and none identifies the board",
            remains.unreadable
        ),
        "give the path of a file that kband monitor --record wrote",
    ))
}

/// Refused unless the first frame is an identity of this desk's version and schema.
fn begins(answer: &Outgoing<'_>) -> Result<(), Refusal> {
    match answer {
        Outgoing::Identity { identity, .. }
            if (identity.version, identity.schema) == (VERSION, SCHEMA) =>
        {
            Ok(())
        }
        Outgoing::Identity { identity, .. } => Err(Refusal::new(
            format!(
                "the record is of kband {}, which speaks version {}, schema {:08x}; \
                 this desk speaks {VERSION}, {SCHEMA:08x}",
                identity.image, identity.version, identity.schema
            ),
            "replay it with the kband that recorded it",
        )),
        Outgoing::Response { .. } | Outgoing::Update { .. } => Err(Refusal::new(
            "the record does not begin with the identity of the board",
            "give the path of a file that kband monitor --record wrote",
        )),
    }
}

fn said(answer: Outgoing<'_>) -> Option<Said> {
    match answer {
        Outgoing::Identity {
            sequence: 0,
            identity,
        } => Some(Said::Started(identity.image.into())),
        Outgoing::Identity { .. } | Outgoing::Update { .. } => None,
        Outgoing::Response { response, .. } => match response {
            Response::Telemetry(telemetry) => Some(Said::Telemetry(telemetry)),
            Response::Event(Some(event)) => Some(Said::Event(event)),
            Response::Setting(setting) => Some(Said::Setting(setting.key.into(), setting.value)),
            _ => None,
        },
    }
}

#[cfg(test)]
mod tests {
    use kband_control::wire::{Identity, MAX_FRAME_BYTES, write_identity, write_response};

    use super::*;

    const CYCLES: u32 = 40;

    fn beginning(schema: u32) -> Vec<u8> {
        let identity = Identity {
            version: VERSION,
            schema,
            image: "kband test",
        };
        write_identity(&mut [0; MAX_FRAME_BYTES], 0, &identity)
            .unwrap()
            .to_vec()
    }

    /// A record, and where its frames end.
    fn recorded() -> (Vec<u8>, Vec<usize>) {
        let mut bytes = beginning(SCHEMA);
        let mut ends = vec![bytes.len()];
        for cycle in 0..CYCLES {
            let telemetry = Telemetry {
                cycle,
                k: 0.43,
                ..Telemetry::default()
            };
            let response = Response::Telemetry(telemetry);
            bytes.extend_from_slice(
                write_response(&mut [0; MAX_FRAME_BYTES], 0, &response).unwrap(),
            );
            ends.push(bytes.len());
        }
        (bytes, ends)
    }

    fn cycles(bytes: &[u8]) -> Result<(Vec<u32>, Remains), Refusal> {
        let mut cycles = Vec::new();
        let remains = replay(bytes, |said| {
            match said {
                Said::Telemetry(telemetry) => cycles.push(telemetry.cycle),
                other => panic!("{other:?}"),
            }
            Ok(true)
        })?;
        Ok((cycles, remains))
    }

    #[test]
    fn a_record_cut_after_any_byte_keeps_every_whole_frame() {
        let (bytes, ends) = recorded();
        for cut in 0..=bytes.len() {
            let whole = ends.iter().filter(|end| **end <= cut).count();
            match cycles(&bytes[..cut]) {
                Ok((cycles, remains)) => {
                    assert!(
                        cycles.iter().copied().eq(0..whole as u32 - 1),
                        "cut at {cut}"
                    );
                    let last = ends.iter().rev().find(|end| **end <= cut).unwrap();
                    assert_eq!((remains.unreadable, remains.cut as usize), (0, cut - last));
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
                let (cycles, remains) = cycles(&bad).unwrap();
                assert!(cycles.len() >= CYCLES as usize - 2, "byte {at}: {cycles:?}");
                // A frame without its end, at the end of the record, is not counted.
                let all = cycles.len() as u64 + remains.unreadable + u64::from(remains.cut > 0);
                assert!(all >= u64::from(CYCLES) - 1, "byte {at}: {remains:?}");
            }
        }
    }

    #[test]
    fn other_files_and_records_of_other_versions_are_refused() {
        let noise: Vec<u8> = (0..100_000_u32)
            .map(|n| (n.wrapping_mul(2_654_435_761) >> 13) as u8)
            .collect();
        let message = cycles(&noise).unwrap_err().to_string();
        assert!(
            message.contains("no record") && message.contains("next:"),
            "{message}"
        );
        let message = cycles(&beginning(SCHEMA ^ 1)).unwrap_err().to_string();
        assert!(message.contains("replay it with the kband"), "{message}");
        assert!(cycles(&beginning(SCHEMA)).unwrap().0.is_empty());
    }
}
