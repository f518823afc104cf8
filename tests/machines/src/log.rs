//! Reader of an image's log from the memory of its chip.
//!
//! defmt-rtt writes frames into a ring buffer at the symbol `_SEGGER_RTT`. A frame is stuffed, so
//! that zeros occur only at its end (<https://github.com/Dirbaio/rzcobs>). It has two bytes for the
//! number of the text, eight for the time, then the arguments. The texts are symbols of the image.

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
    /// Bytes of the arguments as text.
    pub arguments: String,
}

/// Lines in the ring of the chip that runs an image, oldest first.
///
/// # Panics
/// The file is no image with a log, or a frame is invalid.
pub fn said(chip: &Chip, image: &Path) -> Vec<Line> {
    let bytes = std::fs::read(image).expect("the image is read");
    let file = object::File::parse(&*bytes).expect("an ELF file");
    let text = |number: u16| {
        let mut named = file
            .symbols()
            .filter(|symbol| symbol.address() == u64::from(number));
        let found = named.find_map(|symbol| {
            let (_, text) = symbol.name().ok()?.split_once("\"data\":\"")?;
            let (text, _) = text.split_once("\",\"disambiguator\"")?;
            Some(text.to_owned())
        });
        found.expect("a text of this number")
    };
    let ram = &chip.board.ram;
    let head = (images::symbol(image, "_SEGGER_RTT") - MEMORY) as usize;
    let word = |at: usize| {
        let bytes = ram[head + at..][..4].try_into().expect("four bytes");
        u32::from_le_bytes(bytes)
    };
    // Buffer, size, and offsets of writing and reading of the first channel up.
    let (buffer, size, write, read) = (word(28) - MEMORY, word(32), word(36), word(40));
    let unread = (0..(write + size - read) % size).map(|n| (buffer + (read + n) % size) as usize);
    let bytes: Vec<u8> = unread.map(|at| ram[at]).collect();
    let frames = bytes
        .split(|byte| *byte == 0)
        .filter(|frame| !frame.is_empty());
    frames
        .map(|frame| {
            let bytes = unstuff(frame);
            let (number, rest) = bytes.split_first_chunk().expect("a number");
            let (time, arguments) = rest.split_first_chunk().expect("a time");
            Line {
                text: text(u16::from_le_bytes(*number)),
                time: u64::from_le_bytes(*time),
                arguments: String::from_utf8_lossy(arguments).into_owned(),
            }
        })
        .collect()
}

/// Decodes a stuffed frame from its end: each mark lists the zeros among the bytes before it.
fn unstuff(frame: &[u8]) -> Vec<u8> {
    let mut rest = frame.iter().rev().copied();
    let mut bytes = Vec::new();
    while let Some(mark) = rest.next() {
        match mark {
            0x80..=0xfe => {
                bytes.push(0);
                bytes.extend(rest.by_ref().take(usize::from(mark & 0x7f) + 7));
            }
            0xff => bytes.extend(rest.by_ref().take(134)),
            mark => bytes.extend((0..7).rev().filter_map(|bit| {
                if mark >> bit & 1 == 1 {
                    Some(0)
                } else {
                    rest.next()
                }
            })),
        }
    }
    bytes.reverse();
    bytes
}
