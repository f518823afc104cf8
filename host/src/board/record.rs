//! What a board said, kept in a file and read again.
//!
//! A record is the bytes of the line as they came, behind the frame that says which board it was.
//! The next frame is found again after any bytes that are none, so that a record that ends or is
//! damaged anywhere loses what was there and nothing else.

use std::io::Read;

use kband_control::wire::{
    Outgoing, Receiver, Record, Response, SCHEMA, Telemetry, VERSION, read_answer,
};

use crate::refusal::Refusal;

/// One thing that a board said.
#[derive(Clone, Debug, PartialEq)]
pub enum Said {
    /// A drive cycle.
    Telemetry(Telemetry),
    /// A record of the event log.
    Event(Record),
    /// It started anew, running this image.
    Started(String),
    /// A setting has this value.
    Setting(String, f32),
}

/// What else was in a record.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Remains {
    /// Frames that could not be read.
    pub unreadable: u64,
    /// Bytes at the end that no frame ends.
    pub cut: u64,
}

/// Reads a record and hands on what was said, until `take` wants no more.
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
            "this is no record: {} frames in it cannot be read, and none says which board it was",
            remains.unreadable
        ),
        "give the path of a file that kband monitor --record wrote",
    ))
}

/// Refused unless it says which board it was, and this desk knows what that board says.
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
        Outgoing::Response { .. } => Err(Refusal::new(
            "the record does not begin with which board it was",
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
        Outgoing::Identity { .. } => None,
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
                // A frame that lost its end at the end of the record is not there to be counted.
                let all = cycles.len() as u64 + remains.unreadable + u64::from(remains.cut > 0);
                assert!(all >= u64::from(CYCLES) - 1, "byte {at}: {remains:?}");
            }
        }
    }

    #[test]
    fn what_is_no_record_and_what_is_another_kbands_is_refused() {
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
