//! `kband basins`: basins of attraction of the regimes, over phase (rad) and velocity (`b w`).
//!
//! Every cell's middle is a start that is simulated on the exact map until its regime is decided.

use std::f64::consts::TAU;
use std::sync::Arc;

use kband::impact::{Kernel, Map, PartState};
use kband::regime::Lock;
use kband::regime::classify::Regime;
use serde_json::json;

use crate::arguments::{self, AmplitudeArguments, ContactArguments, NoScatter, Shown};
use crate::desk::Desk;
use crate::ending::{self, Endings, FILLS, FOLLOWED, TOGETHER};
use crate::picture::{Axis, Fill, Grid, Panel, Picture};
use crate::refusal::{Exit, Refusal};
use crate::report::{Printout, Table, columns, number};

/// Compute basins of attraction: the final regime of each start, over its phase and velocity.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband basins --k 0.43 --restitution 0.2
  kband basins --k 0.43 --restitution 0.2 --grid 400 --out basins.png
  kband basins --b 0.235 --frequency 50 --restitution 0.2
  kband basins --k 0.7 --restitution 0.5 --velocity 4 --out basins.csv

The table has the share of starts in each regime; CSV has a row for each start.")]
pub struct Arguments {
    /// k = g cos(alpha) / (b w^2).
    #[arg(long, required_unless_present = "b", value_parser = arguments::within(0.001, 1000.0, ""))]
    k: Option<f64>,

    #[command(flatten)]
    amplitude: AmplitudeArguments,

    /// Restitution of the part.
    #[arg(long, value_name = "R", value_parser = arguments::within(0.0, 0.999, ""))]
    restitution: f64,

    /// Number of starts along each side of the grid.
    #[arg(long, value_name = "N", default_value = "200", value_parser = arguments::count(2, 4000))]
    grid: usize,

    /// Velocity at the upper edge of the grid, units of b w.
    #[arg(long, value_name = "PSI", default_value = "3", value_parser = arguments::within(1e-6, 1000.0, "b w"))]
    velocity: f64,

    /// Number of impacts after which a start without a final regime counts as undecided.
    #[arg(long, value_name = "N", default_value_t = FOLLOWED, value_parser = arguments::count(10, 10_000_000))]
    impacts: usize,

    #[command(flatten)]
    contact: ContactArguments,

    #[command(flatten)]
    scatter: NoScatter,

    #[command(flatten)]
    shown: Shown,
}

/// Draws the basins.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.shown.output()?;
    arguments.scatter.check(
        "with scatter the long-term motion does not depend on the start, and there is no final regime",
        "kband gear --scatter computes the share of time in gear",
    )?;
    let k = wanted(arguments)?;
    let drive_text = arguments.amplitude.describe(k)?;
    let contact = arguments.contact.time(arguments.amplitude.hertz())?;
    let endings = Endings::with_contact(k, arguments.restitution, arguments.impacts, contact)?;
    let side = arguments.grid;
    let top = arguments.velocity;
    let starts = Starts { side, top };
    let rows = ends(&endings, side, top, desk)?;
    let ends: Arc<[Regime]> = rows.into();
    let mut counts: Vec<(Regime, usize)> = Vec::new();
    for end in ends.iter() {
        match counts.iter_mut().find(|(known, _)| known == end) {
            Some((_, count)) => *count += 1,
            None => counts.push((*end, 1)),
        }
    }
    let rank = |regime| {
        FILLS
            .iter()
            .position(|(fill, _)| *fill == ending::fill(regime))
    };
    counts.sort_by_key(|(regime, count)| (rank(*regime), std::cmp::Reverse(*count)));
    let share = |count: usize| count as f64 / ends.len() as f64;
    let mut table = Table::new(&[columns::REGIME, columns::SHARE.digits(4), columns::STARTS]);
    for (end, count) in &counts {
        table.push([
            ending::describe_regime(*end, arguments.impacts).into(),
            share(*count).into(),
            (*count).into(),
        ]);
    }
    let shares: Vec<_> = counts
        .iter()
        .map(|(end, count)| json!({"regime": ending::describe_regime(*end, arguments.impacts), "share": share(*count), "starts": count}))
        .collect();
    let listed = Arc::clone(&ends);
    let followed = arguments.impacts;
    let report = Printout::new(table)
        .heading(format!(
            "Where parts end at {drive_text}, R = {}{}: {side} x {side} starts, phase 0..2 pi, velocity 0..{} b w",
            number(arguments.restitution, 6),
            arguments.contact.words(),
            number(top, 6)
        ))
        .note(format!("A part that starts from rest: {}", ending::describe_regime(endings.from_rest(), arguments.impacts)))
        .json(&json!({
            "k": k,
            "restitution": arguments.restitution,
            "shares": shares,
            "from_rest": ending::describe_regime(endings.from_rest(), arguments.impacts),
        }))?
        .csv(
            &[
                columns::PHASE,
                columns::VELOCITY,
                columns::REGIME,
            ],
            move |rows| {
                listed.iter().enumerate().try_for_each(|(n, end)| {
                    rows.row(&[
                        starts.phase(n % side).into(),
                        starts.velocity(n / side).into(),
                        ending::describe_regime(*end, followed).into(),
                    ])
                })
            },
        );
    output.show(&report, || {
        picture(arguments, &drive_text, &endings, &ends, &counts)
    })
}

/// Starts on a square grid: the middles of its cells.
#[derive(Clone, Copy, Debug)]
struct Starts {
    side: usize,
    top: f64,
}

impl Starts {
    fn phase(self, column: usize) -> f64 {
        TAU * (column as f64 + 0.5) / self.side as f64
    }

    fn velocity(self, row: usize) -> f64 {
        self.top * (row as f64 + 0.5) / self.side as f64
    }
}

/// Final regimes of starts in the middles of `side * side` cells, row by row. Phases are 0..2 pi,
/// velocities 0..`top`.
pub(super) fn ends(
    endings: &Endings,
    side: usize,
    top: f64,
    desk: &Desk,
) -> Result<Vec<Regime>, Refusal> {
    Map::state(0.0, top)?;
    let starts = Starts { side, top };
    // Long blocks keep the registers full except for a few last orbits; short ones suit any number
    // of threads.
    let rows = (side * side / 64).max(TOGETHER).div_ceil(side);
    let ends = desk.map("basins", side.div_ceil(rows), |task| {
        let all = task * rows..side.min((task + 1) * rows);
        let start = |n| PartState {
            phase: starts.phase(n % side),
            velocity: starts.velocity(n / side),
        };
        endings.of_all((all.start * side..all.end * side).map(start))
    })?;
    Ok(ends.into_iter().flatten().collect())
}

/// k, from `--k` or `--b`; clap requires one of them.
fn wanted(arguments: &Arguments) -> Result<f64, Refusal> {
    let k = arguments.amplitude.or_k(arguments.k)?;
    Ok(k.unwrap_or(f64::NAN))
}

fn picture(
    arguments: &Arguments,
    drive_text: &str,
    endings: &Endings,
    ends: &[Regime],
    counts: &[(Regime, usize)],
) -> Picture {
    // Regimes that share a fill share a line of the legend.
    let mut legend: Vec<(Fill, String, usize)> = Vec::new();
    for (regime, count) in counts {
        let fill = ending::fill(*regime);
        match legend.iter_mut().find(|(known, ..)| *known == fill) {
            Some((_, name, sum)) => {
                *sum += count;
                let general = FILLS.iter().find(|(known, _)| *known == fill);
                *name = general.map_or("", |(_, name)| name).into();
            }
            None => legend.push((
                fill,
                ending::describe_regime(*regime, arguments.impacts),
                *count,
            )),
        }
    }
    let names: Vec<(Fill, String)> = legend
        .into_iter()
        .map(|(fill, name, count)| {
            let share = 100.0 * count as f64 / ends.len() as f64;
            (fill, format!("{name}: {share:.1} %"))
        })
        .collect();
    let fills = ends.iter().map(|end| ending::fill(*end)).collect();
    let locks = endings
        .locks()
        .map(Lock::state)
        .filter(|state| state.velocity <= arguments.velocity)
        .map(|state| (state.phase, state.velocity))
        .collect();
    let panel = Panel::new(
        Axis::new("phase t of the drive at the start", "rad", 0.0, TAU).in_pi(),
        Axis::new("velocity ψ at the start", "b·ω", 0.0, arguments.velocity),
    )
    .height(560.0)
    .classes(Grid::new(arguments.grid, fills), &names)
    .markers("the locked orbit", 1, locks);
    Picture::new("Where a part ends, by how it starts")
        .width(780.0)
        .panel(panel)
        .caption(format!(
            "{drive_text}, R = {}{}; {} × {} starts, up to {} impacts each",
            number(arguments.restitution, 6),
            arguments.contact.words(),
            arguments.grid,
            arguments.grid,
            arguments.impacts
        ))
}
