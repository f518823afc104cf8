//! The comparison as one self-contained page with pictures.

use super::engine::Row;
use super::figures;
use super::summarize;
use crate::desk::Desk;
use crate::page::escaped;
use crate::picture::Theme;
use crate::provenance;
use crate::refusal::Refusal;
use crate::report::{number, when};
use crate::verbs::map::transport;

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

pub(super) fn page(
    rows: &[Row],
    restitution: f64,
    theme: Theme,
    desk: &Desk,
) -> Result<String, Refusal> {
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
    use super::*;

    #[test]
    fn a_page_links_to_nothing_marks_failures_and_repeats_no_id() {
        let rows = crate::verbs::map::paper::tests::rows();
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
