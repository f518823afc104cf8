//! `kband paper`: every equation, number and claim of the paper, printed and recomputed.

mod claims;
mod engine;
mod figures;
mod flight;
mod hopping;
mod lock;

use std::path::PathBuf;

use engine::{Check, Row};

use crate::arguments::{self, FormatArguments};
use crate::desk::Desk;
use crate::file::Destination;
use crate::page::escaped;
use crate::picture::Theme;
use crate::provenance;
use crate::refusal::{Exit, Result};
use crate::report::{Printout, fields, number, when};
use crate::verbs::map::transport;

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
    let failed = rows.iter().filter(|row| !row.holds);
    let failed = failed.map(|row| format!("{} {}", row.equation, row.subject));
    let failed: Vec<String> = failed.collect();
    report(&rows).print(arguments.printed.format)?;
    if let Some(target) = target {
        let page = page(&rows, arguments.restitution, arguments.theme, desk)?;
        target.write_bytes(page.as_bytes())?;
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
    format!(
        "{all} rows: {agree} agree, {corrected} corrected, {refuted} refuted, {own} findings of our own"
    )
}

fields! {
    fn lines(row: Row) {
        all EQUATION => row.equation.clone();
        all SUBJECT => row.subject.clone();
        all PRINTED => row.printed.clone();
        all RECOMPUTED => row.recomputed.clone();
        all VERDICT => row.verdict.clone();
        all RESIDUAL.digits(2) => row.residual;
        all TOLERANCE.digits(2) => row.tolerance;
        all PRINTED_ERROR.digits(2) => row.printed_error;
        all CASES => row.cases;
        all HOLDS => row.holds;
    }
}

fn report(rows: &[Row]) -> Printout {
    let end = match rows.iter().filter(|row| !row.holds).count() {
        0 => "every recomputation agrees with its reference".into(),
        failed => format!("{failed} recomputations DISAGREE with their reference"),
    };
    let cases: u64 = rows.iter().map(|row| row.cases).sum();
    lines()
        .printout(rows)
        .heading("M.-O. Hongler, J. Figour, Periodic versus chaotic dynamics in vibratory feeders, Helv. Phys. Acta (1989)")
        .note(format!("{}; {cases} cases; {end}", summarize(rows)))
}

const STYLE: &str = "
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1180px; margin: 2em auto; padding: 0 1em; }
body.dark { background: #14181d; color: #ececec; }
table { border-collapse: collapse; width: 100%; font-size: 13px; }
th, td { text-align: left; vertical-align: top; padding: 4px 8px; border-bottom: 1px solid #8886; }
td.number { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
td.verdict { white-space: nowrap; font-weight: 600; }
tr.fails td { background: #b03a00; color: #fff; }
figure { margin: 2em 0; } figure svg { max-width: 100%; height: auto; }
figcaption { font-size: 14px; }
";

fn page(rows: &[Row], restitution: f64, theme: Theme, desk: &Desk) -> Result<String> {
    let r = number(restitution, 4);
    let conveying = |options: &str| transport::picture(options, desk);
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
            figures::regimes(restitution, desk)?,
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
    let dark = when(theme == Theme::Dark, || " class=\"dark\"");
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width\">\
         <meta name=\"provenance\" content=\"{}\">\
         <title>The paper, recomputed</title><style>{STYLE}</style></head><body{dark}>\n\
         <h1>The paper, recomputed</h1>\n<p>M.-O. Hongler, J. Figour, <em>Periodic versus chaotic dynamics in \
         vibratory feeders</em>, Helv. Phys. Acta (1989). Each row is recomputed from the exact map and compared \
         with a reference of its own; the residual is the largest deviation over all cases.</p>\n\
         <p><strong>{}. {}</strong></p>\n{}",
        escaped(&provenance::line()),
        summarize(rows),
        match rows.iter().filter(|row| !row.holds).count() {
            0 => "Every recomputation agrees with its reference.".into(),
            failed => format!("{failed} recomputations disagree with their reference."),
        },
        table(rows),
    );
    for (n, (picture, caption)) in pictures.iter().enumerate() {
        page.push_str(&format!(
            "<figure>\n{}\n<figcaption>{}</figcaption></figure>\n",
            picture.to_svg_element(theme, &format!("p{n}")),
            escaped(caption)
        ));
    }
    page.push_str("</body></html>\n");
    Ok(page)
}

fn table(rows: &[Row]) -> String {
    let mut table = String::from(
        "<table><thead><tr><th>equation</th><th>subject</th><th>printed</th><th>recomputed</th>\
         <th>verdict</th><th>residual</th><th>allowed</th><th>printed is off by</th><th>cases</th></tr></thead>\
         <tbody>\n",
    );
    for row in rows {
        let (begin, verdict) = if row.holds {
            ("<tr>", row.verdict.as_str())
        } else {
            ("<tr class=\"fails\">", "recomputation fails")
        };
        table.push_str(begin);
        for word in [&row.equation, &row.subject, &row.printed, &row.recomputed] {
            table.push_str(&format!("<td>{}</td>", escaped(word)));
        }
        table.push_str(&format!("<td class=\"verdict\">{verdict}</td>"));
        let off = row.printed_error.map(|off| number(off, 2));
        for value in [
            number(row.residual, 2),
            number(row.tolerance, 2),
            off.unwrap_or_default(),
            row.cases.to_string(),
        ] {
            table.push_str(&format!("<td class=\"number\">{value}</td>"));
        }
        table.push_str("</tr>\n");
    }
    table + "</tbody></table>\n"
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
            assert!(row.holds, "{row:?}");
            assert!(row.cases > 0 && !row.recomputed.is_empty(), "{row:?}");
            for n in 1..=9 {
                let open = format!("{{{n}}}");
                assert!(!row.printed.contains(&open) && !row.recomputed.contains(&open));
            }
            match (row.verdict.as_str(), row.printed_error) {
                // The recomputed form is the printed form.
                ("agrees", off) => assert_eq!(off, Some(row.residual), "{row:?}"),
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
        let exact = |row: &&Row| row.cases > 0 && row.tolerance < 1e-3;
        let failed = off.iter().filter(exact).filter(|row| !row.holds).count();
        assert_eq!(failed, off.iter().filter(exact).count() - bounded.len());
    }

    #[test]
    fn a_page_links_to_nothing_marks_failures_and_repeats_no_id() {
        let rows = rows();
        let text = table(rows);
        assert_eq!(text.matches("<tr>").count(), rows.len() + 1);
        assert!(!text.contains("class=\"fails\""));
        let mut broken = rows[0].clone();
        broken.holds = false;
        assert!(table(&[broken]).contains("class=\"fails\""));
        let page = page(rows, 0.2, Theme::Light, &Desk::new(Some(2)).unwrap()).unwrap();
        assert!(!page.contains("href=\"http"));
        let after = |mark| {
            let rests = page.split(mark).skip(1);
            rests.filter_map(|rest| rest.split(['"', ')']).next())
        };
        let ids: Vec<&str> = after(" id=\"").collect();
        let unique: std::collections::BTreeSet<&str> = ids.iter().copied().collect();
        assert!(ids.len() >= 7, "{ids:?}");
        assert_eq!(ids.len(), unique.len(), "an id stands twice: {ids:?}");
        assert!(after("url(#").all(|id| unique.contains(id)));
    }
}
