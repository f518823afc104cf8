//! `kband cascade`: the period doublings below a band.

use kband::regime::cascade::{Cascade, CascadeEnd, FEIGENBAUM, HIGHEST_DOUBLINGS};

use crate::arguments::{self, Drawn, NoScatter, Printed};
use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture, Unit};
use crate::refusal::{Exit, Refusal};
use crate::report::{Column, Printout, Table, number};

/// Where the locked orbit doubles its period, and doubles again, down to chaos.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband cascade --restitution 0.2 --order 1 --doublings 6
  kband cascade --restitution 0.2 --out cascade.svg
  kband cascade --restitution 0.5 --order 2 --doublings 5 --format json

JSON has flips (k of the 1->2, 2->4, ... flips), ratios of their gaps and k_infinity.")]
pub struct Arguments {
    /// Restitution of the part, 0..1, 1 excluded.
    #[arg(long, value_name = "R", default_value = "0.2", value_parser = arguments::number)]
    restitution: f64,

    /// Drive cycles per impact of the lock that doubles.
    #[arg(long, value_name = "r", default_value = "1", value_parser = arguments::count(1, 100))]
    order: usize,

    /// Flips to locate.
    #[arg(long, value_name = "N", default_value = "6", value_parser = arguments::count(1, HIGHEST_DOUBLINGS))]
    doublings: usize,

    #[command(flatten)]
    scatter: NoScatter,

    #[command(flatten)]
    printed: Printed,

    #[command(flatten)]
    drawn: Drawn,
}

/// Prints the flips and draws them.
pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.drawn.output()?;
    arguments.scatter.check(
        "what scatters repeats nothing that could double",
        "ask kband exponent --scatter for what is left of the cascade",
    )?;
    let cascade = Cascade::locate(
        arguments.restitution,
        arguments.order as u32,
        arguments.doublings,
    )?;
    let report = report(arguments, &cascade)?;
    report.print(arguments.printed.format)?;
    output.write(&report, || picture(arguments, &cascade))?;
    Ok(Exit::Done)
}

/// Where each flip lies, and how fast their gaps shrink.
fn picture(arguments: &Arguments, cascade: &Cascade) -> Picture {
    let flips = cascade.flips();
    let last = flips.len() as f64 + 0.5;
    let numbered = || Axis::new("flip, 1 for 1 → 2 impacts a period", Unit::NONE, 0.5, last);
    let points: Vec<(f64, f64)> = flips
        .iter()
        .enumerate()
        .map(|(n, k)| ((n + 1) as f64, *k))
        .collect();
    let mut places = Panel::new(
        numbered(),
        Axis::around("k = g cos α / (b ω²)", Unit::NONE, flips.iter().copied()),
    )
    .height(230.0)
    .line("", 0, points.clone())
    .markers("flips", 0, points);
    if let Some(limit) = cascade.k_infinity() {
        places = places.level(limit.value, "chaos begins");
    }
    let gaps: Vec<(f64, f64)> = flips
        .windows(2)
        .enumerate()
        .map(|(n, pair)| ((n + 2) as f64, pair[0] - pair[1]))
        .collect();
    let mut picture = Picture::new("Period doublings down to chaos")
        .caption(format!(
            "R = {}, lock of order {}",
            number(arguments.restitution, 6),
            arguments.order
        ))
        .panel(places);
    if let (Some(first), Some(end)) = (gaps.first().copied(), gaps.last().copied()) {
        // Feigenbaum's law through the last gap, which has come closest to it.
        let law = gaps
            .iter()
            .map(|(n, _)| (*n, end.1 * FEIGENBAUM.powf(end.0 - n)));
        let axis = Axis::new(
            "gap to the flip before",
            Unit::NONE,
            0.4 * end.1,
            2.5 * first.1,
        );
        picture = picture.panel(
            Panel::new(numbered(), axis.logarithmic())
                .height(230.0)
                .line("shrinking by Feigenbaum's 4.669", 1, law.collect())
                .markers("gaps", 0, gaps),
        );
    }
    picture
}

fn report(arguments: &Arguments, cascade: &Cascade) -> Result<Printout, Refusal> {
    let mut table = Table::new(&[
        Column::new("flip", ""),
        Column::new("k", "").digits(15),
        Column::new("gap", "").digits(8),
        Column::new("ratio", "").digits(8),
    ]);
    let ratios: Vec<f64> = cascade.ratios().collect();
    let mut above = None;
    for (n, flip) in cascade.flips().iter().enumerate() {
        let impacts = 1_u32 << n;
        table.push([
            format!("{impacts} -> {}", 2 * impacts).into(),
            (*flip).into(),
            above.map(|above: f64| above - flip).into(),
            n.checked_sub(2).and_then(|n| ratios.get(n)).copied().into(),
        ]);
        above = Some(*flip);
    }
    let limit = cascade.k_infinity();
    let mut report = Printout::new(table).heading(format!(
        "R = {}, order {}: born at k1 = {:.15}",
        arguments.restitution,
        arguments.order,
        cascade.birth()
    ));
    if let Some(limit) = limit {
        report = report.note(format!(
            "chaos begins at k_infinity = {:.12} within {:.1e}; the ratios tend to {FEIGENBAUM:.5}",
            limit.value, limit.error
        ));
    }
    let complete = cascade.end() == CascadeEnd::Complete;
    if !complete {
        report = report.note(format!(
            "the flip after the last could not be followed: at R = {} the doubled orbit loses a flight or \
             the gaps have come down to rounding",
            arguments.restitution
        ));
    }
    let number = |value: Option<f64>| value.map_or(serde_json::Value::Null, Into::into);
    report.json(&serde_json::json!({
        "restitution": arguments.restitution,
        "order": arguments.order,
        "k1": cascade.birth(),
        "flips": cascade.flips(),
        "ratios": ratios,
        "k_infinity": number(limit.map(|limit| limit.value)),
        "k_infinity_error": number(limit.map(|limit| limit.error)),
        "complete": complete,
    }))
}
