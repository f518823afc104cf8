//! What the cross-crate tests share: the emulator and the images that run on it, launches that try
//! a kernel and the oracle that judges it.

pub mod broken;
pub mod certificate;
pub mod chip;
pub mod day;
pub mod desk;
pub mod emulator;
pub mod footprint;
pub mod images;
pub mod oracle;
pub mod probe;
pub mod rig;
pub mod soak;
pub mod states;
pub mod terminal;
pub mod tones;
pub mod verdict;

use std::path::{Path, PathBuf};

/// The workspace's folder.
#[must_use]
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("tests/ lies in the workspace")
        .into()
}
