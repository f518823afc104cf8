//! Functions 3, 4, 6 and 16: reading and writing registers.

use crate::machine::Machine;
use crate::protocol::{Answer, Exception, function};
use crate::server::Server;
use crate::write;

/// Largest number of registers in a request.
const MAX_READ: u16 = 125;
const MAX_WRITE: u16 = 123;

pub fn access(
    server: &mut Server,
    adu: &[u8],
    machine: &mut impl Machine,
    answer: &mut Answer,
) -> Result<(), Exception> {
    let full = |_| Exception::Value;
    let &[unit, function, high, low, ref rest @ ..] = adu else {
        return Err(Exception::Value);
    };
    let address = u16::from_be_bytes([high, low]);
    match (function, rest) {
        (function::READ_HOLDING | function::READ_INPUT, &[high, low]) => {
            let count = u16::from_be_bytes([high, low]);
            if !(1..=MAX_READ).contains(&count) {
                return Err(Exception::Value);
            }
            let head = [unit, function, 2 * count as u8];
            answer.extend_from_slice(&head).map_err(full)?;
            let end = head.len() + 2 * usize::from(count);
            answer.resize(end, 0).map_err(full)?;
            server.read(address, &mut answer[head.len()..], machine)
        }
        (function::WRITE_ONE, word @ [_, _]) => {
            write::write(server, address, word, machine)?;
            answer.extend_from_slice(adu).map_err(full)
        }
        (function::WRITE_SEVERAL, &[high, low, bytes, ref words @ ..]) => {
            let count = u16::from_be_bytes([high, low]);
            if !(1..=MAX_WRITE).contains(&count)
                || u16::from(bytes) != 2 * count
                || words.len() != usize::from(bytes)
            {
                return Err(Exception::Value);
            }
            write::write(server, address, words, machine)?;
            answer.extend_from_slice(&adu[..6]).map_err(full)
        }
        _ => Err(Exception::Value),
    }
}
