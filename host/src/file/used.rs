//! Register of the files that this run reads and writes: no input and no output is overwritten.
//!
//! A file is identified by its canonical path, or by device and inode. So `a.csv`, `./a.csv`, a
//! symbolic link and a hard link to it are one file.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use crate::refusal::Refusal;

/// Every file of this process, in order of registration.
static USED: Mutex<Vec<Used>> = Mutex::new(Vec::new());

struct Used {
    place: Place,
    /// Refers to the [`Written`] of an output, and is dead after that; `None` for an input.
    written: Option<Weak<()>>,
}

/// Reservation of a file for writing, until every copy of this is dropped.
#[derive(Clone, Debug)]
pub struct Written(#[expect(dead_code, reason = "it is held, not looked at")] Arc<()>);

/// A file on this machine.
#[derive(Debug, PartialEq)]
struct Place {
    path: PathBuf,
    /// Device and inode of a file that exists.
    file: Option<(u64, u64)>,
}

impl Place {
    /// The place of `path`; `None` for a pipe or a device, which cannot be overwritten.
    fn of(path: &Path) -> Option<Self> {
        if let Ok(data) = path.metadata() {
            let path = path.canonicalize().ok()?;
            return data.is_file().then(|| Self {
                path,
                file: identity(&data),
            });
        }
        let folder = super::folder(path).canonicalize().ok()?;
        Some(Self {
            path: folder.join(path.file_name()?),
            file: None,
        })
    }

    fn is(&self, other: &Self) -> bool {
        self.path == other.path || (self.file.is_some() && self.file == other.file)
    }
}

#[cfg(unix)]
fn identity(data: &std::fs::Metadata) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    Some((data.dev(), data.ino()))
}

#[cfg(not(unix))]
fn identity(_data: &std::fs::Metadata) -> Option<(u64, u64)> {
    None
}

/// Registers an input; refused if this run is about to write it.
pub fn reads(path: &Path) -> Result<(), Refusal> {
    let Some(place) = Place::of(path) else {
        return Ok(());
    };
    let mut used = used();
    if used.iter().any(|other| other.is_written_at(&place)) {
        return Err(input_and_output(path));
    }
    used.push(Used {
        place,
        written: None,
    });
    Ok(())
}

/// Registers an output; refused if this run reads it or writes it already.
pub fn writes(path: &Path) -> Result<Written, Refusal> {
    let held = Arc::new(());
    let written = Some(Arc::downgrade(&held));
    if let Some(place) = Place::of(path) {
        let mut used = used();
        if used.iter().any(|other| other.is_written_at(&place)) {
            return Err(Refusal::new(
                format!("{} is named for two outputs of this run", path.display()),
                "give each output a name of its own",
            ));
        }
        if used.iter().any(|other| other.is_read_at(&place)) {
            return Err(input_and_output(path));
        }
        used.push(Used { place, written });
    }
    Ok(Written(held))
}

impl Used {
    fn is_written_at(&self, place: &Place) -> bool {
        let held = self.written.as_ref().is_some_and(|w| w.strong_count() > 0);
        held && self.place.is(place)
    }

    fn is_read_at(&self, place: &Place) -> bool {
        self.written.is_none() && self.place.is(place)
    }
}

fn input_and_output(path: &Path) -> Refusal {
    Refusal::new(
        format!("{} is an input of this run and its output", path.display()),
        "give the output another name: an input is never overwritten",
    )
}

fn used() -> std::sync::MutexGuard<'static, Vec<Used>> {
    USED.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

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

        fs::write(&file, "").unwrap();
        reads(&file).unwrap();
        reads(&spelled).unwrap();
        let second = folder.path().join("second.csv");
        fs::hard_link(&file, &second).unwrap();
        for name in [&file, &spelled, &second] {
            let refused = writes(name).unwrap_err().to_string();
            assert!(refused.contains("an input of this run"), "{refused}");
        }
        #[cfg(unix)]
        {
            let link = folder.path().join("link.csv");
            std::os::unix::fs::symlink(&file, &link).unwrap();
            assert!(writes(&link).is_err());
        }
        drop(writes(&folder.path().join("b.csv")).unwrap());

        // Two outputs that are hard links to one file.
        let (result, again) = (folder.path().join("r.csv"), folder.path().join("s.csv"));
        fs::write(&result, "").unwrap();
        fs::hard_link(&result, &again).unwrap();
        let held = writes(&result).unwrap();
        let refused = writes(&again).unwrap_err().to_string();
        assert!(refused.contains("two outputs"), "{refused}");
        drop(held);
    }

    #[test]
    #[cfg(unix)]
    fn a_device_may_be_input_and_output() {
        let null = Path::new("/dev/null");
        let first = writes(null).unwrap();
        let second = writes(null).unwrap();
        reads(null).unwrap();
        drop((first, second));
    }
}
