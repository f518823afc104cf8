//! Output files, written whole or not at all, and never over an input or output of the same run.
//!
//! The method is a temporary file in the same folder, renamed when complete (atomic replacement).
//! A file that the user names replaces an older one, with a message. A file with a default name
//! replaces only a file that kband wrote.

mod used;

use std::fs::{self, File};
use std::io::{BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::refusal::Refusal;
use used::Written;

/// Temporary files of this run, removed before a forced stop.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Whether a result goes to standard output: messages then go to standard error.
static STANDARD_OUTPUT_TAKEN: AtomicBool = AtomicBool::new(false);

/// Whether a result goes to standard output.
pub fn takes_standard_output() -> bool {
    STANDARD_OUTPUT_TAKEN.load(Ordering::Relaxed)
}

/// Whether the reader of standard output has gone away (`| head`).
static READER_GONE: AtomicBool = AtomicBool::new(false);

/// Whether the reader of standard output has gone away: the run then ends quietly.
pub fn reader_is_gone() -> bool {
    READER_GONE.load(Ordering::Relaxed)
}

/// Standard output that notes when its reader has gone away.
pub fn standard_output() -> impl Write {
    Standard(std::io::stdout())
}

struct Standard(std::io::Stdout);

impl Write for Standard {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.0.write(bytes);
        if let Err(error) = &written
            && error.kind() == ErrorKind::BrokenPipe
        {
            READER_GONE.store(true, Ordering::Relaxed);
        }
        written
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}

/// The ending in `-` or `-.png`, which are standard output; `None` for the name of a file.
fn standard(path: &Path) -> Option<&str> {
    match path.to_str()? {
        "-" => Some(""),
        name => name
            .strip_prefix("-.")
            .filter(|ending| !ending.contains('/')),
    }
}

/// Destination of a result: checked before anything is computed, written at the end.
#[derive(Clone, Debug)]
pub struct Destination {
    path: PathBuf,
    standard: bool,
    /// Whether there was a file of this name already.
    replaces: bool,
    _written: Option<Written>,
}

impl Destination {
    /// The target `path`, or standard output for `-` and `-.png`. The ending gives the format;
    /// without one it is `ending`.
    pub fn output(path: &Path, ending: &str) -> Result<Self, Refusal> {
        let Some(said) = standard(path) else {
            return Self::check(path);
        };
        if STANDARD_OUTPUT_TAKEN.swap(true, Ordering::Relaxed) {
            return Err(Refusal::new(
                "standard output (-) is named for two outputs of this run",
                "give one of them the name of a file",
            ));
        }
        let ending = if said.is_empty() { ending } else { said };
        Ok(Self {
            path: format!("-.{ending}").into(),
            standard: true,
            replaces: false,
            _written: None,
        })
    }

    /// The target `path`. Refused: a folder, a file in a missing folder, and a file that this run
    /// reads or writes elsewhere, by any name.
    pub fn check(path: &Path) -> Result<Self, Refusal> {
        if standard(path).is_some() {
            return Err(Refusal::new(
                format!(
                    "{} is standard output, which this option does not take",
                    path.display()
                ),
                "give the name of a file",
            ));
        }
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
        if path.is_symlink() && !path.exists() {
            return Err(Refusal::new(
                format!("{} is a symbolic link to nothing", path.display()),
                "remove the link, or give another path",
            ));
        }
        let written = used::writes(path)?;
        Ok(Self {
            path: path.into(),
            replaces: path.is_file(),
            standard: false,
            _written: Some(written),
        })
    }

    /// The same for a default name: also refused if the file exists and kband did not write it.
    /// `own` decides that by the file's beginning.
    pub fn default_name(path: &Path, own: fn(&str) -> bool, option: &str) -> Result<Self, Refusal> {
        let target = Self::check(path)?;
        if target.replaces {
            let mut begin = vec![0; 2048];
            let read = File::open(path).and_then(|mut file| file.read(&mut begin));
            begin.truncate(read.unwrap_or(0));
            if !own(&String::from_utf8_lossy(&begin)) {
                return Err(Refusal::new(
                    format!(
                        "{} is there already, and kband did not write it",
                        path.display()
                    ),
                    format!("name the file: {option}, or move this one away"),
                ));
            }
        }
        Ok(target)
    }

    /// Message for the user that the file was written.
    pub fn told(&self) -> String {
        if self.standard {
            return "wrote standard output".into();
        }
        let what = if self.replaces { "replaced" } else { "wrote" };
        format!("{what} {}", self.path.display())
    }

    /// Ending of the file name in lower case, without the dot; empty without one.
    pub fn ending(&self) -> String {
        self.path
            .extension()
            .map(|ending| ending.to_string_lossy().to_lowercase())
            .unwrap_or_default()
    }

    /// Refuses another ending than these of an option's file.
    pub fn ends_in(&self, option: &str, endings: &[&str]) -> Result<(), Refusal> {
        if endings.contains(&self.ending().as_str()) {
            return Ok(());
        }
        Err(Refusal::value(
            option,
            self.path.display(),
            format!("a file name that ends in .{}", endings.join(" or .")),
            "change the ending",
        ))
    }

    /// The path that will be written.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes the file by `content`: into a temporary file in its folder, renamed when complete.
    pub fn write(
        &self,
        content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<(), Refusal> {
        self.write_by(|file| content(file).map_err(|error| self.unwritten(&error)))
    }

    /// Writes the file by work that may itself refuse; returns the work's result.
    ///
    /// A symbolic link is followed. A pipe or a device is written directly. Neither is replaced.
    pub fn write_by<T>(
        &self,
        work: impl FnOnce(&mut (dyn Write + Send)) -> Result<T, Refusal>,
    ) -> Result<T, Refusal> {
        let refuse = |error: std::io::Error| self.unwritten(&error);
        if self.standard {
            let mut out = BufWriter::new(standard_output());
            let result = work(&mut out)?;
            out.flush().map_err(refuse)?;
            return Ok(result);
        }
        if fs::metadata(&self.path).is_ok_and(|data| !data.is_file()) {
            let opened = File::options().write(true).open(&self.path);
            let mut file = BufWriter::new(opened.map_err(refuse)?);
            let result = work(&mut file)?;
            file.flush().map_err(refuse)?;
            return Ok(result);
        }
        // An existing file is resolved to the target of its links.
        let place = fs::canonicalize(&self.path).unwrap_or_else(|_| self.path.clone());
        let name = name_of(&place);
        let temporary =
            folder(&place).join(format!(".{name}.{}{UNFINISHED_ENDING}", std::process::id()));
        unfinished().push(temporary.clone());
        let written = (|| {
            let mut file = BufWriter::new(File::create(&temporary).map_err(refuse)?);
            let result = work(&mut file)?;
            let file = file
                .into_inner()
                .map_err(|error| refuse(error.into_error()))?;
            file.sync_data().map_err(refuse)?;
            fs::rename(&temporary, &place).map_err(refuse)?;
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

/// Ending of a temporary file, after the number of the process.
const UNFINISHED_ENDING: &str = ".unfinished";

/// The source of an input: standard input for `-`.
fn source(path: &Path) -> &Path {
    if path == Path::new("-") {
        Path::new("/dev/stdin")
    } else {
        path
    }
}

/// Opens an input; `next` is the next step of the error.
pub fn open(path: &Path, next: &str) -> Result<File, Refusal> {
    let file = File::open(source(path)).map_err(|error| Refusal::file(path, &error, next))?;
    used::reads(path)?;
    Ok(file)
}

/// Reads a whole input; `next` is the next step of the error.
pub fn read(path: &Path, next: &str) -> Result<Vec<u8>, Refusal> {
    let bytes = fs::read(source(path)).map_err(|error| Refusal::file(path, &error, next))?;
    used::reads(path)?;
    Ok(bytes)
}

/// Reads a whole text file.
pub fn read_text(path: &Path) -> Result<String, Refusal> {
    let text = fs::read_to_string(source(path))
        .map_err(|error| Refusal::file(path, &error, "give the path of a readable text file"))?;
    used::reads(path)?;
    Ok(text)
}

fn name_of(path: &Path) -> std::borrow::Cow<'_, str> {
    path.file_name().unwrap_or_default().to_string_lossy()
}

/// Removes the temporary files of this run; the last act before a forced stop.
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
        let target = Destination::check(&folder.join("a.csv")).unwrap();
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
    #[cfg(unix)]
    fn a_link_is_written_through_and_one_to_nothing_is_refused() {
        let folder = folder_of("link");
        let (file, link) = (folder.join("a.csv"), folder.join("link.csv"));
        std::os::unix::fs::symlink(&file, &link).unwrap();
        let refused = Destination::check(&link).unwrap_err().to_string();
        assert!(refused.contains("a symbolic link to nothing"), "{refused}");
        fs::write(&file, "old").unwrap();
        Destination::check(&link)
            .unwrap()
            .write_bytes(b"new")
            .unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 2);
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    #[cfg(unix)]
    fn a_device_is_written_to_and_not_replaced() {
        use std::os::unix::fs::FileTypeExt;
        let folder = folder_of("pipe");
        let pipe = folder.join("pipe.csv");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe).unwrap()
        });
        let target = Destination::check(&pipe).unwrap();
        target.write_bytes(b"rows").unwrap();
        assert_eq!(reader.join().unwrap(), b"rows");
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
        fs::remove_dir_all(folder).unwrap();
    }
}
