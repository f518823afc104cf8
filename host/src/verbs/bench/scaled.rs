//! The cost of an impact by how many are made: table and picture.

use super::Arguments;
use crate::bench::scaling;
use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture, Unit};
use crate::refusal::{Exit, Refusal};
use crate::report::{Printout, Table, columns};

/// Measures and prints.
pub(super) fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.drawn.output()?;
    let most = arguments.impacts.unwrap_or(10_000_000);
    let points = scaling::points(most, arguments.rounds(11), desk)?;
    let mut table = Table::new(&[
        columns::KERNEL,
        columns::IMPACTS,
        columns::IMPACT_TIME.digits(4),
        columns::IMPACT_TIME_ON_TWO_THREADS.digits(4),
        columns::SPEED_UP.digits(3),
    ]);
    for point in &points {
        let [alone, two] = point.nanoseconds;
        table.push([
            point.kernel.into(),
            (point.impacts as u64).into(),
            alone.into(),
            two.into(),
            (alone / two).into(),
        ]);
    }
    let report =
        Printout::new(table).heading("Cost of an impact by how many are made at k 0.34, R 0.2");
    report.print(arguments.printed.format)?;
    output.write(&report, || picture(&points))?;
    Ok(Exit::Done)
}

/// Cost of an impact over how many are made, both in decades.
fn picture(points: &[scaling::Point]) -> Picture {
    let times = || points.iter().flat_map(|point| point.nanoseconds);
    let (least, most) = (
        times().fold(f64::INFINITY, f64::min),
        times().fold(0.0, f64::max),
    );
    let impacts = points.iter().map(|point| point.impacts as f64);
    let mut panel = Panel::new(
        Axis::new(
            "Impacts that are made",
            Unit::NONE,
            scaling::LEAST as f64,
            impacts.fold(10.0 * scaling::LEAST as f64, f64::max),
        )
        .logarithmic(),
        Axis::new(
            "Time of an impact",
            Unit::new("ns"),
            0.5 * least,
            2.0 * most,
        )
        .logarithmic(),
    )
    .height(320.0);
    let mut series = 0;
    for kernel in ["f64", "batch"] {
        for (n, threads) in ["1 thread", "2 threads"].into_iter().enumerate() {
            let of = points.iter().filter(|point| point.kernel == kernel);
            let line = of.map(|point| (point.impacts as f64, point.nanoseconds[n]));
            panel = panel.line(&format!("{kernel}, {threads}"), series, line.collect());
            series += 1;
        }
    }
    Picture::new("Cost of an impact by how many are made")
        .caption("k 0.34, R 0.2: f64 one orbit after the other, batch in blocks of orbits")
        .panel(panel)
}
