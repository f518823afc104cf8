//! Run times of whole commands, with one thread and with two.

use std::env;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use super::median;
use crate::desk::{Desk, Progress};
use crate::refusal::Refusal;

/// A command and its output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Work {
    /// The command line after `kband`.
    pub words: &'static str,
    /// Kind and number of its outputs.
    pub makes: (&'static str, u32),
}

impl Work {
    /// Its verb.
    #[must_use]
    pub fn verb(&self) -> &'static str {
        self.words.split(' ').next().unwrap_or_default()
    }
}

/// The commands, from the shortest to the longest.
pub const WORKS: [Work; 8] = [
    Work {
        words: "cascade --restitution 0.2",
        makes: ("cascades", 1),
    },
    Work {
        words: "capture --restitution 0.28..0.32",
        makes: ("plans", 1),
    },
    Work {
        words: "exponent --restitution 0.2 --k 0.34 --impacts 1000000",
        makes: ("impacts", 1_000_000),
    },
    Work {
        words: "diagram --starts rest",
        makes: ("columns", 1000),
    },
    Work {
        words: "gear --restitution 0.3 --scatter 0.05",
        makes: ("surveys", 1),
    },
    Work {
        words: "diagram",
        makes: ("columns", 3000),
    },
    Work {
        words: "basins --restitution 0.2 --k 0.43 --grid 1000",
        makes: ("starts", 1_000_000),
    },
    Work {
        words: "simulate --runs 1000",
        makes: ("runs", 2000),
    },
];

/// A command's time in s, with one thread and with two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waited {
    /// The command.
    pub work: Work,
    /// Median run time in s, with one thread and with two.
    pub seconds: [f64; 2],
}

/// Run times of each command from start to end, over `rounds` runs with one and two threads in
/// turns.
pub fn waited(works: &[Work], rounds: usize, desk: &Desk) -> Result<Vec<Waited>, Refusal> {
    // Folder for the commands' default files; it is removed at the end.
    let folder = tempfile::tempdir()
        .map_err(|error| Refusal::file(&env::temp_dir(), &error, "set TMPDIR to another folder"))?;
    let progress = Progress::new("bench", (rounds * works.len()) as u64);
    let mut times = vec![[const { Vec::new() }; 2]; works.len()];
    for _ in 0..rounds {
        for (work, times) in works.iter().zip(&mut times) {
            for (threads, times) in ["1", "2"].into_iter().zip(times) {
                desk.go_on()?;
                times.push(run(work.words, threads, folder.path())?);
            }
            progress.advance(1);
        }
    }
    progress.finish();
    Ok(works
        .iter()
        .zip(times)
        .map(|(&work, times)| Waited {
            work,
            seconds: times.map(median),
        })
        .collect())
}

/// Run time of a command in s.
fn run(words: &str, threads: &str, folder: &Path) -> Result<f64, Refusal> {
    let failed = |cause: String| {
        Refusal::new(
            format!("kband {words}: {cause}"),
            "run this command by itself",
        )
    };
    let own = env::current_exe().map_err(|error| failed(error.to_string()))?;
    let begun = Instant::now();
    let status = Command::new(own)
        .args(words.split(' '))
        .args(["--threads", threads])
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .map_err(|error| failed(error.to_string()))?;
    let seconds = begun.elapsed().as_secs_f64();
    if status.success() {
        Ok(seconds)
    } else {
        Err(failed(status.to_string()))
    }
}
