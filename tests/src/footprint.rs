//! Flash and RAM of an image, read from its ELF file.

use std::path::Path;

use object::{Object, ObjectSection, SectionFlags, elf};

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
    let file = object::File::parse(&*bytes).expect("an ELF file");
    let mut sizes = Footprint {
        flash: 0,
        memory: 0,
        stack: 0,
    };
    for section in file.sections() {
        let SectionFlags::Elf { sh_flags, .. } = section.flags() else {
            panic!("no section of an ELF file");
        };
        if sh_flags.0 & elf::SHF_ALLOC.0 == 0 {
            continue;
        }
        let length = section.size() as u32;
        let stored = section.file_range().is_some();
        if sh_flags.0 & elf::SHF_WRITE.0 != 0 || !stored {
            sizes.memory += length;
        }
        if section.name() == Ok(".stack") {
            sizes.stack = length;
        } else if stored {
            sizes.flash += length;
        }
    }
    sizes
}
