//! Rows written directly into a file, as CSV, JSON or Parquet by its ending.

use super::{Column, CsvRows, JsonRows, Rows, Value};
use crate::file::Destination;
use crate::refusal::Refusal;

/// Refuses the file of an option whose ending is no row format of this build.
pub fn check(option: &str, target: &Destination) -> Result<(), Refusal> {
    let (accepted, next) = match target.ending().as_str() {
        "csv" => return Ok(()),
        "parquet" if cfg!(feature = "parquet") => return Ok(()),
        "parquet" => (
            "a name that ends in .csv: this kband was built without Parquet",
            "cargo install --path host --features parquet brings it",
        ),
        _ => ("a name that ends in .csv or .parquet", "change the ending"),
    };
    let path = target.path().display();
    Err(Refusal::value(option, path, accepted, next))
}

/// Approximate bytes of a row in a file with this ending.
pub fn row_bytes(ending: &str, columns: &[Column], row: &[Value]) -> u64 {
    let bytes = |(column, value): (&Column, &Value)| match ending {
        "parquet" => 8,
        "json" => column.name.len() + value.json().to_string().len() + 11,
        _ => value.csv().len() + 1,
    };
    columns.iter().zip(row).map(bytes).sum::<usize>() as u64
}

/// Calls `work` with the writer of rows for `target`, or with `None` without a target.
pub fn write<T>(
    target: Option<&Destination>,
    columns: &[Column],
    work: impl FnOnce(Option<&mut dyn Rows>) -> Result<T, Refusal>,
) -> Result<T, Refusal> {
    let Some(target) = target else {
        return work(None);
    };
    if target.ending() != "json" {
        check("the file", target)?;
    }
    target.write_by(|out| {
        #[cfg(feature = "parquet")]
        if target.ending() == "parquet" {
            let mut rows = super::parquet::ParquetRows::begin(out, columns)?;
            let result = work(Some(&mut rows))?;
            rows.end()?;
            return Ok(result);
        }
        if target.ending() == "json" {
            let mut rows = JsonRows::begin(out, columns)?;
            let result = work(Some(&mut rows))?;
            rows.end()?;
            return Ok(result);
        }
        work(Some(&mut CsvRows::begin(out, columns)?))
    })
}
