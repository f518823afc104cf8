//! Inputs of the desk: files that a user wrote, recorded, built or received.

use crate::Reader;
use crate::frames::framed;
use kband::feeder::OutOfRange;
use kband::impact::{Integer, Kernel, Map};
use kband_control::wire::{Identity, MAX_FRAME_BYTES, SCHEMA, VERSION, write_identity};
use kband_control::{Recipe, RecipeName};
use kband_host::board::replay;
use kband_host::chip::Image;
use kband_host::refusal::Refusal;
use kband_host::simulate::SceneFile;
use kband_host::verbs::board::recipe::{Entry, export};
use kband_host::verbs::board::settings::Imported;
use kband_host::verbs::map::impacts::rows::{Row, check_rows, compute_rows};
use kband_plant::{ClosedLoop, EnvelopeLoop};
use std::path::Path;

/// Words of a scene.
pub const SCENE: &str = "[track]|[part]|[drive]|[target]|[expect]|[[disturbance]]|frequency = |\
    restitution = [0.1, 0.3]|scatter = 0.1|count = 3|locked = 1|gear = 1|k = 0.41|at = 1.0|gain = |\
    quality = 200.0";
/// Words of a settings file.
pub const SETTINGS: &str = "frequency = |1e400|inf|[a]\n|\"\"\"";
/// Words of a recipes file.
pub const RECIPES: &str =
    "recipes = |\n[[recipe]]\n|number = 1|name = |target = \"gear\"|value = |inf";
/// Words of a table of launches.
pub const ROWS: &str = "k,restitution,phase,velocity|\n|,|1e16|0x1p3|-0";
/// Words of an image.
pub const ELF: &str = "stm32f405rg|stm32g474re|.chip|.vector_table";

/// Largest length of a readable message, bytes.
const MAX_MESSAGE_BYTES: usize = 10_000;

/// The accepted value; a refusal must be one readable message.
fn accepted<T>(read: Result<T, Refusal>) -> Option<T> {
    let check = |refusal: Refusal| {
        let message = refusal.to_string();
        assert!(message.len() < MAX_MESSAGE_BYTES, "{} bytes", message.len());
        assert!(message.starts_with("error: ") && message.contains("next: "));
        assert_eq!(refusal.status(), 2);
    };
    read.map_err(check).ok()
}

fn text<T>(input: &[u8], read: impl FnOnce(&str) -> Result<T, Refusal>) -> Option<T> {
    accepted(read(std::str::from_utf8(input).ok()?))
}

/// A scene: parsed, and started at both fidelities.
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

/// Recipes of a file with their numbers; export and import must return the same ones.
pub fn recipes(input: &[u8]) -> Vec<(u8, RecipeName, Recipe)> {
    let read = |text: &str| {
        let entries = Entry::parse(text)?.into_iter();
        let entries = entries.map(|entry| (entry.number, entry.name, entry.recipe));
        Ok(entries.collect::<Vec<_>>())
    };
    let entries = text(input, read).unwrap_or_default();
    if !entries.is_empty() {
        let reread = read(&export(&entries, "fuzzed")).expect("an export");
        assert_eq!(format!("{reread:?}"), format!("{entries:?}"));
    }
    entries
}

/// Flies the launches of a checked table.
fn launches<K: Kernel>(input: &[u8], build: fn(f64, f64) -> Result<K, OutOfRange>) {
    let mut count = 0;
    let each = |row: Option<Row<K>>| {
        if let Some(row) = row.filter(|_| count < 16) {
            count += 1;
            assert!(row.kernel.impact(row.state).flight >= 0.0);
        }
        Ok(())
    };
    compute_rows(Path::new(LAUNCHES), input, build, each).expect("a checked table is read again");
}

const LAUNCHES: &str = "launches.csv";

/// A table of launches, in the arithmetics with the widest and the narrowest range.
pub fn rows(input: &[u8]) -> bool {
    let is_table = check_rows(Path::new(LAUNCHES), input, |_| Ok(())).is_ok();
    if is_table {
        launches::<Map>(input, Map::build);
        launches::<Integer>(input, Integer::build);
    }
    is_table
}

/// A record of a board's output: raw bytes, or, after a 0, messages in valid frames.
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
        let mut messages = Reader(messages);
        while let Some(message) = messages.piece() {
            bytes.extend(framed(0, message).unwrap_or_default());
        }
    }
    let damage = replay(&*bytes, |_| {
        count += 1;
        Ok(true)
    });
    let damage = accepted(damage);
    if let Some(damage) = &damage {
        assert!(count + damage.unreadable <= bytes.len() as u64);
        assert!(damage.cut <= bytes.len() as u64);
    }
    damage.is_some()
}

/// An image for a board.
pub fn elf(input: &[u8]) -> bool {
    let image = accepted(Image::parse(input));
    if let Some(image) = &image {
        let chip = image.chip;
        let written: u32 = chip.sectors().map(|s| image.bytes_in(&s.range)).sum();
        assert_eq!(written, image.size(), "each byte lies in one sector");
        assert!(image.memory <= chip.memory.end - chip.memory.start);
        for piece in &image.pieces {
            let end = piece.address + piece.bytes.len() as u32;
            assert!(chip.flash.start <= piece.address && end <= chip.flash.end);
            let is_free = end <= chip.settings.start || chip.settings.end <= piece.address;
            assert!(is_free, "the settings stay");
        }
    }
    image.is_some()
}
