//! The log of a board, printed beside its telemetry.

use std::fs::File;
use std::path::{Path, PathBuf};

use crate::desk::Desk;
use crate::log::{Log, Words};
use crate::refusal::Refusal;

/// A log that is printed as it grows.
pub(super) struct Watch {
    log: Log<'static>,
    /// Temporary file, removed at the end.
    temporary: Option<PathBuf>,
}

impl Watch {
    /// The log in a file, written by the image `elf`.
    pub(super) fn recorded(elf: &Path, file: &Path) -> Result<Self, Refusal> {
        Log::open(file, words(elf)?).map(Self::of)
    }

    /// The log of the board on the wanted probe, which runs the image `elf`.
    #[cfg(feature = "flash")]
    pub(super) fn probed(elf: &Path, wanted: Option<&str>, desk: &Desk) -> Result<Self, Refusal> {
        let words = words(elf)?;
        let more = crate::chip::follow(elf, wanted, desk)?;
        Ok(Self::of(Log::new(Box::new(more), words)))
    }

    /// Refused: kband was built without support for probes.
    #[cfg(not(feature = "flash"))]
    pub(super) fn probed(_: &Path, _: Option<&str>, _: &Desk) -> Result<Self, Refusal> {
        Err(Refusal::new(
            "this kband was built without support for debug probes",
            "install it with: cargo install --path host --features flash",
        ))
    }

    /// The log of an emulated board with the image `elf`, and the file that it will be written to.
    pub(super) fn emulated(elf: &Path) -> Result<(Self, PathBuf), Refusal> {
        let name = format!("kband-{}.defmt", std::process::id());
        let file = std::env::temp_dir().join(name);
        std::fs::write(&file, []).map_err(|error| {
            Refusal::file(&file, &error, "check space and permissions of the folder")
        })?;
        let mut watch = Self::recorded(elf, &file)?;
        watch.temporary = Some(file.clone());
        Ok((watch, file))
    }

    fn of(log: Log<'static>) -> Self {
        Self {
            log,
            temporary: None,
        }
    }

    /// From now on writes the received bytes to a file.
    pub(super) fn record(&mut self, file: File) {
        self.log.record(file);
    }

    /// The lines since the last call.
    pub(super) fn lines(&mut self) -> Result<Vec<String>, Refusal> {
        self.log.lines()
    }

    /// Number of unreadable frames so far.
    pub(super) fn unreadable(&self) -> u64 {
        self.log.unreadable()
    }
}

/// Format strings of the image `elf`. A run has one image, so they live until its end.
fn words(elf: &Path) -> Result<&'static Words, Refusal> {
    Ok(Box::leak(Box::new(Words::read(elf)?)))
}

impl Drop for Watch {
    fn drop(&mut self) {
        if let Some(file) = &self.temporary {
            // A missing file is no failure.
            let _ = std::fs::remove_file(file);
        }
    }
}
