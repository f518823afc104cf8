//! Flash and RAM of an image, read from its ELF file.

use std::path::Path;

/// Sizes of an image in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Footprint {
    /// Flash: code, constants and the start values of variables.
    pub flash: u32,
    /// RAM: variables and the stack kept for them.
    pub memory: u32,
    /// Stack, part of the RAM.
    pub stack: u32,
}

/// The footprint of an ELF image of a 32-bit little-endian machine.
///
/// # Panics
/// If the file is not such an image.
pub fn footprint(image: &Path) -> Footprint {
    let bytes = std::fs::read(image).expect("the image is read");
    assert_eq!(
        &bytes[..6],
        b"\x7fELF\x01\x01",
        "a 32-bit little-endian image"
    );
    let half = |at: usize| usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
    let word = |at: usize| {
        u32::from_le_bytes(
            bytes[at..at + 4]
                .try_into()
                .expect("four bytes are four bytes"),
        )
    };
    let (headers, size, count, names) = (word(32) as usize, half(46), half(48), half(50));
    let names = word(headers + names * size + 16) as usize;
    let mut sizes = Footprint {
        flash: 0,
        memory: 0,
        stack: 0,
    };
    // Section header (System V ABI, ch. 4): name, type, flags, address, offset, size.
    for header in (0..count).map(|n| headers + n * size) {
        let (kind, flags, length) = (word(header + 4), word(header + 8), word(header + 20));
        let (allocated, writable, stored) = (flags & 2 != 0, flags & 1 != 0, kind != 8);
        if !allocated {
            continue;
        }
        let name = &bytes[names + word(header) as usize..];
        if writable || !stored {
            sizes.memory += length;
        }
        if name.starts_with(b".stack\0") {
            sizes.stack = length;
        } else if stored {
            sizes.flash += length;
        }
    }
    sizes
}
