//! Instruction counts by class of each call of a function, executed on the emulated core.

use std::path::Path;

use crate::chip::core::{Bus, COUNTER, Class, Code, Core, Fault, Flat, LINK};
use crate::images;

/// Semihosting operation (register 0 at a breakpoint) by which an image ends.
const EXIT: u32 = 0x18;

/// Instructions of each class, in the order of [`Class::ALL`].
pub type Counts = [u64; Class::ALL.len()];

/// Counts of each call of the functions with this name, in order, until the image ends.
///
/// # Panics
/// The image has no such function, or makes an access that is not allowed.
pub fn calls(image: &Path, function: &str) -> Vec<Counts> {
    let entries = images::places(image, function);
    assert!(!entries.is_empty(), "no {function} in {}", image.display());
    let segments = images::segments(image);
    let start = segments.first().expect("a segment with bytes").0;
    let mut flash = Vec::new();
    for (at, data) in segments {
        flash.resize((at - start) as usize, 0xff);
        flash.extend(data);
    }
    let mut memory = Flat::new(start, flash);
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
