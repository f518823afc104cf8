//! Machines for the tests: an emulated CPU, a chip on a board and behind a debug probe, a terminal,
//! a browser, and the images. The desk's tests and the tests across crates use it. It does not
//! depend on the desk.
// Tests alone use it: a name that says all needs no comment.
#![allow(missing_docs)]

pub mod browser;
pub mod bus;
pub mod chip;
pub mod draw;
pub mod emulator;
pub mod hazards;
pub mod images;
pub mod probe;
pub mod rig;
pub mod terminal;

use std::path::{Path, PathBuf};

pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .ancestors()
        .nth(2)
        .expect("tests/machines lies in the workspace")
        .into()
}
