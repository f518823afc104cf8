//! Instruction counts by class of each call of a function, executed on the emulated core.

use std::path::Path;

use crate::chip::core::{Bus, COUNTER, Class, Code, Core, Fault, LINK};
use crate::images;

/// First address of the RAM.
const MEMORY: u32 = 0x2000_0000;
/// Size of the RAM, bytes.
const MEMORY_SIZE: usize = 128 * 1024;
/// First address of the core's own peripherals. An image without interrupts does not need them:
/// reads return 0, writes have no effect.
const OWN: u32 = 0xe000_0000;
/// Semihosting operation (register 0 at a breakpoint) by which an image ends.
const EXIT: u32 = 0x18;

/// Instructions of each class, in the order of [`Class::ALL`].
pub type Counts = [u64; Class::ALL.len()];

/// Flash of the image, and RAM.
struct Flat {
    start: u32,
    flash: Vec<u8>,
    ram: Vec<u8>,
}

impl Flat {
    fn holding(image: &Path) -> Self {
        let segments = images::segments(image);
        let start = segments.first().expect("a segment with bytes").0;
        let mut flash = Vec::new();
        for (at, data) in segments {
            flash.resize((at - start) as usize, 0xff);
            flash.extend(data);
        }
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

/// Counts of each call of the functions with this name, in order, until the image ends.
///
/// # Panics
/// The image has no such function, or makes an access that is not allowed.
#[must_use]
pub fn calls(image: &Path, function: &str) -> Vec<Counts> {
    let entries = images::places(image, function);
    assert!(!entries.is_empty(), "no {function} in {}", image.display());
    let mut memory = Flat::holding(image);
    let start = memory.start;
    let vector = |memory: &mut Flat, at| memory.load(start + at, 4).expect("a vector");
    let (stack, entry) = (vector(&mut memory, 0), vector(&mut memory, 4));
    let (mut core, mut code) = (Core::default(), Code::default());
    core.reset(stack, entry);
    core.float = true;
    let mut counts: Vec<Counts> = Vec::new();
    let mut returns = None;
    loop {
        let at = core.r[COUNTER];
        if returns == Some(at) {
            returns = None;
        }
        if returns.is_none() && entries.iter().any(|place| place.start & !1 == at) {
            returns = Some(core.r[LINK] & !1);
            counts.push(Counts::default());
        }
        if returns.is_some()
            && let Some(counts) = counts.last_mut()
        {
            let half = |memory: &mut Flat, at| memory.fetch(at).unwrap_or_default();
            let class = Class::of(half(&mut memory, at), half(&mut memory, at + 2));
            let place = Class::ALL.iter().position(|(other, _)| *other == class);
            counts[place.expect("every class is listed")] += 1;
        }
        match core.step(&mut code, &mut memory) {
            Ok(_) => {}
            Err(Fault::Breakpoint) if core.r[0] == EXIT => return counts,
            // Its output is not needed: report all of it as written.
            Err(Fault::Breakpoint) => {
                core.r[0] = 0;
                core.r[COUNTER] += 2;
            }
            Err(fault) => panic!("{fault:?} at {at:#x}"),
        }
    }
}
