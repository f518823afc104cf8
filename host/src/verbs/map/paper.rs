//! `kband paper`: every equation, number and claim of the paper, printed and recomputed.

mod claims;
mod engine;
mod figures;
mod flight;
mod hopping;
mod lock;

use std::path::PathBuf;

use engine::{Check, Row};
use kband::regime::band;
use serde_json::Value as Json;

use crate::arguments::{self, FormatArguments};
use crate::desk::Desk;
use crate::file::Destination;
use crate::page::{self, Page, escaped};
use crate::picture::{Picture, Theme};
use crate::refusal::{Exit, Result};
use crate::report::{Printout, fields, number};
use crate::verbs::map::{diagram, transport};

/// Check every equation, number and claim of the paper (Hongler & Figour 1989): printed,
/// recomputed, verdict.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband paper
  kband paper --format json
  kband paper --restitution 0.5 --out report.html

Each row is recomputed from the exact map and compared with an independent reference: an integration \
of the equations of motion, a second formula, or a 20-digit value. residual is the largest \
deviation over all cases. If it exceeds tolerance, the row fails and the exit status is 1. \
printed_error is the same deviation of the literal print. Claims of the text and findings of our \
own are rows without a number.")]
pub struct Arguments {
    /// Restitution of the part in the pictures of the page.
    #[arg(long, value_name = "R", default_value = "0.2", value_parser = arguments::within(0.05, 0.95, ""))]
    restitution: f64,
    /// Also write one self-contained page with table and pictures; the name ends in .html.
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
    /// Colours of the pictures.
    #[arg(long, value_enum, default_value_t = Theme::Light)]
    theme: Theme,
    #[command(flatten)]
    printed: FormatArguments,
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let out = arguments.out.as_deref();
    let target = out.map(|path| Destination::output(path, "html"));
    let target = target.transpose()?;
    if let Some(target) = &target {
        target.ends_in("--out", &["html", "htm"])?;
    }
    let rows = recompute(desk)?;
    let failed = rows.iter().filter(|row| !row.holds());
    let failed = failed.map(|row| format!("{} {}", row.equation, row.subject));
    let failed: Vec<String> = failed.collect();
    report(&rows).print(arguments.printed.format)?;
    if let Some(target) = target {
        let page = page(&rows, arguments.restitution, arguments.theme, desk)?;
        target.write_bytes(page.to_html().as_bytes())?;
        eprintln!("{}", target.describe_write());
    }
    if failed.is_empty() {
        return Ok(Exit::Done);
    }
    let failed = failed.join(", ");
    eprintln!("recomputation disagrees with its reference: {failed}");
    Ok(Exit::CheckFailed)
}

fn recompute(desk: &Desk) -> Result<Vec<Row>> {
    let checks: [&[Check]; 4] = [
        flight::CHECKS,
        lock::CHECKS,
        hopping::CHECKS,
        claims::CHECKS,
    ];
    engine::recompute(&checks.concat(), 0.0, desk)
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

const PAPER: &str = "M.-O. Hongler, J. Figour, Periodic versus chaotic dynamics in vibratory feeders, Helv. Phys. Acta (1989)";

fn report(rows: &[Row]) -> Printout {
    let report = lines().printout(rows).heading(PAPER);
    report.note(summarize(rows))
}

/// Script of the page, whose pictures are drawn already: it only names the colour switch.
const SCRIPT: &str = "coloured();\ndocument.documentElement.dataset.ready = \"\";\n";

fn page(rows: &[Row], restitution: f64, theme: Theme, desk: &Desk) -> Result<Page> {
    let r = number(restitution, 4);
    let conveying = |options: &str| transport::picture(options, desk);
    let highest = number(1.1 * band::birth(restitution, 1)?, 4);
    let over_k = format!("--restitution {r} --k 0.05..{highest} --starts rest,down");
    let pictures = [
        (
            figures::model(restitution)?,
            "Fig. 1, the model: a part on a track that swings by b normal to itself and by a along itself, \
             on an incline.",
        ),
        (
            figures::motion(restitution)?,
            "Fig. 2, a motion: the part strikes the track at τ₀, τ₁, … and flies freely between.",
        ),
        (
            diagram::picture(&over_k, desk)?,
            &format!(
                "Fig. 3, redrawn from data for R = {r}: the phases at which parts strike, over k, from \
                 rest and from the locks. Between the bands parts mostly hop, rest and are thrown off again."
            ),
        ),
        (
            conveying(&format!("--restitution {r}"))?,
            "Conveying speed over k. Locked parts travel at one speed whatever the amplitude; elsewhere the \
             speed grows with it.",
        ),
        (
            conveying("--restitution 0.9 --k 0.02..0.9:90 --amplitude-ratio 2")?,
            "Wide chaos, R = 0.9: the time mean grows like the amplitude and exceeds the bound (37) of the \
             impact mean.",
        ),
    ];
    let figure = |(n, (picture, caption)): (usize, &(Picture, &str))| {
        let svg = picture.to_svg(theme.into(), "", &format!("p{n}"));
        let caption = format!("<figcaption>{}</figcaption>", escaped(caption));
        format!("<figure><div class=\"wide\">\n{svg}</div>\n{caption}</figure>\n")
    };
    let figures: String = pictures.iter().enumerate().map(figure).collect();
    let text = [
        format!(
            "{PAPER}. Each row is recomputed from the exact map and compared with a reference of its own; the residual is \
             the largest deviation over all cases."
        ),
        format!("{}.", summarize(rows)),
    ];
    Ok(Page::new("The paper, recomputed", Json::Null, SCRIPT)
        .section(
            "Equations, numbers and claims",
            &(page::paragraphs(&text) + &table(rows)),
        )
        .section("Figures", &figures))
}

fn table(rows: &[Row]) -> String {
    let mut heads = lines().cells(rows);
    let body = heads.split_off(1);
    let heads = heads.iter().flatten().map(String::as_str);
    page::table(&heads.collect::<Vec<_>>(), &body)
}

#[cfg(test)]
mod tests {
    use std::sync::OnceLock;

    use super::*;

    /// The rows, recomputed once for all tests, on two threads.
    fn rows() -> &'static [Row] {
        static ROWS: OnceLock<Vec<Row>> = OnceLock::new();
        ROWS.get_or_init(|| recompute(&Desk::new(Some(2)).unwrap()).unwrap())
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
        for number in 1..=38 {
            let bare = |equation: &str| {
                let digits = equation[1..].chars().take_while(char::is_ascii_digit);
                digits.collect::<String>() == number.to_string()
            };
            let is_listed = numbered.iter().any(|row| bare(row[0]));
            assert!(is_listed, "({number}) is missing");
        }
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
        let off = engine::recompute(&checks, 1e-3, &Desk::new(Some(2)).unwrap()).unwrap();
        let exact = |row: &&Row| row.evidence.cases > 0 && row.tolerance < 1e-3;
        let failed = off.iter().filter(exact).filter(|row| !row.holds()).count();
        assert_eq!(failed, off.iter().filter(exact).count() - bounded.len());
    }

    #[test]
    fn a_page_links_to_nothing_marks_failures_and_repeats_no_id() {
        let rows = rows();
        let text = table(rows);
        assert_eq!(text.matches("<tr>").count(), rows.len() + 1);
        let fails = "<td>no</td>";
        assert!(!text.contains(fails));
        let mut broken = rows[0].clone();
        broken.evidence.residual = f64::NAN;
        assert!(table(&[broken]).contains(fails));
        let page = page(rows, 0.2, Theme::Light, &Desk::new(Some(2)).unwrap()).unwrap();
        let page = page.to_html();
        assert!(!page.contains("href=\"http"));
        let after = |mark| {
            let rests = page.split(mark).skip(1);
            rests.filter_map(|rest| rest.split(['"', ')']).next())
        };
        let ids: Vec<&str> = after(" id=\"").collect();
        let unique: std::collections::BTreeSet<&str> = ids.iter().copied().collect();
        assert!(ids.len() >= 7, "{ids:?}");
        assert_eq!(ids.len(), unique.len(), "an id stands twice: {ids:?}");
        let mut own = after("url(#").filter(|id| id.starts_with('p'));
        assert!(own.all(|id| unique.contains(id)));
    }
}
