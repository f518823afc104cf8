//! Replacement of a board's log in a kband built without it.

use std::convert::Infallible;
use std::fs::File;
use std::path::{Path, PathBuf};

use crate::desk::Desk;
use crate::refusal::Refusal;

pub(super) struct Watch(Infallible);

impl Watch {
    pub(super) fn recorded(_elf: &Path, _file: &Path) -> Result<Self, Refusal> {
        Err(missing())
    }

    pub(super) fn probed(_: &Path, _: Option<&str>, _: &Desk) -> Result<Self, Refusal> {
        Err(missing())
    }

    pub(super) fn emulated(_elf: &Path) -> Result<(Self, PathBuf), Refusal> {
        Err(missing())
    }

    pub(super) fn record(&mut self, _file: File) {
        match self.0 {}
    }

    pub(super) fn lines(&mut self) -> Result<Vec<String>, Refusal> {
        match self.0 {}
    }

    pub(super) fn unreadable(&self) -> u64 {
        match self.0 {}
    }
}

fn missing() -> Refusal {
    Refusal::new(
        "this kband was built without the log of a board",
        "install it with: cargo install --path host --features log",
    )
}
