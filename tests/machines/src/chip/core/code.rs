//! Cache of decoded instructions by address.
//!
//! Each instruction is decoded once. Entries of the flash are valid until [`Code::forget`]; entries
//! of the RAM are compared with its content, which any store may change.

use std::ops::Range;
use std::sync::Arc;

use super::op::Op;
use super::{Bus, Fault, decode};

/// First address of the flash (RM0090, 2.3).
const FLASH: u32 = 0x0800_0000;
/// Size of the flash, bytes.
const FLASH_SIZE: u32 = 1024 * 1024;
const MEMORY: u32 = 0x2000_0000;
const MEMORY_SIZE: u32 = 128 * 1024;
/// Number of address bits in a page.
const PAGE_BITS: u32 = 11;
/// Number of instructions in a page, one per halfword.
const PAGE: usize = 1 << (PAGE_BITS - 1);
/// Number of pages of the flash; those of the RAM follow.
const FLASH_PAGES: usize = (FLASH_SIZE >> PAGE_BITS) as usize;

/// A decoded instruction and its bytes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Decoded {
    pub(super) op: Op,
    halves: [u16; 2],
    wide: bool,
}

impl Decoded {
    #[inline]
    pub(super) fn size(&self) -> u32 {
        if self.wide { 4 } else { 2 }
    }

    fn read(bus: &mut impl Bus, address: u32) -> Result<Self, Fault> {
        let first = bus.fetch(address).ok_or(Fault::Fetch)?;
        let wide = decode::is_wide(first);
        let second = if wide {
            bus.fetch(address.wrapping_add(2)).ok_or(Fault::Fetch)?
        } else {
            0
        };
        Ok(Self {
            op: decode::decode(first, second),
            halves: [first, second],
            wide,
        })
    }

    /// Whether memory still holds it; only RAM is checked.
    #[inline]
    pub(super) fn is_unchanged(&self, bus: &mut impl Bus, address: u32) -> bool {
        address.wrapping_sub(FLASH) < FLASH_SIZE
            || bus.fetch(address) == Some(self.halves[0])
                && (!self.wide || bus.fetch(address.wrapping_add(2)) == Some(self.halves[1]))
    }
}

type Page = [Option<Decoded>; PAGE];

/// Decoded instructions of a program. Copies share them until one of them adds more.
#[derive(Clone, Debug)]
pub struct Code {
    pages: Vec<Option<Arc<Page>>>,
    /// An instruction outside flash and RAM.
    elsewhere: Option<Decoded>,
}

impl Default for Code {
    fn default() -> Self {
        Self {
            pages: vec![None; FLASH_PAGES + (MEMORY_SIZE >> PAGE_BITS) as usize],
            elsewhere: None,
        }
    }
}

impl Code {
    /// Drops the instructions of a changed part of the flash.
    pub fn forget(&mut self, changed: &Range<u32>) {
        // An instruction may begin two bytes earlier.
        let first = changed.start.saturating_sub(2).max(FLASH);
        for address in (first & !((1 << PAGE_BITS) - 1)..changed.end).step_by(1 << PAGE_BITS) {
            if let Some(known) = self.pages.get_mut(page(address)) {
                *known = None;
            }
        }
    }

    /// The cached instruction at an address. In RAM it must be compared with memory.
    #[inline]
    pub(super) fn find(&self, address: u32) -> Option<&Decoded> {
        let page = self.pages.get(page(address))?.as_ref()?;
        page[place(address)].as_ref()
    }

    /// Decodes the instruction at an address.
    #[cold]
    pub(super) fn decode_at(
        &mut self,
        bus: &mut impl Bus,
        address: u32,
    ) -> Result<&Decoded, Fault> {
        let known = Decoded::read(bus, address)?;
        let Some(page) = self.pages.get_mut(page(address)) else {
            return Ok(self.elsewhere.insert(known));
        };
        let page = page.get_or_insert_with(|| Arc::new([None; PAGE]));
        Ok(Arc::make_mut(page)[place(address)].insert(known))
    }
}

#[inline]
fn page(address: u32) -> usize {
    let [flash, memory] = [FLASH, MEMORY].map(|start| address.wrapping_sub(start));
    if flash < FLASH_SIZE {
        (flash >> PAGE_BITS) as usize
    } else if memory < MEMORY_SIZE {
        FLASH_PAGES + (memory >> PAGE_BITS) as usize
    } else {
        usize::MAX
    }
}

#[inline]
fn place(address: u32) -> usize {
    (address >> 1) as usize % PAGE
}
