//! The log of a board in its memory: a ring that the board fills and a desk empties.
//!
//! The layout is SEGGER's RTT, as defmt-rtt writes it. The desk reads the ring while the core runs
//! on. A board with a full ring drops lines and does not wait.

use std::ops::Range;
use std::path::Path;
use std::sync::mpsc::TryRecvError;
use std::time::Duration;

use object::LittleEndian;
use object::elf::FileHeader32;
use object::read::elf::{FileHeader, Sym};

use super::apart;
use super::image::Image;
use super::reach::Reached;
use crate::desk::Desk;
use crate::refusal::Refusal;

/// Name of the ring's symbol in the image.
const NAME: &[u8] = b"_SEGGER_RTT";
/// First bytes of the ring's header in memory.
const MARK: &[u8] = b"SEGGER RTT\0";
/// Bytes of its header: mark, two counts, the first channel with name, buffer, size, write, read
/// and mode.
const HEADER_BYTES: usize = 48;
/// Offset in the header of the read position, which the desk writes.
const READ_OFFSET: u32 = 40;
/// Largest accepted size of a ring, bytes.
const LONGEST_RING: u32 = 65_536;
/// Bytes of the vector table that identify an image.
const VECTOR_TABLE_BYTES: usize = 392;

/// Time between two reads of the ring; a board writes at most a few hundred bytes a second.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Follows the log of the board on the wanted probe: each call returns the bytes since the last.
///
/// The board must run the image `elf`.
pub fn follow(
    elf: &Path,
    wanted: Option<&str>,
    desk: &Desk,
) -> Result<impl FnMut() -> Result<Vec<u8>, Refusal> + use<>, Refusal> {
    let (elf, wanted) = (elf.to_path_buf(), wanted.map(str::to_owned));
    let said = apart::start(move |sender| {
        let mut ring = match Ring::of(&elf, wanted.as_deref()) {
            Ok(ring) => ring,
            Err(refusal) => {
                // A closed channel has no reader.
                let _ = sender.send(Err(refusal));
                return;
            }
        };
        while sender.send(ring.take()).is_ok() {
            std::thread::sleep(POLL_INTERVAL);
        }
    })?;
    let mut first = Some(apart::next(&said, desk)??);
    Ok(move || {
        let mut bytes = first.take().unwrap_or_default();
        loop {
            match said.try_recv() {
                Ok(more) => bytes.extend(more?),
                Err(TryRecvError::Empty) => return Ok(bytes),
                Err(TryRecvError::Disconnected) => return Err(apart::broken_off()),
            }
        }
    })
}

/// The ring of a running board.
struct Ring {
    reached: Reached,
    head: u32,
    memory: Range<u32>,
}

impl Ring {
    /// The ring of the image `elf` on the chip of the wanted probe.
    fn of(elf: &Path, wanted: Option<&str>) -> Result<Self, Refusal> {
        let image = Image::read(elf)?;
        let chip = image.chip();
        let head = place(elf)?;
        let mut reached = Reached::by(wanted, chip)?;
        let table = image.pieces().first().map_or(&[][..], |piece| &piece.bytes);
        let table = &table[..table.len().min(VECTOR_TABLE_BYTES)];
        let mut there = vec![0; table.len()];
        reached.read(chip.flash.start, &mut there)?;
        if there != table {
            return Err(Refusal::new(
                format!("the board runs another image than {}", elf.display()),
                "give the image that runs there, or write this one: kband flash",
            ));
        }
        Ok(Self {
            reached,
            head,
            memory: chip.memory.clone(),
        })
    }

    /// The bytes since the last call; none while a board starts.
    fn take(&mut self) -> Result<Vec<u8>, Refusal> {
        let mut head = [0; HEADER_BYTES];
        self.reached.read(self.head, &mut head)?;
        let Some((parts, write)) = unread(&head, &self.memory) else {
            return Ok(Vec::new());
        };
        let mut taken = Vec::new();
        for part in parts.into_iter().filter(|part| !part.is_empty()) {
            let mut bytes = vec![0; part.len()];
            self.reached.read(part.start, &mut bytes)?;
            taken.extend(bytes);
        }
        if !taken.is_empty() {
            self.reached.set_word(self.head + READ_OFFSET, write)?;
        }
        Ok(taken)
    }
}

/// Addresses of the unread bytes, in one part or two, and the read position after them. `None` for
/// a header of no ring in `memory`.
fn unread(head: &[u8; HEADER_BYTES], memory: &Range<u32>) -> Option<([Range<u32>; 2], u32)> {
    let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let (buffer, size, write, read) = (word(28), word(32), word(36), word(40));
    let fits = head.starts_with(MARK)
        && size <= LONGEST_RING
        && write < size
        && read < size
        && memory.contains(&buffer)
        && size <= memory.end - buffer;
    let at = |offset: u32| buffer + offset;
    fits.then(|| {
        let parts = if read <= write {
            [at(read)..at(write), 0..0]
        } else {
            [at(read)..at(size), buffer..at(write)]
        };
        (parts, write)
    })
}

/// Address of an image's ring.
fn place(elf: &Path) -> Result<u32, Refusal> {
    let next = "build the board's image with: cargo feeder";
    let bytes = crate::file::read(elf, next)?;
    let find = || -> object::read::Result<Option<u32>> {
        let header = FileHeader32::<LittleEndian>::parse(&bytes[..])?;
        let endian = header.endian()?;
        let sections = header.sections(endian, &bytes[..])?;
        let symbols = sections.symbols(endian, &bytes[..], object::elf::SHT_SYMTAB)?;
        let ring = symbols
            .iter()
            .find(|symbol| symbol.name(endian, symbols.strings()) == Ok(NAME));
        Ok(ring.map(|symbol| symbol.st_value(endian)))
    };
    match find() {
        Ok(Some(head)) => Ok(head),
        Ok(None) => Err(Refusal::new(
            format!(
                "{}: this image keeps no log in memory, or was stripped of its names",
                elf.display()
            ),
            next,
        )),
        Err(error) => Err(Refusal::new(
            format!("{}: the file is damaged: {error}", elf.display()),
            next,
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MEMORY: Range<u32> = 0x2000_0000..0x2002_0000;

    fn head(buffer: u32, size: u32, write: u32, read: u32) -> [u8; HEADER_BYTES] {
        let mut head = [0; HEADER_BYTES];
        head[..MARK.len()].copy_from_slice(MARK);
        for (place, word) in head[28..44]
            .chunks_exact_mut(4)
            .zip([buffer, size, write, read])
        {
            place.copy_from_slice(&word.to_le_bytes());
        }
        head
    }

    #[test]
    fn unread_bytes_are_in_one_part_or_in_two() {
        let start = MEMORY.start;
        let parts = |write, read| unread(&head(start, 64, write, read), &MEMORY);
        assert_eq!(parts(5, 5), Some(([start + 5..start + 5, 0..0], 5)));
        assert_eq!(parts(9, 5), Some(([start + 5..start + 9, 0..0], 9)));
        assert_eq!(
            parts(3, 60),
            Some(([start + 60..start + 64, start..start + 3], 3))
        );
    }

    #[test]
    fn no_head_leads_out_of_the_memory() {
        let edges = [0, 1, 63, 64, 65_536, 65_537, 0x1fff_ffff, 0x2000_0000]
            .into_iter()
            .chain([0x2001_ffc0, 0x2001_ffc1, 0x2002_0000, 0x7fff_ffff, u32::MAX]);
        let edges: Vec<u32> = edges.collect();
        let mut taken = 0;
        for &buffer in &edges {
            for &size in &edges {
                for &write in &edges {
                    for &read in &edges {
                        let Some((parts, write)) =
                            unread(&head(buffer, size, write, read), &MEMORY)
                        else {
                            continue;
                        };
                        taken += 1;
                        assert!(write < size);
                        for part in parts.into_iter().filter(|part| !part.is_empty()) {
                            assert!(MEMORY.start <= part.start && part.end <= MEMORY.end);
                        }
                    }
                }
            }
        }
        assert!(taken > 20, "{taken}");
        let mut other = head(MEMORY.start, 64, 9, 5);
        other[3] = b'x';
        assert_eq!(unread(&other, &MEMORY), None);
    }
}
