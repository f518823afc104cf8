//! Register of the files that this run reads and writes: no input and no output is overwritten.
//!
//! A file is identified by its canonical path. So `a.csv`, `./a.csv` and a symbolic link to it are
//! one file. A hard link is another: the output takes its name, and the input stays.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use crate::refusal::Refusal;

/// Every file of this process: its path, and for an output the [`Written`] that reserves it.
static USED: Mutex<Vec<(PathBuf, Option<Weak<()>>)>> = Mutex::new(Vec::new());

/// Reservation of a file for writing, until every copy of this is dropped.
#[derive(Clone, Debug)]
pub struct Written(#[expect(dead_code, reason = "it is held, not looked at")] Arc<()>);

/// The canonical path of a file; `None` for a pipe or a device, which cannot be overwritten.
fn place(path: &Path) -> Option<PathBuf> {
    if let Ok(data) = path.metadata() {
        return path.canonicalize().ok().filter(|_| data.is_file());
    }
    let folder = super::folder(path).canonicalize().ok()?;
    Some(folder.join(path.file_name()?))
}

/// Registers an input; refused if this run is about to write it.
pub fn reads(path: &Path) -> Result<(), Refusal> {
    let Some(place) = place(path) else {
        return Ok(());
    };
    let mut used = USED.lock().unwrap_or_else(PoisonError::into_inner);
    if used.iter().any(|other| other.0 == place && is_held(other)) {
        return Err(input_and_output(path));
    }
    used.push((place, None));
    Ok(())
}

/// Registers an output; refused if this run reads it or writes it already.
pub fn writes(path: &Path) -> Result<Written, Refusal> {
    let held = Arc::new(());
    if let Some(place) = place(path) {
        let mut used = USED.lock().unwrap_or_else(PoisonError::into_inner);
        for other in used.iter().filter(|other| other.0 == place) {
            if is_held(other) {
                return Err(Refusal::new(
                    format!("{} is named for two outputs of this run", path.display()),
                    "give each output a name of its own",
                ));
            }
            if other.1.is_none() {
                return Err(input_and_output(path));
            }
        }
        used.push((place, Some(Arc::downgrade(&held))));
    }
    Ok(Written(held))
}

fn is_held((_, written): &(PathBuf, Option<Weak<()>>)) -> bool {
    written.as_ref().is_some_and(|held| held.strong_count() > 0)
}

fn input_and_output(path: &Path) -> Refusal {
    Refusal::new(
        format!("{} is an input of this run and its output", path.display()),
        "give the output another name: an input is never written over",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_file_by_any_name_is_one_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.csv");
        let spelled = folder.path().join(".").join("a.csv");
        let first = writes(&file).unwrap();
        let refused = writes(&spelled).unwrap_err().to_string();
        assert!(refused.contains("two outputs"), "{refused}");
        assert!(reads(&spelled).is_err());
        let copy = first.clone();
        drop(first);
        assert!(writes(&file).is_err());
        drop(copy);
        drop(writes(&file).unwrap());

        std::fs::write(&file, "").unwrap();
        reads(&file).unwrap();
        reads(&spelled).unwrap();
        for name in [&file, &spelled] {
            let refused = writes(name).unwrap_err().to_string();
            assert!(refused.contains("an input of this run"), "{refused}");
        }
        #[cfg(unix)]
        {
            let link = folder.path().join("link.csv");
            std::os::unix::fs::symlink(&file, &link).unwrap();
            assert!(writes(&link).is_err());
            // A device may be input and output.
            let null = Path::new("/dev/null");
            let both = [writes(null).unwrap(), writes(null).unwrap()];
            reads(null).unwrap();
            drop(both);
        }
        drop(writes(&folder.path().join("b.csv")).unwrap());
    }
}
