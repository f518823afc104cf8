//! Launches from a file, one in each row.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::Path;

use kband::feeder::OutOfRange;
use kband::impact::{Kernel, Map};

use crate::file;
use crate::refusal::Refusal;

/// A map and the state it is applied to.
pub struct Row<K: Kernel> {
    /// The map.
    pub kernel: K,
    /// The launch.
    pub state: K::State,
}

/// Rows of a checked file.
pub struct Survey {
    /// Number of rows.
    pub rows: u64,
    /// Number of rows out of the arithmetic's range, and the refusal of the first.
    pub left: Option<(u64, Refusal)>,
}

/// The refusal of a launch out of an arithmetic's range; `next` is the alternative to another
/// arithmetic.
pub(super) fn not_held<K: Kernel>(refused: OutOfRange, next: &str) -> Refusal {
    Refusal::value(
        refused.parameter,
        refused.value,
        format!("{} (arithmetic {})", refused.accepted, K::NAME),
        format!("{next}, or choose another --arithmetic"),
    )
}

const NEXT: &str = "correct or remove this row";

/// A file of launches. It is read twice: to check every row, and to compute them.
pub(super) struct LaunchFile<'a> {
    path: &'a Path,
    file: File,
}

impl<'a> LaunchFile<'a> {
    /// Opens a file; a pipe, which can be read only once, is copied to the disk.
    pub fn open(path: &'a Path) -> Result<Self, Refusal> {
        let refuse = |error: std::io::Error| unread(path, &error);
        let mut file = file::open(path, READABLE)?;
        if !file.metadata().map_err(refuse)?.is_file() {
            let mut copy = unnamed().map_err(refuse)?;
            std::io::copy(&mut file, &mut copy).map_err(refuse)?;
            file = copy;
        }
        Ok(Self { path, file })
    }

    /// Its size in bytes.
    pub fn size(&self) -> Result<u64, Refusal> {
        let data = self.file.metadata();
        data.map(|data| data.len())
            .map_err(|error| unread(self.path, &error))
    }

    /// A reader from the first row on.
    pub fn reader(&self) -> Result<BufReader<&File>, Refusal> {
        let mut file = &self.file;
        file.seek(SeekFrom::Start(0))
            .map_err(|error| unread(self.path, &error))?;
        Ok(BufReader::new(file))
    }
}

/// A file on the disk that is gone once it is closed.
fn unnamed() -> std::io::Result<File> {
    let path = std::env::temp_dir().join(format!("kband-rows-{}", std::process::id()));
    let mut options = File::options();
    let file = options
        .read(true)
        .write(true)
        .create_new(true)
        .open(&path)?;
    std::fs::remove_file(&path)?;
    Ok(file)
}

const READABLE: &str = "give the path of a readable text file";

fn unread(path: &Path, error: &std::io::Error) -> Refusal {
    Refusal::file(path, error, READABLE)
}

/// Calls `each` with the line number and the values `k, restitution, phase, velocity` of every row.
///
/// `go_on` gets the bytes read since its last call.
fn each_row(
    path: &Path,
    mut reader: impl BufRead,
    mut go_on: impl FnMut(u64) -> Result<(), Refusal>,
    mut each: impl FnMut(usize, [f64; 4]) -> Result<(), Refusal>,
) -> Result<(), Refusal> {
    const COLUMNS: [&str; 4] = ["k", "restitution", "phase", "velocity"];
    let name = path.display();
    let mut places = None;
    let mut line = String::new();
    let mut number = 0_usize;
    let mut bytes = 0;
    let mut more = true;
    while more {
        line.clear();
        more = reader
            .read_line(&mut line)
            .map_err(|error| unread(path, &error))?
            > 0;
        number += 1;
        bytes += line.len() as u64;
        if number.is_multiple_of(1024) {
            go_on(std::mem::take(&mut bytes))?;
        }
        let mut text = line.trim();
        if number == 1 {
            text = text.trim_start_matches('\u{feff}').trim();
        }
        // A file without a header is refused by its empty one.
        if (text.is_empty() && (more || places.is_some())) || text.starts_with('#') {
            continue;
        }
        let Some(places) = places else {
            let names = text.split(',');
            let names: Vec<&str> = names.map(|name| name.trim().trim_matches('"')).collect();
            let mut found = [0; 4];
            for (place, column) in found.iter_mut().zip(COLUMNS) {
                *place = names
                    .iter()
                    .position(|name| *name == column)
                    .ok_or_else(|| {
                        Refusal::value(
                            format!("header of {name}"),
                            format!("'{text}'"),
                            "the columns k,restitution,phase,velocity in any order",
                            format!("add the column {column}"),
                        )
                    })?;
            }
            places = Some(found);
            continue;
        };
        let mut values = [0.0; 4];
        for ((value, place), column) in values.iter_mut().zip(places).zip(COLUMNS) {
            let field = text.split(',').nth(place).map_or("", str::trim);
            *value = field.parse().map_err(|_| {
                Refusal::value(column, format!("'{field}'"), "a number", "correct this row")
                    .at(format!("{name}, line {number}"))
            })?;
        }
        each(number, values)?;
    }
    Ok(())
}

fn launch<K: Kernel>(
    [k, restitution, phase, velocity]: [f64; 4],
    build: &impl Fn(f64, f64) -> Result<K, OutOfRange>,
) -> Result<Row<K>, OutOfRange> {
    let kernel = build(k, restitution)?;
    let state = K::state(phase, velocity)?;
    Ok(Row { kernel, state })
}

/// Checks all rows. The first invalid launch is refused with its line and column. Launches out of
/// this arithmetic's range alone are counted.
///
/// `go_on` gets the bytes read since its last call, and may refuse to.
pub fn check_rows<K: Kernel>(
    path: &Path,
    reader: impl BufRead,
    build: impl Fn(f64, f64) -> Result<K, OutOfRange>,
    go_on: impl FnMut(u64) -> Result<(), Refusal>,
) -> Result<Survey, Refusal> {
    let mut found = Survey {
        rows: 0,
        left: None,
    };
    each_row(path, reader, go_on, |line, values| {
        found.rows += 1;
        if let Err(cause) = launch(values, &build) {
            let [k, restitution, phase, velocity] = values;
            let place = format!("{}, line {line}", path.display());
            // No arithmetic has a wider range than f64.
            let wide = Map::build(k, restitution).and(Map::state(phase, velocity));
            if let Err(cause) = wide {
                return Err(Refusal::from(cause).then(NEXT).at(place));
            }
            let (count, first) = found
                .left
                .take()
                .unwrap_or_else(|| (0, not_held::<K>(cause, NEXT).at(place)));
            found.left = Some((count + 1, first));
        }
        Ok(())
    })?;
    match &found.left {
        Some((count, first)) if *count == found.rows => Err(first.clone()),
        None if found.rows == 0 => Err(Refusal::new(
            format!("{} has no rows", path.display()),
            "give at least one row below the header k,restitution,phase,velocity",
        )),
        _ => Ok(found),
    }
}

/// Calls `each` with the launches of a checked file, some at a time; `None` for one out of the
/// arithmetic's range.
pub fn fly_rows<K: Kernel>(
    path: &Path,
    reader: impl BufRead,
    build: impl Fn(f64, f64) -> Result<K, OutOfRange>,
    mut each: impl FnMut(&mut Vec<Option<Row<K>>>) -> Result<(), Refusal>,
) -> Result<(), Refusal> {
    /// Launches at a time: a few blocks.
    const TOGETHER: usize = 4096;
    let mut rows = Vec::with_capacity(TOGETHER);
    each_row(
        path,
        reader,
        |_| Ok(()),
        |_, values| {
            rows.push(launch(values, &build).ok());
            if rows.len() == TOGETHER {
                each(&mut rows)?;
                rows.clear();
            }
            Ok(())
        },
    )?;
    each(&mut rows)
}

#[cfg(test)]
mod tests {
    use kband::impact::Single;

    use super::*;

    #[test]
    fn a_row_that_only_the_arithmetic_cannot_hold_is_left_out() {
        let path = Path::new("a.csv");
        let text = "k,restitution,phase,velocity\n0.4,0.2,1,70\n0.4,0.2,1,2\n0.4,0.2,1,80\n";
        let check = |text: &str| check_rows(path, text.as_bytes(), Single::build, |_| Ok(()));
        let found = check(text).unwrap();
        let (count, first) = found.left.unwrap();
        assert_eq!((found.rows, count), (3, 2));
        assert!(
            first.to_string().contains("line 2: velocity = 70"),
            "{first}"
        );
        let mut held = Vec::new();
        let each = |rows: &mut Vec<Option<Row<_>>>| {
            held.extend(rows.iter().map(Option::is_some));
            Ok(())
        };
        fly_rows(path, text.as_bytes(), Single::build, each).unwrap();
        assert_eq!(held, [false, true, false]);
        // A file without any usable row is refused.
        let text = "k,restitution,phase,velocity\n0.4,0.2,1,70\n";
        let none = check(text);
        assert!(none.is_err_and(|refusal| refusal.to_string().contains("0..60")));
        // For a k out of every range, the message has the widest range and names no other
        // arithmetic.
        for (k, expected) in [
            (
                0.0005,
                "accepted: 0.001..1000\n  next: correct or remove this row",
            ),
            (
                0.002,
                "next: correct or remove this row, or choose another --arithmetic",
            ),
        ] {
            let text = format!("k,restitution,phase,velocity\n{k},0.2,1,1\n");
            let refused = check(&text);
            let message = refused.err().map(|refusal| refusal.to_string());
            assert!(message.is_some_and(|message| message.ends_with(expected)));
        }
    }
}
