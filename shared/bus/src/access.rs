//! Functions 3, 4, 6 and 16, whose frames `rmodbus` 0.13 reads and writes.
//!
//! It computes with counts and lengths before it checks them, and may then panic. So it gets only
//! requests whose lengths are right.

use rmodbus::ModbusProto;
use rmodbus::server::{ModbusFrame, Read, Write};

use crate::machine::Machine;
use crate::protocol::{Answer, Exception, HEADER, MAX_ADU_BYTES, function};
use crate::session::Server;
use crate::write;

/// Largest number of registers that a request reads.
const MAX_READ: u16 = 125;
/// Largest number of registers that a request writes.
const MAX_WRITE: u16 = 123;

/// Reads or writes registers.
pub fn access(
    server: &mut Server,
    adu: &[u8],
    machine: &mut impl Machine,
    answer: &mut Answer,
) -> Result<(), Exception> {
    if !is_well_formed(adu) {
        return Err(Exception::Value);
    }
    let mut framed = [0; HEADER + MAX_ADU_BYTES];
    // The smallest length that is accepted; the length of the slice counts.
    framed[HEADER - 1] = HEADER as u8;
    let framed = &mut framed[..HEADER + adu.len()];
    framed[HEADER..].copy_from_slice(adu);
    let failed = |_| Exception::Value;
    let mut frame =
        ModbusFrame::new(adu[0], framed, ModbusProto::TcpUdp, answer).with_broadcast_units(&[]);
    frame.parse().map_err(failed)?;
    if frame.readonly {
        if let Read::Words(read) = frame.get_external_read().map_err(failed)? {
            server.read(read.address, read.buf, machine)?;
        }
    } else {
        if let Write::Words(words) = frame.get_external_write().map_err(failed)? {
            write::write(server, words.address, words.data, machine)?;
        }
        frame.process_external_write(Ok(())).map_err(failed)?;
    }
    answer.copy_within(HEADER.., 0);
    answer.truncate(answer.len().saturating_sub(HEADER));
    Ok(())
}

/// Whether the lengths of a request to read or write registers are right.
fn is_well_formed(adu: &[u8]) -> bool {
    match *adu {
        [
            _,
            function::READ_HOLDING | function::READ_INPUT,
            _,
            _,
            high,
            low,
        ] => (1..=MAX_READ).contains(&u16::from_be_bytes([high, low])),
        [_, function::WRITE_ONE, _, _, _, _] => true,
        [
            _,
            function::WRITE_SEVERAL,
            _,
            _,
            high,
            low,
            bytes,
            ref data @ ..,
        ] => {
            let count = u16::from_be_bytes([high, low]);
            (1..=MAX_WRITE).contains(&count)
                && u16::from(bytes) == 2 * count
                && data.len() == usize::from(bytes)
        }
        _ => false,
    }
}
