//! No sample and no frame can reach a panic. The list contains the functions of the board's image
//! that call one.
//!
//! Reasons why a listed call is never reached, by its module:
//!
//! - `bin/`, `cortex`, `bus/uart`: before the first sample. A board that does not start stays off.
//! - `last_words` and `core`'s formatting: while the last words are stored, with the drive off.
//! - `journal`, `store`, sequential-storage: the memory of the settings, used at rest only.
//! - `stm32`, Embassy: registers and buffers of the chip, whose types guarantee the ranges.
//! - `exchange`, `link`, `bus`: a finished task is not polled again. `station`: a borrow for one call.
//! - defmt: a log within a log.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;

use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};

use kband_tests::emulator::Machine;
use kband_tests::images;

/// Whether a function's mangled name is that of a panic.
fn panics(name: &str) -> bool {
    let parts = "9panicking 13unwrap_failed 13expect_failed 16slice_index_fail 20panic_already";
    parts.split(' ').any(|part| name.contains(part))
        || (name.contains("panic_already") && name.contains("4cell"))
}

/// Target of a Thumb branch: BL, or B with 24 bits (ARMv7-M, A7.7.12 and A7.7.18).
fn branch(at: u32, first: u16, second: u16) -> Option<u32> {
    if first >> 11 != 0b11110 || second & 0x9000 != 0x9000 {
        return None;
    }
    let sign = u32::from(first >> 10 & 1);
    let bit = |place: u16| u32::from(second >> place & 1) ^ sign ^ 1;
    let offset = sign << 24
        | bit(13) << 23
        | bit(11) << 22
        | u32::from(first & 0x3ff) << 12
        | u32::from(second & 0x7ff) << 1;
    let offset = ((offset << 7) as i32) >> 7;
    Some(at.wrapping_add(4).wrapping_add_signed(offset))
}

/// Functions of an image by address: name without the compiler's hash, and called functions. Calls
/// through a pointer are missing.
fn calls(image: &Path) -> BTreeMap<u32, (String, Vec<u32>)> {
    let bytes = std::fs::read(image).unwrap();
    let file = object::File::parse(&*bytes).unwrap();
    let functions: BTreeMap<u32, (u32, String)> = file
        .symbols()
        .filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.size() > 0)
        .map(|symbol| {
            let name = symbol.name().unwrap();
            let short = name.rsplit_once("17h").map_or(name, |(short, _)| short);
            let begin = symbol.address() as u32 & !1;
            (begin, (symbol.size() as u32, short.to_string()))
        })
        .collect();
    let text = file.section_by_name(".text").unwrap();
    let (code, start) = (text.data().unwrap(), text.address() as u32);
    let half = |at: u32| {
        let at = (at - start) as usize;
        code.get(at..at + 2)
            .map(|half| u16::from_le_bytes([half[0], half[1]]))
    };
    let mut calls = BTreeMap::new();
    for (&begin, (size, name)) in functions.range(start..) {
        let targets = (begin..begin + size)
            .step_by(2)
            .filter_map(|at| branch(at, half(at)?, half(at + 2)?))
            .filter(|target| *target != begin && functions.contains_key(target));
        calls.insert(begin, (name.clone(), targets.collect()));
    }
    calls
}

/// The committed list of functions that call a panic, with counts, so that review shows a new one.
#[test]
fn the_functions_that_may_panic_are_the_listed_ones() {
    let image = images::build("kband-firmware", "feeder", Machine::CortexM4F);
    let calls = calls(&image);
    let mut counts = BTreeMap::new();
    for (name, targets) in calls.values().filter(|(name, _)| !panics(name)) {
        let sites = targets.iter().filter(|target| panics(&calls[target].0));
        *counts.entry(name).or_insert(0) += sites.count();
    }
    let mut list = String::new();
    counts.retain(|_, sites| *sites > 0);
    for (name, sites) in &counts {
        writeln!(list, "{sites} {name}").unwrap();
    }
    let (calls, functions) = (counts.values().sum::<usize>(), counts.len());
    println!("panics left: {calls} calls in {functions} functions");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("reference/panics.txt");
    if std::env::var_os("KBAND_ACCEPT").is_some() {
        std::fs::write(&path, &list).unwrap();
    }
    let accepted = std::fs::read_to_string(&path).unwrap();
    assert_eq!(list, accepted, "see it through, then KBAND_ACCEPT=1");
}

#[test]
fn no_panic_can_be_reached_from_the_sample_interrupt() {
    let image = images::build("kband-firmware", "feeder", Machine::CortexM4F);
    let calls = calls(&image);
    let sample = calls.iter().find(|(_, (name, _))| name == "ADC");
    let mut left = vec![*sample.expect("the sample interrupt").0];
    let mut reached = BTreeSet::new();
    while let Some(at) = left.pop() {
        if reached.insert(at) {
            left.extend(&calls[&at].1);
        }
    }
    let names: Vec<&str> = reached.iter().map(|at| calls[at].0.as_str()).collect();
    println!("reached from a sample: {names:?}");
    let sample = "6signal6Signal14process_sample";
    assert!(names.iter().any(|name| name.contains(sample)));
    assert!(!names.iter().any(|name| panics(name)), "{names:?}");
}
