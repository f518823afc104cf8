//! `kband paper`: every equation, number and claim of the paper, printed and recomputed.

mod chaos;
mod claims;
mod conveying;
mod figures;
mod flight;
mod lock;
mod means;
mod page;
mod renewal;
mod row;

use std::path::PathBuf;

use serde_json::json;

use crate::arguments::{self, Printed};
use crate::desk::Desk;
use crate::file::Destination;
use crate::picture::Theme;
use crate::refusal::{Exit, Refusal};
use crate::report::{Printout, Table, columns};

use row::{Row, Verdict};

/// Every equation, number and claim of the paper (Hongler & Figour 1989): printed, recomputed, verdict.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband paper
  kband paper --format json
  kband paper --restitution 0.5 --out report.html

Each row is recomputed from the exact map and compared with a reference of its own: an integration \
of the equations of motion, a second formula, or a 20-digit value. residual is the largest \
deviation over all cases; where it exceeds tolerance the row fails and the exit status is 1. \
printed_error is how far the literal print is off in the same measure. Claims of the text and \
findings of our own are rows without a number.")]
pub struct Arguments {
    /// Restitution of the part in the pictures of the page.
    #[arg(long, value_name = "R", default_value = "0.2", value_parser = arguments::within(0.05, 0.95, ""))]
    restitution: f64,

    /// Also write one self-contained page with the table and pictures; the name ends in .html.
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,

    /// Colours of the pictures.
    #[arg(long, value_enum, default_value_t = Theme::Light)]
    theme: Theme,

    #[command(flatten)]
    printed: Printed,
}

/// Recomputes the paper.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let target = arguments
        .out
        .as_deref()
        .map(|path| Destination::output(path, "html"))
        .transpose()?;
    if let Some(target) = &target
        && !matches!(target.ending().as_str(), "html" | "htm")
    {
        return Err(Refusal::value(
            "ending of --out",
            format!("'{}'", target.ending()),
            ".html: the page holds the table and the pictures",
            "for example --out report.html",
        ));
    }
    let rows = recomputed(desk)?;
    let failed: Vec<String> = rows
        .iter()
        .filter(|row| !row.holds())
        .map(Row::name)
        .collect();
    report(&rows)?.print(arguments.printed.format)?;
    if let Some(target) = target {
        let page = page::page(&rows, arguments.restitution, arguments.theme, desk)?;
        target.write_bytes(page.as_bytes())?;
        eprintln!("{}", target.told());
    }
    if failed.is_empty() {
        return Ok(Exit::Done);
    }
    eprintln!(
        "recomputation disagrees with its reference: {}",
        failed.join(", ")
    );
    Ok(Exit::CheckFailed)
}

/// All rows in the order of the paper.
fn recomputed(desk: &Desk) -> Result<Vec<Row>, Refusal> {
    let parts = [
        flight::ROWS,
        lock::ROWS,
        conveying::ROWS,
        means::ROWS,
        renewal::ROWS,
        chaos::ROWS,
        claims::ROWS,
    ];
    let work: Vec<row::Work> = parts.into_iter().flatten().copied().collect();
    let mut rows: Vec<Row> = desk
        .try_map("the paper", work.len(), |n| work[n]())?
        .into_iter()
        .flatten()
        .collect();
    rows.sort_by_key(|row| row.place);
    Ok(rows)
}

fn report(rows: &[Row]) -> Result<Printout, Refusal> {
    let mut table = Table::new(&[
        columns::EQUATION,
        columns::SUBJECT,
        columns::PRINTED,
        columns::RECOMPUTED,
        columns::VERDICT,
        columns::RESIDUAL.digits(2),
        columns::TOLERANCE.digits(2),
        columns::PRINTED_ERROR.digits(2),
        columns::CASES,
        columns::HOLDS,
    ]);
    for row in rows {
        table.push([
            row.equation.into(),
            row.subject.into(),
            row.printed.as_str().into(),
            row.recomputed.as_str().into(),
            row.verdict.words().into(),
            row.residual.into(),
            row.tolerance.into(),
            row.printed_error.into(),
            row.cases.into(),
            row.holds().into(),
        ]);
    }
    let json: Vec<_> = rows
        .iter()
        .map(|row| {
            json!({
                "equation": row.equation, "subject": row.subject, "printed": row.printed,
                "recomputed": row.recomputed, "verdict": row.verdict.words(), "residual": row.residual,
                "tolerance": row.tolerance, "printed_error": row.printed_error, "cases": row.cases,
                "holds": row.holds(),
            })
        })
        .collect();
    let count = |verdict: Verdict| rows.iter().filter(|row| row.verdict == verdict).count();
    let failed = rows.iter().filter(|row| !row.holds()).count();
    Printout::new(table)
        .heading("M.-O. Hongler, J. Figour, Periodic versus chaotic dynamics in vibratory feeders, Helv. Phys. Acta (1989)")
        .note(format!(
            "{} rows: {} agree, {} corrected, {} refuted, {} findings of our own; {} cases; {}",
            rows.len(),
            count(Verdict::Agrees),
            count(Verdict::Corrected),
            count(Verdict::Refuted),
            count(Verdict::Found),
            rows.iter().map(|row| row.cases).sum::<u64>(),
            if failed == 0 {
                "every recomputation agrees with its reference".to_string()
            } else {
                format!("{failed} recomputations DISAGREE with their reference")
            }
        ))
        .json(&json)
}

#[cfg(test)]
mod tests {
    use std::sync::OnceLock;

    use super::*;

    /// The rows, recomputed once for all tests, on two threads.
    pub(in crate::verbs::paper) fn rows() -> &'static [Row] {
        static ROWS: OnceLock<Vec<Row>> = OnceLock::new();
        ROWS.get_or_init(|| recomputed(&Desk::new(Some(2)).unwrap()).unwrap())
    }

    /// Number, print and verdict of every equation, copied from the paper apart from this code.
    const PRINTED: &str = include_str!("../../../tests/reference/paper.tsv");

    #[test]
    fn every_equation_stands_with_its_print_and_its_verdict() {
        let rows = rows();
        let numbered: Vec<_> = rows
            .iter()
            .filter(|r| r.equation.starts_with('('))
            .collect();
        let printed: Vec<Vec<&str>> = PRINTED
            .lines()
            .filter(|line| !line.starts_with('#'))
            .map(|line| line.split('\t').collect())
            .collect();
        assert_eq!(numbered.len(), printed.len());
        for (row, columns) in numbered.iter().zip(&printed) {
            let shown = [row.equation, &row.printed, row.verdict.words()];
            assert_eq!(shown, columns[..], "the rows are in the order of the paper");
        }
        for number in 1..=38 {
            let bare = |row: &&&Row| {
                let digits = row.equation[1..].chars().take_while(char::is_ascii_digit);
                digits.collect::<String>() == number.to_string()
            };
            assert!(
                numbered.iter().any(|row| bare(&row)),
                "({number}) is missing"
            );
        }
    }

    #[test]
    fn every_row_holds_and_shows_its_evidence() {
        let rows = rows();
        for row in rows {
            assert!(row.holds(), "{row:?}");
            assert!(row.cases > 0 && !row.recomputed.is_empty(), "{row:?}");
            match (row.verdict, row.printed_error) {
                // The print itself is what is recomputed.
                (Verdict::Agrees, off) => assert_eq!(off, Some(row.residual), "{row:?}"),
                // A correction shows a number that is really off.
                (_, Some(off)) => assert!(off > 10.0 * row.tolerance, "{row:?}"),
                (_, None) => assert!(!row.equation.starts_with('('), "{row:?}"),
            }
            let own = row.verdict == Verdict::Found;
            assert_eq!(own, row.equation == "finding", "{row:?}");
            assert_eq!(own, row.printed.is_empty(), "{row:?}");
        }
        let twice = recomputed(&Desk::new(Some(1)).unwrap()).unwrap();
        assert_eq!(rows, twice);
    }

    #[test]
    fn a_row_that_disagrees_with_its_reference_is_told() {
        let mut rows = flight::ROWS[0]().unwrap();
        assert!(rows[0].holds());
        rows[0].residual = 2.0 * rows[0].tolerance;
        assert!(!rows[0].holds());
        rows[0].residual = f64::NAN;
        assert!(!rows[0].holds());
    }
}
