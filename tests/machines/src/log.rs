//! Reader of an image's log from the memory of its chip.
//!
//! defmt-rtt writes frames into a ring buffer at the symbol `_SEGGER_RTT`. A frame is stuffed, so
//! that zeros occur only at its end (<https://github.com/Dirbaio/rzcobs>). It has two bytes for the
//! number of the text, eight for the time, then the arguments. The texts are symbols of the image.
//! The desk's decoder reads the same ring through a probe, in `host/tests/probe.rs`.

use std::collections::HashMap;
use std::path::Path;

use object::{Object, ObjectSymbol};

use crate::chip::{Chip, MEMORY};
use crate::images;

/// A line of a log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// Text with unfilled placeholders.
    pub text: String,
    /// Time since the start, ms.
    pub time: u64,
    /// Bytes of the arguments; there may be extra zeros at the end.
    pub arguments: Vec<u8>,
}

/// Size of the ring's header with its mark, bytes.
const HEAD: usize = 48;
/// Mark at the start of the ring's header.
const MARK: &[u8] = b"SEGGER RTT\0";

/// Lines in the ring of the chip that runs an image, oldest first; empty where there is no ring
/// yet.
///
/// # Panics
/// The file is no image with a log, or a frame is invalid.
pub fn said(chip: &Chip, image: &Path) -> Vec<Line> {
    let ram = &chip.board.ram;
    let head = (images::symbol(image, "_SEGGER_RTT") - MEMORY) as usize;
    let head = &ram[head..head + HEAD];
    if !head.starts_with(MARK) {
        return Vec::new();
    }
    let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let (buffer, size, write, read) = (word(28) - MEMORY, word(32), word(36), word(40));
    let unread = (write + size - read) % size;
    let bytes: Vec<u8> = (0..unread)
        .map(|n| ram[(buffer + (read + n) % size) as usize])
        .collect();
    let texts = texts(image);
    let whole = bytes.split_inclusive(|byte| *byte == 0);
    let whole = whole.filter_map(|frame| frame.strip_suffix(&[0]));
    whole
        .filter(|frame| !frame.is_empty())
        .map(|frame| {
            let bytes = unstuff(frame);
            let (number, rest) = bytes.split_first_chunk().expect("a number");
            let (time, arguments) = rest.split_first_chunk().expect("a time");
            Line {
                text: texts[&u16::from_le_bytes(*number)].clone(),
                time: u64::from_le_bytes(*time),
                arguments: arguments.into(),
            }
        })
        .collect()
}

/// Texts of the image by their numbers.
fn texts(image: &Path) -> HashMap<u16, String> {
    let bytes = std::fs::read(image).expect("the image is read");
    let file = object::File::parse(&*bytes).expect("an ELF file");
    file.symbols()
        .filter_map(|symbol| {
            let (_, text) = symbol.name().ok()?.split_once("\"data\":\"")?;
            let (text, _) = text.split_once("\",\"disambiguator\"")?;
            Some((symbol.address() as u16, text.to_owned()))
        })
        .collect()
}

/// Decodes a stuffed frame from its end: each mark lists the zeros among the bytes before it.
fn unstuff(frame: &[u8]) -> Vec<u8> {
    let mut rest = frame.iter().rev().copied();
    let mut bytes = Vec::new();
    while let Some(mark) = rest.next() {
        let mut take = |count: u8, bytes: &mut Vec<u8>| {
            bytes.extend((0..count).map(|_| rest.next().expect("a whole frame")));
        };
        match mark {
            0x80..=0xfe => {
                bytes.push(0);
                take((mark & 0x7f) + 7, &mut bytes);
            }
            0xff => take(134, &mut bytes),
            mark => {
                for bit in (0..7).rev() {
                    if mark >> bit & 1 == 1 {
                        bytes.push(0);
                    } else {
                        take(1, &mut bytes);
                    }
                }
            }
        }
    }
    bytes.reverse();
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unstuffing_restores_the_zeros() {
        assert_eq!(unstuff(&[7, 9, 0b0111_1010]), [7, 0, 9, 0, 0, 0, 0]);
        let run: Vec<u8> = (1..=9).collect();
        assert_eq!(
            unstuff(&[&run[..], &[0x82]].concat()),
            [&run[..], &[0]].concat()
        );
        let long = [5; 134];
        assert_eq!(unstuff(&[&long[..], &[0xff]].concat()), long);
    }
}
