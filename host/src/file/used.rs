//! The files that this run reads and writes, by their canonical paths: no input or output is
//! written over. A hard link counts as another file: the output replaces it, and the input remains.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::refusal::{Refusal, Result};

#[derive(Clone, Copy, PartialEq)]
pub enum Role {
    Input,
    Output,
}

static USED: Mutex<Vec<(PathBuf, Role)>> = Mutex::new(Vec::new());

/// The canonical path of a file; `None` for a pipe or a device, which cannot be overwritten.
fn place(path: &Path) -> Option<PathBuf> {
    if let Ok(data) = path.metadata() {
        return path.canonicalize().ok().filter(|_| data.is_file());
    }
    let folder = super::folder(path).canonicalize().ok()?;
    Some(folder.join(path.file_name()?))
}

/// Registers a file; refuses an input that this run writes, and an output that it already reads or
/// writes.
pub fn add(path: &Path, role: Role) -> Result<()> {
    let Some(place) = place(path) else {
        return Ok(());
    };
    let mut used = USED.lock().unwrap_or_else(PoisonError::into_inner);
    let other = used.iter().find(|(other, _)| *other == place);
    let (what, next) = match other.map(|(_, other)| (*other, role)) {
        None | Some((Role::Input, Role::Input)) => {
            used.push((place, role));
            return Ok(());
        }
        Some((Role::Output, Role::Output)) => (
            "named for two outputs of this run",
            "give each output a name of its own",
        ),
        Some(_) => (
            "an input of this run and its output",
            "give the output another name: an input is never overwritten",
        ),
    };
    Err(Refusal::new(format!("{} is {what}", path.display()), next))
}
