//! Rows that go straight into a file, CSV or JSON by its ending.

use super::{Column, CsvRows, JsonRows, Rows};
use crate::file::Destination;
use crate::refusal::Refusal;

/// Does `work` with rows of these columns that go into `target`, or with none where there is no
/// target.
pub fn write<T>(
    target: Option<&Destination>,
    columns: &[Column],
    work: impl FnOnce(Option<&mut dyn Rows>) -> Result<T, Refusal>,
) -> Result<T, Refusal> {
    let Some(target) = target else {
        return work(None);
    };
    target.write_by(|out| {
        if target.ending() == "json" {
            let mut rows = JsonRows::begin(out, columns)?;
            let result = work(Some(&mut rows))?;
            rows.end()?;
            return Ok(result);
        }
        work(Some(&mut CsvRows::begin(out, columns)?))
    })
}
