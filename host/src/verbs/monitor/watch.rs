//! The log of a board beside its telemetry.

use std::path::{Path, PathBuf};

use crate::log::{Log, Words};
use crate::refusal::Refusal;

/// A log that is printed as it grows.
pub(super) struct Watch {
    log: Log<'static>,
    /// Removed with this.
    temporary: Option<PathBuf>,
}

impl Watch {
    /// The log in a file, written by the image `elf`.
    pub(super) fn recorded(elf: &Path, file: &Path) -> Result<Self, Refusal> {
        Self::open(elf, file)
    }

    /// A log that an emulated board is to write, running the image `elf`; and the file to write it into.
    pub(super) fn emulated(elf: &Path) -> Result<(Self, PathBuf), Refusal> {
        let name = format!("kband-{}.defmt", std::process::id());
        let file = std::env::temp_dir().join(name);
        std::fs::write(&file, []).map_err(|error| {
            Refusal::file(&file, &error, "check space and permissions of the folder")
        })?;
        let mut watch = Self::open(elf, &file)?;
        watch.temporary = Some(file.clone());
        Ok((watch, file))
    }

    fn open(elf: &Path, file: &Path) -> Result<Self, Refusal> {
        // One image a run of the program: what it says lives as long.
        let words = Box::leak(Box::new(Words::read(elf)?));
        Ok(Self {
            log: Log::open(file, words)?,
            temporary: None,
        })
    }

    /// The lines that were added since the last call.
    pub(super) fn lines(&mut self) -> Result<Vec<String>, Refusal> {
        self.log.lines()
    }

    /// Frames so far that could not be read.
    pub(super) fn unreadable(&self) -> u64 {
        self.log.unreadable()
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        if let Some(file) = &self.temporary {
            // Gone already is as good.
            let _ = std::fs::remove_file(file);
        }
    }
}
