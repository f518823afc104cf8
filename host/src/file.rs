//! Output files, written completely or not at all: into a temporary file in the same folder,
//! renamed when complete. A named file replaces an older one, with a message. A file with a default
//! name replaces only a file that kband wrote. Only data of a board is also flushed to the disk.

mod used;

use std::fs::{self, File};
use std::io::{BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use used::Role;

use crate::refusal::{Refusal, Result};

/// Temporary files of this run, removed before a forced stop.
static UNFINISHED_FILES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// Whether a result goes to standard output: messages then go to standard error.
static STANDARD_OUTPUT_IN_USE: AtomicBool = AtomicBool::new(false);

pub fn is_standard_output_in_use() -> bool {
    STANDARD_OUTPUT_IN_USE.load(Ordering::Relaxed)
}

static READER_CLOSED: AtomicBool = AtomicBool::new(false);

/// Whether the reader has closed standard output; the run then ends without a message.
pub fn is_reader_closed() -> bool {
    READER_CLOSED.load(Ordering::Relaxed)
}

/// Standard output that detects a reader's closing it.
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
            READER_CLOSED.store(true, Ordering::Relaxed);
        }
        written
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}

/// Ending after `-` or `-.` for standard output; `None` for the name of a file.
fn standard(path: &Path) -> Option<&str> {
    match path.to_str()? {
        "-" => Some(""),
        name => {
            let ending = name.strip_prefix("-.");
            ending.filter(|ending| !ending.contains('/'))
        }
    }
}

/// Destination of a result: checked before anything is computed, written at the end.
#[derive(Clone, Debug)]
pub struct Destination {
    path: PathBuf,
    standard: bool,
    replaces: bool,
    /// Whether the file must survive a loss of power: it cannot be computed again.
    durable: bool,
}

impl Destination {
    /// The destination `path`, or standard output for `-` and `-.png`, with a default ending.
    pub fn output(path: &Path, ending: &str) -> Result<Self> {
        let Some(requested) = standard(path) else {
            return Self::check(path);
        };
        if STANDARD_OUTPUT_IN_USE.swap(true, Ordering::Relaxed) {
            let cause = "standard output (-) is named for two outputs of this run";
            return Err(Refusal::new(cause, "give one of them the name of a file"));
        }
        let requested = Some(requested).filter(|requested| !requested.is_empty());
        let ending = requested.unwrap_or(ending);
        Ok(Self {
            path: format!("-.{ending}").into(),
            standard: true,
            replaces: false,
            durable: false,
        })
    }

    /// The destination `path`, unless it is a folder, in a missing folder, or a file of this run.
    pub fn check(path: &Path) -> Result<Self> {
        let (name, folder) = (path.display(), folder(path));
        let refuse = |cause: String, next: &str| Err(Refusal::new(cause, next));
        if standard(path).is_some() {
            let cause = format!("{name} is standard output, which this option does not take");
            return refuse(cause, "give the name of a file");
        }
        if path.is_dir() {
            let cause = format!("{name} is a folder");
            return refuse(cause, "give the name of a file in it");
        }
        if path.file_name().is_none() {
            let cause = format!("'{name}' is not the name of a file");
            return refuse(cause, "give a file name such as out.svg");
        }
        let within = folder.display();
        if !folder.is_dir() {
            let next = format!("create it (mkdir -p {within}) or give another path");
            let cause = format!("the folder {within} of {name} does not exist");
            return refuse(cause, &next);
        }
        if fs::metadata(folder).is_ok_and(|data| data.permissions().readonly()) {
            let cause = format!("the folder {within} cannot be written to");
            return refuse(cause, "give a path in a folder of yours");
        }
        if path.is_symlink() && !path.exists() {
            let cause = format!("{name} is a symbolic link to nothing");
            return refuse(cause, "remove the link, or give another path");
        }
        used::add(path, Role::Output)?;
        Ok(Self {
            path: path.into(),
            replaces: path.is_file(),
            durable: false,
            standard: false,
        })
    }

    /// The same for a default name; `own` decides by the first bytes whether kband wrote the file.
    pub fn default_name(path: &Path, own: fn(&str) -> bool, option: &str) -> Result<Self> {
        let target = Self::check(path)?;
        if target.replaces {
            let mut begin = vec![0; 2048];
            let read = File::open(path).and_then(|mut file| file.read(&mut begin));
            begin.truncate(read.unwrap_or(0));
            if !own(&String::from_utf8_lossy(&begin)) {
                let name = path.display();
                let cause = format!("{name} is there already, and kband did not write it");
                let next = format!("name the file: {option}, or move this one away");
                return Err(Refusal::new(cause, next));
            }
        }
        Ok(target)
    }

    pub fn describe_write(&self) -> String {
        if self.standard {
            return "wrote standard output".into();
        }
        let what = if self.replaces { "replaced" } else { "wrote" };
        format!("{what} {}", self.path.display())
    }

    /// Ending of the file name in lower case, without the dot; empty without one.
    pub fn ending(&self) -> String {
        let ending = self.path.extension().unwrap_or_default();
        ending.to_string_lossy().to_lowercase()
    }

    pub fn ends_in(&self, option: &str, endings: &[&str]) -> Result<()> {
        if endings.contains(&self.ending().as_str()) {
            return Ok(());
        }
        let value = self.path.display();
        let accepted = format!("a file name that ends in .{}", endings.join(" or ."));
        Err(Refusal::value(option, value, accepted, "change the ending"))
    }

    /// The same destination, whose content is on the disk once it is written.
    pub fn durable(mut self) -> Self {
        self.durable = true;
        self
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes the file with `content`: into a temporary file in its folder, renamed when complete.
    pub fn write(&self, content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<()> {
        self.write_by(|file| content(file).map_err(|error| self.write_refusal(&error)))
    }

    /// Writes the file by `work`, which may refuse; returns its result. A symbolic link is
    /// followed, a pipe or a device written directly.
    pub fn write_by<T>(
        &self,
        work: impl FnOnce(&mut (dyn Write + Send)) -> Result<T>,
    ) -> Result<T> {
        let refuse = |error: std::io::Error| self.write_refusal(&error);
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
        let name = place.file_name().unwrap_or_default().to_string_lossy();
        let temporary =
            folder(&place).join(format!(".{name}.{}{UNFINISHED_ENDING}", std::process::id()));
        unfinished().push(temporary.clone());
        let written = (|| {
            let mut file = BufWriter::new(File::create(&temporary).map_err(refuse)?);
            let result = work(&mut file)?;
            let file = file.into_inner();
            let file = file.map_err(|error| refuse(error.into_error()))?;
            if self.durable {
                file.sync_data().map_err(refuse)?;
            }
            fs::rename(&temporary, &place).map_err(refuse)?;
            Ok(result)
        })();
        if written.is_err() {
            let _ = fs::remove_file(&temporary);
        }
        unfinished().retain(|other| *other != temporary);
        written
    }

    fn write_refusal(&self, error: &std::io::Error) -> Refusal {
        Refusal::file(&self.path, error, NEXT_WRITABLE)
    }

    pub fn write_bytes(&self, bytes: &[u8]) -> Result<()> {
        self.write(|file| file.write_all(bytes))
    }
}

pub const NEXT_WRITABLE: &str = "check space and permissions of the folder";
const UNFINISHED_ENDING: &str = ".unfinished";

/// The source of an input: standard input for `-`.
fn source(path: &Path) -> &Path {
    match path == Path::new("-") {
        true => Path::new("/dev/stdin"),
        false => path,
    }
}

/// Takes an input by `take`; `next` is the next step of the error.
fn input<T>(path: &Path, next: &str, take: fn(&Path) -> std::io::Result<T>) -> Result<T> {
    let taken = take(source(path)).map_err(|error| Refusal::file(path, &error, next))?;
    used::add(path, Role::Input)?;
    Ok(taken)
}

pub fn open(path: &Path, next: &str) -> Result<File> {
    input(path, next, |path| File::open(path))
}

pub fn read(path: &Path, next: &str) -> Result<Vec<u8>> {
    input(path, next, |path| fs::read(path))
}

pub fn read_text(path: &Path) -> Result<String> {
    let next = "give the path of a readable text file";
    input(path, next, |path| fs::read_to_string(path))
}

/// Removes the temporary files of this run; the last act before a forced stop.
pub fn remove_unfinished() {
    for path in unfinished().drain(..) {
        let _ = fs::remove_file(path);
    }
}

fn unfinished() -> std::sync::MutexGuard<'static, Vec<PathBuf>> {
    let files = UNFINISHED_FILES.lock();
    files.unwrap_or_else(PoisonError::into_inner)
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

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let target = Destination::check(&folder.join("a.csv")).unwrap();
        target.write_bytes(b"old").unwrap();
        let refused = target.write(|file| {
            file.write_all(b"half")?;
            Err(std::io::Error::other("disk full"))
        });
        assert!(refused.unwrap_err().to_string().contains("disk full"));
        assert_eq!(fs::read(target.path()).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder).unwrap().count(), 1);
    }

    #[test]
    #[cfg(unix)]
    fn a_link_is_written_through_and_one_to_nothing_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let (file, link) = (folder.join("a.csv"), folder.join("link.csv"));
        std::os::unix::fs::symlink(&file, &link).unwrap();
        let refused = Destination::check(&link).unwrap_err().to_string();
        assert!(refused.contains("a symbolic link to nothing"), "{refused}");
        fs::write(&file, "old").unwrap();
        let target = Destination::check(&link).unwrap();
        target.write_bytes(b"new").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert_eq!(fs::read_dir(folder).unwrap().count(), 2);
    }

    #[test]
    #[cfg(unix)]
    fn a_device_is_written_to_and_not_replaced() {
        use std::os::unix::fs::FileTypeExt;
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
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
    }
}
