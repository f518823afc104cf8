//! What the tests run programs on: an emulated CPU, a chip on a board and before a debug probe, a terminal, a browser; and the
//! images for them. The desk's tests use it as the tests that cross crates do; it knows of the desk nothing.

pub mod browser;
pub mod chip;
pub mod count;
pub mod draw;
pub mod emulator;
pub mod hazards;
pub mod images;
pub mod log;
pub mod probe;
pub mod rig;
pub mod terminal;

use std::path::{Path, PathBuf};

/// The workspace's folder.
#[must_use]
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .ancestors()
        .nth(2)
        .expect("tests/machines lies in the workspace")
        .into()
}
