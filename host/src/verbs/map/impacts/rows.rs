//! Launches from a file, one in each row.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::Path;

use kband::feeder::OutOfRange;
use kband::impact::{Kernel, Map};

use crate::file;
use crate::refusal::{Refusal, Result};

/// A map and an initial state.
pub struct Row<K: Kernel> {
    /// The map.
    pub kernel: K,
    /// The state just after the last impact.
    pub state: K::State,
}

/// Opens a file of launches, which is read twice: first to check every row, then to compute. A pipe
/// is copied to the disk, because it can be read only once.
pub(super) fn open(path: &Path) -> Result<File> {
    let refuse = |error: std::io::Error| unread(path, &error);
    let mut file = file::open(path, NEXT_READABLE_FILE)?;
    if !file.metadata().map_err(refuse)?.is_file() {
        let mut copy = tempfile::tempfile().map_err(refuse)?;
        std::io::copy(&mut file, &mut copy).map_err(refuse)?;
        file = copy;
    }
    Ok(file)
}

/// The file from its start, and its size in bytes.
pub(super) fn whole<'a>(path: &Path, mut file: &'a File) -> Result<(BufReader<&'a File>, u64)> {
    let size = file
        .metadata()
        .and_then(|data| file.rewind().map(|()| data.len()));
    let size = size.map_err(|error| unread(path, &error))?;
    Ok((BufReader::new(file), size))
}

const NEXT_READABLE_FILE: &str = "give the path of a readable text file";

fn unread(path: &Path, error: &std::io::Error) -> Refusal {
    Refusal::file(path, error, NEXT_READABLE_FILE)
}

/// Calls `each` with the line number and the values `k, restitution, phase, velocity` of every row,
/// and `check_stop` with the number of bytes read since its last call.
fn each_row(
    path: &Path,
    mut reader: impl BufRead,
    mut check_stop: impl FnMut(u64) -> Result<()>,
    mut each: impl FnMut(usize, [f64; 4]) -> Result<()>,
) -> Result<()> {
    const COLUMNS: [&str; 4] = ["k", "restitution", "phase", "velocity"];
    let name = path.display();
    let mut places = None;
    let mut line = String::new();
    let mut number = 0_usize;
    let mut bytes = 0;
    let mut more = true;
    while more {
        line.clear();
        let read = reader.read_line(&mut line);
        more = read.map_err(|error| unread(path, &error))? > 0;
        number += 1;
        bytes += line.len() as u64;
        if number.is_multiple_of(1024) {
            check_stop(std::mem::take(&mut bytes))?;
        }
        let mut text = line.trim();
        if number == 1 {
            text = text.trim_start_matches('\u{feff}').trim();
        }
        // A file without a header is refused.
        if (text.is_empty() && (more || places.is_some())) || text.starts_with('#') {
            continue;
        }
        let Some(places) = places else {
            let names = text.split(',');
            let names: Vec<&str> = names.map(|name| name.trim().trim_matches('"')).collect();
            let mut indices = [0; 4];
            for (place, column) in indices.iter_mut().zip(COLUMNS) {
                let found = names.iter().position(|name| *name == column);
                *place = found.ok_or_else(|| {
                    let value = format!("'{text}'");
                    let accepted = "the columns k,restitution,phase,velocity in any order";
                    let next = format!("add the column {column}");
                    Refusal::value(format!("header of {name}"), value, accepted, next)
                })?;
            }
            places = Some(indices);
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

/// Checks all rows by the range of f64, the widest, and returns their number. The first invalid
/// launch is refused with its line.
pub fn check_rows(
    path: &Path,
    reader: impl BufRead,
    check_stop: impl FnMut(u64) -> Result<()>,
) -> Result<u64> {
    let mut rows = 0;
    each_row(path, reader, check_stop, |line, values| {
        rows += 1;
        let refuse = |cause| {
            let refusal = Refusal::from(cause).then("correct or remove this row");
            refusal.at(format!("{}, line {line}", path.display()))
        };
        launch(values, &Map::build).map(|_| ()).map_err(refuse)
    })?;
    if rows == 0 {
        let cause = format!("{} has no rows", path.display());
        let next = "give at least one row below the header k,restitution,phase,velocity";
        return Err(Refusal::new(cause, next));
    }
    Ok(rows)
}

/// Calls `each` with every launch of a checked file; `None` is a launch out of the arithmetic's
/// range. Their number and the line of the first one are reported on standard error.
pub fn compute_rows<K: Kernel>(
    path: &Path,
    reader: impl BufRead,
    build: impl Fn(f64, f64) -> Result<K, OutOfRange>,
    mut each: impl FnMut(Option<Row<K>>) -> Result<()>,
) -> Result<()> {
    let mut left_empty: Option<(u64, usize)> = None;
    let compute = |line, values| {
        let row = launch(values, &build).ok();
        if row.is_none() {
            let (count, first) = left_empty.unwrap_or((0, line));
            left_empty = Some((count + 1, first));
        }
        each(row)
    };
    each_row(path, reader, |_| Ok(()), compute)?;
    if let Some((count, first)) = left_empty {
        eprintln!(
            "left empty, because arithmetic {} cannot represent them: {count} row(s), the first in line {first}",
            K::NAME
        );
    }
    Ok(())
}
