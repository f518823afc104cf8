//! Files that are written whole or not at all.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::refusal::Refusal;

/// Temporary files of this run, removed when it is stopped hard.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Where a result will go: checked before anything is computed, written at the end.
#[derive(Clone, Debug)]
pub struct Target {
    path: PathBuf,
}

impl Target {
    /// The target `path`, refused where its folder is missing or it is itself a folder.
    pub fn check(path: &Path) -> Result<Self, Refusal> {
        if path.is_dir() {
            return Err(Refusal::new(
                format!("{} is a folder", path.display()),
                "give the name of a file in it",
            ));
        }
        if path.file_name().is_none() {
            return Err(Refusal::new(
                format!("'{}' is not the name of a file", path.display()),
                "give a file name such as out.svg",
            ));
        }
        let folder = folder(path);
        if !folder.is_dir() {
            return Err(Refusal::new(
                format!(
                    "the folder {} of {} does not exist",
                    folder.display(),
                    path.display()
                ),
                format!(
                    "create it (mkdir -p {}) or give another path",
                    folder.display()
                ),
            ));
        }
        if fs::metadata(folder).is_ok_and(|data| data.permissions().readonly()) {
            return Err(Refusal::new(
                format!("the folder {} cannot be written to", folder.display()),
                "give a path in a folder of yours",
            ));
        }
        Ok(Self { path: path.into() })
    }

    /// Ending of the file name in small letters, without the dot; empty where there is none.
    #[must_use]
    pub fn ending(&self) -> String {
        self.path
            .extension()
            .map(|ending| ending.to_string_lossy().to_lowercase())
            .unwrap_or_default()
    }

    /// The path that will be written.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes the file by `content`: into a temporary file beside it, renamed when complete.
    pub fn write(
        &self,
        content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<(), Refusal> {
        self.write_by(|file| content(file).map_err(|error| self.unwritten(&error)))
    }

    /// Writes the file by work that may itself refuse, and gives back what came of the work.
    pub fn write_by<T>(
        &self,
        work: impl FnOnce(&mut (dyn Write + Send)) -> Result<T, Refusal>,
    ) -> Result<T, Refusal> {
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let temporary =
            folder(&self.path).join(format!(".{name}.{}.unfinished", std::process::id()));
        unfinished().push(temporary.clone());
        let refuse = |error: std::io::Error| self.unwritten(&error);
        let written = (|| {
            let mut file = BufWriter::new(File::create(&temporary).map_err(refuse)?);
            let result = work(&mut file)?;
            let file = file
                .into_inner()
                .map_err(|error| refuse(error.into_error()))?;
            file.sync_data().map_err(refuse)?;
            fs::rename(&temporary, &self.path).map_err(refuse)?;
            Ok(result)
        })();
        if written.is_err() {
            let _ = fs::remove_file(&temporary);
        }
        unfinished().retain(|other| *other != temporary);
        written
    }

    fn unwritten(&self, error: &std::io::Error) -> Refusal {
        Refusal::file(
            &self.path,
            error,
            "check space and permissions of the folder",
        )
    }

    /// Writes `bytes` as the whole file.
    pub fn write_bytes(&self, bytes: &[u8]) -> Result<(), Refusal> {
        self.write(|file| file.write_all(bytes))
    }
}

/// Reads a text file whole.
pub fn read_text(path: &Path) -> Result<String, Refusal> {
    fs::read_to_string(path)
        .map_err(|error| Refusal::file(path, &error, "give the path of a readable text file"))
}

/// Removes the temporary files of this run; the last act before a hard stop.
pub fn remove_unfinished() {
    for path in unfinished().drain(..) {
        let _ = fs::remove_file(path);
    }
}

fn unfinished() -> std::sync::MutexGuard<'static, Vec<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder_of(test: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("kband-{test}-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        folder
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = folder_of("file");
        let target = Target::check(&folder.join("a.csv")).unwrap();
        target.write_bytes(b"old").unwrap();
        let refused = target.write(|file| {
            file.write_all(b"half")?;
            Err(std::io::Error::other("disk full"))
        });
        assert!(refused.unwrap_err().to_string().contains("disk full"));
        assert_eq!(fs::read(target.path()).unwrap(), b"old");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_missing_folder_is_refused_before_the_work() {
        let folder = folder_of("folder");
        let refused = Target::check(&folder.join("none/a.svg")).unwrap_err();
        assert!(refused.to_string().contains("does not exist"));
        assert!(
            Target::check(&folder)
                .unwrap_err()
                .to_string()
                .contains("is a folder")
        );
        fs::remove_dir_all(folder).unwrap();
    }
}
