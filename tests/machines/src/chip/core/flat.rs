//! Memory for a core alone: a flash and a RAM, without peripherals.

use super::Bus;

/// First address of the RAM.
const MEMORY: u32 = 0x2000_0000;
/// Size of the RAM, bytes.
const MEMORY_SIZE: usize = 128 * 1024;
/// First address of the core's own peripherals: reads return 0, writes have no effect.
const OWN: u32 = 0xe000_0000;

/// Flash from an address on, and RAM.
#[derive(Clone, Debug)]
pub struct Flat {
    start: u32,
    flash: Vec<u8>,
    /// RAM from 0x2000_0000 on.
    pub ram: Vec<u8>,
}

impl Flat {
    /// Builds the memory with this content of the flash.
    pub fn new(start: u32, flash: Vec<u8>) -> Self {
        Self {
            start,
            flash,
            ram: vec![0; MEMORY_SIZE],
        }
    }

    fn at(&mut self, address: u32, size: u32) -> Option<&mut [u8]> {
        let (bytes, at) = if address < MEMORY {
            (&mut self.flash, address.checked_sub(self.start)?)
        } else {
            (&mut self.ram, address - MEMORY)
        };
        bytes.get_mut(at as usize..(at + size) as usize)
    }
}

impl Bus for Flat {
    fn load(&mut self, address: u32, size: u32) -> Option<u32> {
        if address >= OWN {
            return Some(0);
        }
        let bytes = self.at(address, size)?.iter().rev();
        Some(bytes.fold(0, |word, byte| word << 8 | u32::from(*byte)))
    }

    fn store(&mut self, address: u32, size: u32, value: u32) -> Option<()> {
        if address < OWN {
            let bytes = &value.to_le_bytes()[..size as usize];
            self.at(address, size)?.copy_from_slice(bytes);
        }
        Some(())
    }
}
