//! `kband paper`: every equation, number and claim of the paper, printed and recomputed.

mod claims;
mod engine;
mod flight;
mod hopping;
mod lock;

use engine::Row;

use crate::arguments::FormatArguments;
use crate::desk::Desk;
use crate::refusal::{Exit, Result};
use crate::report::fields;

/// Check every equation, number and claim of the paper (Hongler & Figour 1989): printed,
/// recomputed, verdict.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband paper
  kband paper --format json

Each row is recomputed from the exact map and compared with an independent reference: an integration \
of the equations of motion, a second formula, or a 20-digit value. residual is the largest \
deviation over all cases. If it exceeds tolerance, the row fails and the exit status is 1. \
printed_error is the same deviation of the literal print. Claims of the text and findings of our \
own are rows without a number.")]
pub struct Arguments {
    #[command(flatten)]
    printed: FormatArguments,
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let rows = recompute(desk)?;
    let report = lines().printout(&rows).note(summarize(&rows)).heading(
        "M.-O. Hongler, J. Figour, Periodic versus chaotic dynamics in vibratory feeders, Helv. Phys. Acta (1989)",
    );
    report.print(arguments.printed.format)?;
    let all_hold = rows.iter().all(Row::holds);
    Ok(if all_hold {
        Exit::Done
    } else {
        Exit::CheckFailed
    })
}

fn recompute(desk: &Desk) -> Result<Vec<Row>> {
    let motion = [flight::CHECKS, lock::CHECKS].concat();
    let checks = [&motion, hopping::CHECKS, claims::CHECKS].concat();
    engine::recompute(&checks, 0.0, desk)
}

fn summarize(rows: &[Row]) -> String {
    let count = |verdict: &str| rows.iter().filter(|row| row.verdict == verdict).count();
    let verdicts = ["agrees", "corrected", "refuted", "own finding"];
    let ([agree, corrected, refuted, own], all) = (verdicts.map(count), rows.len());
    let end = match rows.iter().filter(|row| !row.holds()).count() {
        0 => "every recomputation agrees with its reference".into(),
        failed => format!("{failed} recomputations DISAGREE with their reference"),
    };
    let cases: u64 = rows.iter().map(|row| row.evidence.cases).sum();
    format!(
        "{all} rows: {agree} agree, {corrected} corrected, {refuted} refuted, {own} findings of our own; {cases} cases; {end}"
    )
}

fields! {
    fn lines(row: Row) {
        all EQUATION => row.equation.clone();
        all SUBJECT => row.subject.clone();
        all PRINTED => row.printed.clone();
        all RECOMPUTED => row.recomputed.clone();
        all VERDICT => row.verdict.clone();
        all RESIDUAL.digits(2) => row.evidence.residual;
        all TOLERANCE.digits(2) => row.tolerance;
        all PRINTED_ERROR.digits(2) => row.evidence.printed_error;
        all CASES => row.evidence.cases;
        all HOLDS => row.holds();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::OnceLock;

    use super::*;

    /// The rows, recomputed once for all tests, on two threads.
    fn rows() -> &'static [Row] {
        static ROWS: OnceLock<Vec<Row>> = OnceLock::new();
        ROWS.get_or_init(|| recompute(&Desk::new(Some(2))).unwrap())
    }

    /// Number, printed form and verdict of every equation, copied from the paper independently.
    const PRINTED: &str = include_str!("../../../../tests/reference/paper.tsv");

    #[test]
    fn the_table_has_each_equation_with_print_and_verdict() {
        let numbered = rows().iter().filter(|row| row.equation.starts_with('('));
        let numbered = numbered.map(|row| vec![&*row.equation, &row.printed, &row.verdict]);
        let numbered: Vec<_> = numbered.collect();
        let printed = PRINTED.lines().filter(|line| !line.starts_with('#'));
        let printed: Vec<Vec<&str>> = printed.map(|line| line.split('\t').collect()).collect();
        assert_eq!(numbered, printed);
    }

    #[test]
    fn every_row_holds_and_shows_its_evidence() {
        for row in rows() {
            let evidence = &row.evidence;
            assert!(row.holds(), "{row:?}");
            assert!(evidence.cases > 0 && !row.recomputed.is_empty(), "{row:?}");
            for n in 1..=9 {
                let open = format!("{{{n}}}");
                assert!(!row.printed.contains(&open) && !row.recomputed.contains(&open));
            }
            match (row.verdict.as_str(), evidence.printed_error) {
                // The recomputed form is the printed form.
                ("agrees", off) => assert_eq!(off, Some(evidence.residual), "{row:?}"),
                // The printed form of a corrected row fails its check.
                (_, Some(off)) => assert!(off > 10.0 * row.tolerance, "{row:?}"),
                (_, None) => assert!(!row.equation.starts_with('('), "{row:?}"),
            }
            let own = row.verdict == "own finding";
            assert_eq!(own, row.equation == "finding", "{row:?}");
            assert_eq!(own, row.printed.is_empty(), "{row:?}");
        }
    }

    #[test]
    fn a_formula_off_by_a_thousandth_fails_its_row() {
        // Rows that compare with a bound have no exact reference.
        let bounded = ["(5)", "(12a,b)", "(18)", "finding lead"];
        let checks = [flight::CHECKS, lock::CHECKS].concat();
        let off = engine::recompute(&checks, 1e-3, &Desk::new(Some(2))).unwrap();
        let exact = |row: &&Row| row.evidence.cases > 0 && row.tolerance < 1e-3;
        let failed = off.iter().filter(exact).filter(|row| !row.holds()).count();
        assert_eq!(failed, off.iter().filter(exact).count() - bounded.len());
    }
}
