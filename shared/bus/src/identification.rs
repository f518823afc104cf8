//! Device identification, function 43 of type 14: vendor, product code, revision.

use crate::protocol::{Answer, Exception};

/// Type of the encapsulated request: read device identification.
const READ_DEVICE: u8 = 14;
/// Code of a request for the basic objects, as a stream.
const BASIC: u8 = 1;
/// Code of a request for one object.
const ONE: u8 = 4;
/// Conformity level: basic, as a stream and one at a time.
const CONFORMITY: u8 = 0x81;
/// Largest length of an object, bytes, so that three fit an answer.
const MAX_OBJECT_BYTES: usize = 64;

/// Answers a request of function 43; `image` is the revision.
pub fn answer(adu: &[u8], image: &str, answer: &mut Answer) -> Result<(), Exception> {
    let objects = ["kband", "feeder", image];
    let (unit, code, first) = match *adu {
        [unit, _, READ_DEVICE, code, object] => (unit, code, usize::from(object)),
        [_, _, READ_DEVICE, ..] => return Err(Exception::Value),
        _ => return Err(Exception::Function),
    };
    let chosen = match code {
        // An unknown object starts at the first one.
        BASIC if first >= objects.len() => 0..objects.len(),
        BASIC => first..objects.len(),
        ONE if first < objects.len() => first..first + 1,
        ONE => return Err(Exception::Address),
        _ => return Err(Exception::Value),
    };
    let count = chosen.len() as u8;
    let full = |_| Exception::Value;
    let head = [unit, 43, READ_DEVICE, code, CONFORMITY, 0, 0, count];
    answer.extend_from_slice(&head).map_err(full)?;
    let numbered = objects.iter().enumerate();
    for (number, object) in numbered.skip(chosen.start).take(chosen.len()) {
        let text = &object.as_bytes()[..object.len().min(MAX_OBJECT_BYTES)];
        let head = [number as u8, text.len() as u8];
        answer.extend_from_slice(&head).map_err(full)?;
        answer.extend_from_slice(text).map_err(full)?;
    }
    Ok(())
}
