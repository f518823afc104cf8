//! An image for the board (ELF), checked before the board is touched: chip, address ranges, RAM
//! with the stack, vector table. Its last word gets the CRC-32 of the program before it.

use std::ops::Range;
use std::path::Path;

use kband_control::wire::crc32;
use object::elf::{EM_ARM, ET_EXEC, FileHeader32, PT_LOAD};
use object::read::elf::{FileHeader, ProgramHeader, SectionHeader};
use object::{FileKind, LittleEndian};

use super::model::{CHIPS, Chip};
use crate::refusal::{Refusal, Result};

const BUILD: &str = "build the board's image with: cargo feeder";

fn unfit(why: impl Into<String>) -> Refusal {
    Refusal::new(why, BUILD)
}

fn addresses(range: &Range<u32>) -> String {
    format!("{:#010x}..{:#010x}", range.start, range.end)
}

/// Bytes for an address of the flash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Piece {
    pub address: u32,
    pub bytes: Vec<u8>,
}

impl Piece {
    fn new(address: u32, bytes: &[u8]) -> Self {
        let bytes = bytes.to_vec();
        Self { address, bytes }
    }

    fn end(&self) -> u32 {
        self.address + self.bytes.len() as u32
    }
}

/// An image that fits its own chip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// The chip of the image.
    pub chip: &'static Chip,
    /// Contents of the flash, by ascending address.
    pub pieces: Vec<Piece>,
    /// RAM used, bytes, including the stack.
    pub memory: u32,
    program: u32,
}

impl Image {
    /// Reads and checks an image; the refusal says what does not fit.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = crate::file::read(path, BUILD)?;
        Self::parse(&bytes).map_err(|refusal| refusal.at(path.display()))
    }

    /// The image in the bytes of an ELF file.
    pub fn parse(file: &[u8]) -> Result<Self> {
        let damaged = |error: object::read::Error| unfit(format!("the file is damaged: {error}"));
        let other = match FileKind::parse(file) {
            Ok(FileKind::Elf32) => None,
            Ok(FileKind::Elf64) => Some("this is a program of 64 bits, not one for a board"),
            _ => Some("this is no ELF file; .bin and .hex lack the data for the checks"),
        };
        if let Some(why) = other {
            return Err(unfit(why));
        }
        let header = FileHeader32::<LittleEndian>::parse(file).map_err(damaged)?;
        let endian = header.endian().map_err(damaged)?;
        let (machine, kind) = (header.e_machine(endian), header.e_type(endian));
        if machine != EM_ARM || kind != ET_EXEC {
            let value = format!("{}, {}", machine.0, kind.0);
            let accepted = format!("{}, {}: a program for Arm", EM_ARM.0, ET_EXEC.0);
            return Err(Refusal::value("machine, type", value, accepted, BUILD));
        }
        let sections = header.sections(endian, file).map_err(damaged)?;
        let section = |name: &[u8]| Some(sections.section_by_name(endian, name)?.1);
        let size = |name: &[u8]| section(name).map(|header| header.sh_size(endian));
        // Semihosting needs a debugger: without one it hangs.
        if size(b".emulated").is_some() {
            return Err(unfit("this image is the emulated board's"));
        }
        let name = section(b".chip").map(|header| header.data(endian, file));
        let name = name.transpose().map_err(damaged)?;
        let nameless = || unfit("this image names no chip: it is another program's");
        let chip = find_chip(name.ok_or_else(nameless)?)?;
        let mut pieces = Vec::new();
        let mut memory = chip.memory.start..chip.memory.start;
        for segment in header.program_headers(endian, file).map_err(damaged)? {
            if segment.p_type(endian) != PT_LOAD {
                continue;
            }
            let bytes = segment.data(endian, file);
            let bytes = bytes.map_err(|()| unfit("the file is shorter than its header says"))?;
            let (run, length) = (segment.p_vaddr(endian), segment.p_memsz(endian));
            let runs = span(run, length)?;
            if length > 0 && within(&runs, &chip.memory) {
                memory.end = memory.end.max(runs.end);
            } else if length > 0 && !within(&runs, &chip.flash) {
                return Err(outside("runs at", &runs, chip));
            }
            if !bytes.is_empty() {
                let address = segment.p_paddr(endian);
                let lies = span(address, bytes.len() as u32)?;
                let free = lies.end <= chip.settings.start || chip.settings.end <= lies.start;
                if !within(&lies, &chip.flash) || !free {
                    return Err(outside("is stored at", &lies, chip));
                }
                pieces.push(Piece::new(address, bytes));
            }
        }
        pieces.sort_by_key(|piece| piece.address);
        for pair in pieces.windows(2) {
            let second = pair[1].address;
            if pair[0].end() > second {
                let cause = format!("two parts of it are stored at {second:#010x}");
                return Err(unfit(cause));
            }
        }
        let program =
            section(b".vector_table").map_or(chip.flash.start, |header| header.sh_addr(endian));
        fill_check(&mut pieces, program.max(chip.flash.start))?;
        let image = Self {
            chip,
            pieces,
            memory: memory.end - memory.start,
            program,
        };
        let vectors = size(b".vector_table").unwrap_or(0) as usize / 4;
        if vectors != chip.vectors {
            let key = "entries of the vector table";
            let accepted = format!("{} on the {}", chip.vectors, chip.name);
            let next = format!("build it anew: {}", chip.build);
            return Err(Refusal::value(key, vectors, accepted, next));
        }
        image.check_vectors()?;
        if size(b".defmt").is_none_or(|size| size == 0) {
            let cause = "this image has no log as a board's has: it is another program's";
            return Err(unfit(cause));
        }
        Ok(image)
    }

    /// Flash used, bytes.
    pub fn size(&self) -> u32 {
        let sizes = self.pieces.iter().map(|piece| piece.bytes.len() as u32);
        sizes.sum()
    }

    /// Number of the image's bytes in a part of the flash.
    pub fn bytes_in(&self, part: &Range<u32>) -> u32 {
        let within = |piece: &Piece| {
            let from = piece.address.max(part.start);
            piece.end().min(part.end).saturating_sub(from)
        };
        self.pieces.iter().map(within).sum()
    }

    /// Size of the program in the chip's slot, bytes.
    pub fn size_in_slot(&self) -> u32 {
        let pieces = self.pieces.iter();
        let pieces = pieces.filter(|piece| self.chip.slot.contains(&piece.address));
        pieces.map(|piece| piece.bytes.len() as u32).sum()
    }

    /// The program for the chip's slot, a multiple of 4 bytes; refused if it does not fit there.
    pub fn update(&self) -> Result<Vec<u8>> {
        let slot = &self.chip.slot;
        let mut bytes = contents_from(slot.start, &self.pieces);
        bytes.resize(bytes.len().next_multiple_of(4), 0xff);
        let program = self.program..slot.start + bytes.len() as u32;
        if program.start != slot.start || program.end > slot.end {
            let key = "program";
            let accepted = format!("{}, from its start on", addresses(slot));
            return Err(Refusal::value(key, addresses(&program), accepted, BUILD));
        }
        Ok(bytes)
    }

    fn word(&self, address: u32) -> Option<u32> {
        let mut pieces = self.pieces.iter();
        let piece = pieces.find(|piece| (piece.address..piece.end()).contains(&address))?;
        let at = (address - piece.address) as usize;
        let word = piece.bytes[at..].first_chunk();
        word.copied().map(u32::from_le_bytes)
    }

    /// Checks that the stack is in RAM, and that every handler is in the image and in Thumb.
    fn check_vectors(&self) -> Result<()> {
        let chip = self.chip;
        let table = self.program;
        let vector = |number: u32| {
            self.word(table.saturating_add(4 * number))
                .ok_or_else(|| unfit(format!("it has no vector table at {table:#010x}")))
        };
        let stack = vector(0)?;
        let memory = &chip.memory;
        if !(memory.start < stack && stack <= memory.end && stack.is_multiple_of(8)) {
            let accepted = addresses(&(memory.start + 8..memory.end));
            let value = format!("{stack:#010x}");
            let accepted = format!("{accepted} in steps of 8");
            return Err(Refusal::value("stack", value, accepted, BUILD));
        }
        for number in 1..chip.vectors as u32 {
            let handler = vector(number)?;
            // Reset, NMI and hard fault must exist; 0 marks a reserved entry.
            let absent = handler == 0 && number > 3;
            if !absent && (handler & 1 == 0 || self.word(handler & !1).is_none()) {
                let key = format!("entry {number} of the vector table");
                let value = format!("{handler:#010x}");
                let accepted = "the address of Thumb code in the image";
                return Err(Refusal::value(key, value, accepted, BUILD));
            }
        }
        Ok(())
    }
}

/// Contents of the flash from an address on, erased between the pieces.
fn contents_from(start: u32, pieces: &[Piece]) -> Vec<u8> {
    let mut contents = Vec::new();
    for piece in pieces.iter().filter(|piece| start <= piece.address) {
        contents.resize((piece.address - start) as usize, 0xff);
        contents.extend_from_slice(&piece.bytes);
    }
    contents
}

/// Fills the last word of an image with the CRC-32 of the program from the address `program` on,
/// which the board checks at each start. An update does not replace a loader before it.
fn fill_check(pieces: &mut [Piece], program: u32) -> Result<()> {
    let mut flash = contents_from(program, pieces);
    let last = pieces.last_mut();
    match last.and_then(|piece| piece.bytes.last_chunk_mut()) {
        // The last word is erased.
        Some(place) if *place == [0xff; 4] && flash.len() >= place.len() => {
            flash.truncate(flash.len() - place.len());
            *place = crc32(&flash).to_le_bytes();
            Ok(())
        }
        _ => Err(unfit("this image has no place for its check")),
    }
}

fn find_chip(name: &[u8]) -> Result<&'static Chip> {
    let name = String::from_utf8_lossy(name);
    Chip::named(&name).ok_or_else(|| {
        let supported: Vec<&str> = CHIPS.iter().map(|chip| chip.name).collect();
        Refusal::value("chip of the image", &name, supported.join(", "), BUILD)
    })
}

fn span(start: u32, length: u32) -> Result<Range<u32>> {
    let beyond = || format!("a part of it at {start:#010x} ends beyond all memory");
    let end = start.checked_add(length).ok_or_else(|| unfit(beyond()))?;
    Ok(start..end)
}

fn within(inner: &Range<u32>, outer: &Range<u32>) -> bool {
    outer.start <= inner.start && inner.end <= outer.end
}

fn outside(does: &str, range: &Range<u32>, chip: &Chip) -> Refusal {
    let key = format!("a part that {does}");
    let accepted = format!(
        "flash {} of the {}, without {} of its settings, RAM {}",
        addresses(&chip.flash),
        chip.name,
        addresses(&chip.settings),
        addresses(&chip.memory)
    );
    Refusal::value(key, addresses(range), accepted, BUILD)
}

#[cfg(test)]
mod tests {
    use super::super::model::{STM32F405RG, STM32G474RE};
    use super::*;

    struct Parts {
        machine: u16,
        table_at: u32,
        vectors: Vec<u32>,
        code_at: u32,
        stack: (u32, u32),
        log: u32,
        emulated: bool,
        check: bool,
        chip: &'static str,
    }

    fn elf_with(change: impl FnOnce(&mut Parts)) -> Vec<u8> {
        let mut parts = Parts {
            machine: EM_ARM.0,
            table_at: 0x0800_0000,
            vectors: vec![0x0800_0189; 98],
            code_at: 0x0800_0188,
            stack: (0x2000_0000, 0x8000),
            log: 15,
            emulated: false,
            check: true,
            chip: "stm32f405rg",
        };
        parts.vectors[0] = 0x2000_8000;
        parts.vectors[7] = 0;
        change(&mut parts);
        let names = b"\0.vector_table\0.defmt\0.names\0.emulated\0.chip\0";
        let table = parts.vectors.iter().flat_map(|word| word.to_le_bytes());
        let table: Vec<u8> = table.collect();
        let mut code = [0_u8; 64];
        if parts.check {
            code[60..].fill(0xff);
        }
        let (segments_at, count) = (52_u32, 3_u32);
        let table_at = segments_at + 32 * count;
        let code_at = table_at + table.len() as u32;
        let names_at = code_at + code.len() as u32;
        let chip_at = names_at + names.len() as u32;
        let sections_at = chip_at + parts.chip.len() as u32;
        let mut file = b"\x7fELF\x01\x01\x01".to_vec();
        file.resize(16, 0);
        let sections = 4 + u16::from(!parts.chip.is_empty()) + u16::from(parts.emulated);
        let push_words = |file: &mut Vec<u8>, values: &[u32]| {
            file.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        };
        file.extend([ET_EXEC.0, parts.machine].map(u16::to_le_bytes).concat());
        let flags = 0x0500_0400;
        let words = [1, 0x0800_0189, segments_at, sections_at, flags];
        push_words(&mut file, &words);
        let sizes = [52, 32, count as u16, 40, sections, 3];
        file.extend(sizes.map(u16::to_le_bytes).concat());
        let size = table.len() as u32;
        // Place in the file and in memory, sizes in both, flags.
        for [from, to, stored, held, flags] in [
            [table_at, parts.table_at, size, size, 4],
            [code_at, parts.code_at, 64, 64, 5],
            [code_at, parts.stack.0, 0, parts.stack.1, 6],
        ] {
            let words = [PT_LOAD.0, from, to, to, stored, held, flags, 4];
            push_words(&mut file, &words);
        }
        file.extend_from_slice(&table);
        file.extend_from_slice(&code);
        file.extend_from_slice(names);
        file.extend_from_slice(parts.chip.as_bytes());
        // Name, kind, flags, address, place in the file, size, alignment.
        let length = parts.chip.len() as u32;
        for [name, kind, flags, address, at, size, align] in [
            [0; 7],
            [1, 1, 2, parts.table_at, table_at, size, 4],
            [15, 1, 0, 0, code_at, parts.log, 4],
            [22, 3, 0, 0, names_at, names.len() as u32, 1],
            [39, 1, 0, 0, chip_at, length, 1],
            [29, 1, 0, 0, code_at, 1, 1],
        ] {
            if (name == 39 && length == 0) || (name == 29 && !parts.emulated) {
                continue;
            }
            let words = [name, kind, flags, address, at, size, 0, 0, align, 0];
            push_words(&mut file, &words);
        }
        file
    }

    /// The vector table of the STM32G474.
    fn larger_table(parts: &mut Parts) {
        parts.vectors.resize(118, 0);
        parts.code_at = 0x0800_01d8;
        parts.vectors[1..4].fill(0x0800_01d9);
        parts.vectors[4..].fill(0);
    }

    fn second_chip(parts: &mut Parts) {
        larger_table(parts);
        parts.chip = "stm32g474re";
    }

    fn refused(file: &[u8]) -> String {
        Image::parse(file).unwrap_err().to_string()
    }

    #[test]
    fn a_fitting_image_is_accepted_for_the_chip_that_it_names() {
        let image = Image::parse(&elf_with(|_| {})).unwrap();
        assert_eq!((image.size(), image.memory), (98 * 4 + 64, 0x8000));
        let bytes = STM32F405RG.sectors();
        let bytes: Vec<u32> = bytes.map(|sector| image.bytes_in(&sector.range)).collect();
        assert_eq!(bytes, [456, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(image.chip, &STM32F405RG);
        let second = elf_with(second_chip);
        assert_eq!(Image::parse(&second).unwrap().chip, &STM32G474RE);
        let mixed = refused(&elf_with(larger_table));
        for expected in ["118", "98 on the STM32F405RG"] {
            assert!(mixed.contains(expected), "{mixed}");
        }
    }

    #[test]
    fn an_update_is_the_program_in_the_slot_of_its_chip() {
        // An image for the slot of the STM32F405, behind a loader.
        let behind_loader = elf_with(|parts| {
            parts.table_at = 0x0802_0000;
            parts.code_at = 0x0802_1000;
            parts.vectors[1..].fill(0x0802_1001);
            parts.vectors[97] = 0x0802_100f;
        });
        let image = Image::parse(&behind_loader).unwrap();
        let update = image.update().unwrap();
        let [table, code] = &image.pieces[..] else {
            panic!("two pieces");
        };
        assert_eq!(update.len(), 0x1000 + 64);
        assert_eq!(update[..392], table.bytes);
        assert!(update[392..0x1000].iter().all(|byte| *byte == 0xff));
        assert_eq!(update[0x1000..], code.bytes);
        let refused = |expected: &str, change: fn(&mut Parts)| {
            let image = Image::parse(&elf_with(change)).unwrap();
            let message = image.update().unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        };
        refused("0x08020000..0x08080000", |_| {});
        refused("0x08020000..0x08080040", |parts| {
            parts.table_at = 0x0802_0000;
            parts.code_at = 0x0808_0000;
            parts.vectors[1..].fill(0x0808_0001);
        });
        refused("0x08006000..0x0807e000", second_chip);
    }

    #[test]
    fn the_check_leaves_out_a_loader_before_the_program() {
        let loader = Piece::new(0x0800_0000, &[1; 64]);
        let program = [
            Piece::new(0x0800_6000, &[2; 8]),
            Piece::new(0x0800_6010, &[[3; 8], [0xff; 8]].concat()[..12]),
        ];
        let [mut with, mut without] = [vec![loader], vec![]];
        for pieces in [&mut with, &mut without] {
            pieces.extend(program.clone());
            fill_check(pieces, 0x0800_6000).unwrap();
        }
        assert_eq!(with[1..], without);
        let before = [[2; 8], [0xff; 8], [3; 8]].concat();
        assert_eq!(with[2].bytes[8..], crc32(&before).to_le_bytes());
    }

    #[test]
    fn an_unfit_image_is_refused_with_its_reason() {
        type Change = fn(&mut Parts);
        let cases: [(Change, &str); 15] = [
            (|parts| parts.machine = 3, "machine"),
            (|parts| parts.code_at = 0x0800_3ff0, "0x08003ff0"),
            (|parts| parts.code_at = 0x1fff_0000, "0x1fff0000"),
            (|parts| parts.code_at = 0xffff_fff0, "beyond all memory"),
            (|parts| parts.code_at = 0x0800_0100, "two parts"),
            (|parts| parts.stack.1 = 0x2_0001, "0x20020001"),
            (|parts| parts.vectors[0] = 0x2002_0008, "0x20020008"),
            (|parts| parts.vectors[3] = 0x0800_0188, "entry 3 "),
            (|parts| parts.vectors[20] = 0x0800_1001, "entry 20 "),
            (|parts| parts.log = 0, "no log"),
            (|parts| parts.check = false, "no place for its check"),
            (|parts| parts.emulated = true, "emulated board"),
            (|parts| parts.chip = "", "names no chip"),
            (|parts| parts.chip = "stm32h743zi", "stm32h743zi"),
            (|parts| parts.chip = "stm32g474re", "118 on the STM32G474RE"),
        ];
        for (change, expected) in cases {
            let message = refused(&elf_with(change));
            assert!(message.contains(expected), "no '{expected}': {message}");
            assert!(message.contains("cargo feeder"), "{message}");
        }
        for file in [&b""[..], b":020000040800F2", &[0x7f; 99]] {
            assert!(refused(file).contains("no ELF"));
        }
    }
}
