//! Fuzz targets: all external inputs of kband, as functions of arbitrary bytes.
//!
//! Each target panics on a failure and returns whether it accepted its input. `tests/inputs.rs`
//! replays the corpus and mutations from a seeded [`Mutator`] in every test run.
//! `tests/fuzz/run.sh` runs coverage-guided fuzzing with libFuzzer and the address sanitizer, for a
//! given time.

use std::path::{Path, PathBuf};

pub mod board;
pub mod bus;
pub mod desk;
pub mod frames;
pub mod mutate;
pub mod store;

pub use mutate::Mutator;

/// One input of kband.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Name of the target and of its corpus folder.
    pub name: &'static str,
    /// Processes an input; returns whether any of it was valid.
    pub run: fn(&[u8]) -> bool,
    /// Number of mutated inputs in a short run, which takes 1 or 2 s on a busy machine.
    pub short: u32,
    /// Words in its inputs, separated by `|`.
    pub words: &'static str,
}

/// All targets.
pub const TARGETS: &[Target] = &[
    target("scene", desk::scene, 3000, desk::SCENE),
    target("settings", desk::settings, 40_000, desk::SETTINGS),
    target("recipes", board::recipes, 5000, desk::RECIPES),
    target("rows", desk::rows, 40_000, desk::ROWS),
    target("record", desk::record, 40_000, ""),
    target("elf", desk::elf, 40_000, desk::ELF),
    target("frames", frames::frames, 200_000, frames::WORDS),
    target("bus", bus::bus, 100_000, bus::WORDS),
    target("service", board::service, 10_000, board::WORDS),
    target("store", store::store, 3000, ""),
];

const fn target(
    name: &'static str,
    run: fn(&[u8]) -> bool,
    short: u32,
    words: &'static str,
) -> Target {
    Target {
        name,
        run,
        short,
        words,
    }
}

impl Target {
    /// The target with this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        TARGETS.iter().find(|target| target.name == name)
    }

    /// Folder of the corpus.
    pub fn folder(&self) -> PathBuf {
        let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
        corpus.join(self.name)
    }

    /// The corpus, sorted by file name; it includes the test scenes. It panics if the folder cannot
    /// be read.
    pub fn corpus(&self) -> Vec<Vec<u8>> {
        let mut files = Vec::new();
        let scenes = (self.name == "scene").then(|| self.folder().join("../../../scenes"));
        for folder in [self.folder()].into_iter().chain(scenes) {
            let entries = std::fs::read_dir(folder).expect("every target has a corpus");
            files.extend(entries.flatten().map(|entry| entry.path()));
        }
        files.sort();
        let read = |file: PathBuf| std::fs::read(file).expect("a file of the corpus is read");
        files.into_iter().map(read).collect()
    }

    /// Inputs found by coverage-guided fuzzing, as packed by `keep.py`. It panics if the file cannot
    /// be read or is incomplete.
    pub fn saved_inputs(&self) -> Vec<Vec<u8>> {
        let file = self.folder().join("../../found").join(self.name);
        let rest = std::fs::read(file).expect("every target has what was found");
        let mut rest = rest.into_iter();
        let mut inputs = Vec::new();
        while let Some(low) = rest.next() {
            let high = rest.next().expect("a length of two bytes");
            let length = usize::from(u16::from_le_bytes([low, high]));
            let input: Vec<u8> = rest.by_ref().take(length).collect();
            assert_eq!(input.len(), length, "{}: cut short", self.name);
            inputs.push(input);
        }
        inputs
    }
}

/// Parses numbers from an input; `None` at its end.
#[derive(Clone, Copy, Debug)]
pub struct Reader<'a>(pub &'a [u8]);

impl<'a> Reader<'a> {
    /// The next byte.
    pub fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(*first)
    }

    /// The next two bytes.
    pub fn half(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes([self.byte()?, self.byte()?]))
    }

    /// A piece whose length is the next byte, or the rest.
    pub fn piece(&mut self) -> Option<&'a [u8]> {
        let length = usize::from(self.byte()?).min(self.0.len());
        let (piece, rest) = self.0.split_at(length);
        self.0 = rest;
        Some(piece)
    }
}
