//! Inputs of the desk: files that a user wrote, recorded, built or received.

use std::path::Path;

use kband::feeder::OutOfRange;
use kband::impact::{Integer, Kernel, Map};
use kband_control::wire::{Identity, MAX_FRAME_BYTES, SCHEMA, VERSION, write_identity};
use kband_control::{Recipe, RecipeName};
use kband_host::board::replay;
use kband_host::chip::Image;
use kband_host::refusal::Refusal;
use kband_host::simulate::SceneFile;
use kband_host::verbs::impacts::rows::{Row, check_rows, fly_rows};
use kband_host::verbs::recipe::{Entry, export};
use kband_host::verbs::settings::Imported;
use kband_plant::{ClosedLoop, EnvelopeLoop};

use crate::Taker;
use crate::frames::framed;

/// Dictionary of a scene.
pub const SCENE: &[&[u8]] = &[
    b"[track]",
    b"[part]",
    b"[drive]",
    b"[target]",
    b"[expect]",
    b"[[disturbance]]",
    b"frequency = ",
    b"restitution = [0.1, 0.3]",
    b"scatter = 0.1",
    b"count = 3",
    b"locked = 1",
    b"gear = 1",
    b"k = 0.41",
    b"at = 1.0",
    b"gain = ",
    b"quality = 200.0",
];
/// Dictionary of a settings file.
pub const SETTINGS: &[&[u8]] = &[b"frequency = ", b"1e400", b"inf", b"[a]\n", b"\"\"\""];
/// Dictionary of a recipes file.
pub const RECIPES: &[&[u8]] = &[
    b"recipes = ",
    b"\n[[recipe]]\n",
    b"number = 1",
    b"name = ",
    b"target = \"gear\"",
    b"value = ",
    b"inf",
];
/// Dictionary of a table of launches.
pub const ROWS: &[&[u8]] = &[
    b"k,restitution,phase,velocity",
    b"\n",
    b",",
    b"1e16",
    b"0x1p3",
    b"-0",
];
/// Dictionary of an image.
pub const ELF: &[&[u8]] = &[b"stm32f405rg", b"stm32g474re", b".chip", b".vector_table"];

/// Length in bytes: longest message for a person.
const READABLE: usize = 10_000;

/// What was accepted; a refusal is one readable message.
fn accepted<T>(read: Result<T, Refusal>) -> Option<T> {
    let check = |refusal: Refusal| {
        let message = refusal.to_string();
        assert!(message.len() < READABLE, "{} bytes", message.len());
        assert!(message.starts_with("error: ") && message.contains("next: "));
        assert_eq!(refusal.status(), 2);
    };
    read.map_err(check).ok()
}

fn text<T>(input: &[u8], read: impl FnOnce(&str) -> Result<T, Refusal>) -> Option<T> {
    accepted(read(std::str::from_utf8(input).ok()?))
}

/// A scene: parsed, and started in both fidelities.
pub fn scene(input: &[u8]) -> bool {
    let Some(file) = text(input, SceneFile::parse) else {
        return false;
    };
    if let Ok(mut envelope) = EnvelopeLoop::build(&file.scene) {
        for _ in 0..20 {
            let report = envelope.cycle().report;
            assert!((0.0..=1.0).contains(&report.command.amplitude));
        }
    }
    if let Ok(mut waveform) = ClosedLoop::build(&file.scene) {
        waveform.cycle();
    }
    true
}

/// A file of settings.
pub fn settings(input: &[u8]) -> bool {
    text(input, Imported::parse).is_some()
}

/// The recipes of a file, each with its number; exported and read again they are the same.
pub fn recipes(input: &[u8]) -> Vec<(u8, RecipeName, Recipe)> {
    let read = |text: &str| {
        let entries = Entry::parse(text)?.into_iter();
        Ok(entries
            .map(|entry| (entry.number, entry.name, entry.recipe))
            .collect::<Vec<_>>())
    };
    let entries = text(input, read).unwrap_or_default();
    if !entries.is_empty() {
        let again = read(&export(&entries, "fuzzed"));
        assert_eq!(
            format!("{:?}", again.expect("an export")),
            format!("{entries:?}")
        );
    }
    entries
}

fn launches<K: Kernel>(input: &[u8], build: fn(f64, f64) -> Result<K, OutOfRange>) -> bool {
    let path = Path::new("launches.csv");
    if check_rows(path, input, build, |_| Ok(())).is_err() {
        return false;
    }
    let fly = |rows: &mut Vec<Option<Row<K>>>| {
        for row in rows.iter().flatten().take(16) {
            let impact = row.kernel.impact(row.state);
            assert!(impact.flight >= 0.0);
        }
        Ok(())
    };
    fly_rows(path, input, build, fly).expect("what was checked is read again");
    true
}

/// A table of launches, in the arithmetics with the widest and the narrowest range.
pub fn rows(input: &[u8]) -> bool {
    let double = launches::<Map>(input, Map::build);
    let integer = launches::<Integer>(input, Integer::build);
    assert!(
        double || !integer,
        "what is no launch is none in any arithmetic"
    );
    double
}

/// A record of a board's output: raw bytes, or after a 0 messages in valid frames.
pub fn record(input: &[u8]) -> bool {
    let mut count = 0_u64;
    let mut bytes = input.to_vec();
    if let Some((0, messages)) = input.split_first() {
        let identity = Identity {
            version: VERSION,
            schema: SCHEMA,
            image: "kband fuzzed",
        };
        let mut buffer = [0; MAX_FRAME_BYTES];
        bytes = write_identity(&mut buffer, 0, &identity).map_or(Vec::new(), <[u8]>::to_vec);
        let mut messages = Taker(messages);
        while let Some(message) = messages.piece() {
            bytes.extend(framed(0, message).unwrap_or_default());
        }
    }
    let remains = replay(&*bytes, |_| {
        count += 1;
        Ok(true)
    });
    let remains = accepted(remains);
    if let Some(remains) = &remains {
        assert!(count + remains.unreadable <= bytes.len() as u64);
        assert!(remains.cut <= bytes.len() as u64);
    }
    remains.is_some()
}

/// An image for a board.
pub fn elf(input: &[u8]) -> bool {
    let image = accepted(Image::parse(input));
    if let Some(image) = &image {
        let written: u32 = image.chip().sectors().map(|s| image.bytes_in(&s)).sum();
        assert_eq!(written, image.size(), "each byte lies in one sector");
        let free = image.chip().memory.end - image.chip().memory.start;
        assert!(image.memory() <= free);
    }
    image.is_some()
}
