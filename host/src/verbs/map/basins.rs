//! `kband basins`: basins of attraction of the regimes, over phase (rad) and velocity (`b w`).

use std::f64::consts::TAU;
use std::sync::Arc;

use kband::impact::{Kernel, Map, PartState};
use kband::regime::Lock;
use kband::regime::classify::Regime;
use serde_json::json;

use crate::arguments::{self, AmplitudeArguments, ContactArguments, NoScatter, OutputArguments};
use crate::desk::Desk;
use crate::ending::{self, Endings, FILLS, MAX_ORBIT_IMPACTS, ORBITS_PER_BLOCK};
use crate::picture::{Axis, Grid, Panel, Picture};
use crate::refusal::{Exit, Result};
use crate::report::columns::{PHASE, REGIME, VELOCITY};
use crate::report::{counted, fields, number, numbers};

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
    #[arg(long, value_name = "N", default_value_t = MAX_ORBIT_IMPACTS, value_parser = arguments::count(10, 10_000_000))]
    impacts: usize,
    #[command(flatten)]
    contact: ContactArguments,
    #[command(flatten)]
    scatter: NoScatter,
    #[command(flatten)]
    output: OutputArguments,
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let output = arguments.output.check()?;
    arguments.scatter.check(
        "with scatter the long-term motion does not depend on the start, and there is no final regime",
        "kband gear --scatter computes the share of time in gear",
    )?;
    // clap requires --k or --b.
    let k = (arguments.amplitude.or_k(arguments.k)?).unwrap_or(f64::NAN);
    let drive_text = arguments.amplitude.describe(k)?;
    let contact = arguments.contact.time(arguments.amplitude.hertz())?;
    let endings = Endings::with_contact(k, arguments.restitution, arguments.impacts, contact)?;
    let side = arguments.grid;
    let top = arguments.velocity;
    let ends: Arc<[Regime]> = ends(&endings, side, top, desk)?.into();
    let mut counts = counted(ends.iter().copied());
    let rank = |regime| {
        let fill = ending::fill(regime);
        FILLS.iter().position(|(entry, _)| *entry == fill)
    };
    counts.sort_by_key(|(regime, count)| (rank(*regime), std::cmp::Reverse(*count)));
    let share = |count: usize| count as f64 / ends.len() as f64;
    let followed = arguments.impacts;
    let row = |(end, count)| (ending::describe_regime(end, followed), share(count), count);
    let rows: Vec<Share> = counts.into_iter().map(row).collect();
    let from_rest = ending::describe_regime(endings.from_rest(), followed);
    let shared = Arc::clone(&ends);
    let [r, highest] = numbers([arguments.restitution, top], 6);
    let contact = arguments.contact.describe();
    let report = shares()
        .printout(&rows)
        .heading(format!(
            "Where parts end at {drive_text}, R = {r}{contact}: {side} x {side} starts, phase 0..2 pi, velocity 0..{highest} b w"
        ))
        .note(format!("A part that starts from rest: {from_rest}"))
        .json(json!({
            "k": k,
            "restitution": arguments.restitution,
            "shares": shares().objects(&rows),
            "from_rest": from_rest,
        }))
        .csv(
            &[PHASE, VELOCITY, REGIME],
            move |rows| {
                shared.iter().enumerate().try_for_each(|(n, end)| {
                    let start = start(n, side, top);
                    rows.row(&[
                        start.phase.into(),
                        start.velocity.into(),
                        ending::describe_regime(*end, followed).into(),
                    ])
                })
            },
        );
    output.show(&report, || picture(arguments, &drive_text, &endings, &ends))
}

type Share = (String, f64, usize);

fields! {
    fn shares(row: Share) {
        all REGIME => row.0.clone();
        all SHARE.digits(4) => row.1;
        all STARTS => row.2;
    }
}

/// The start at the centre of a cell.
fn start(cell: usize, side: usize, top: f64) -> PartState {
    let middle = |n: usize, span: f64| span * (n as f64 + 0.5) / side as f64;
    PartState::new(middle(cell % side, TAU), middle(cell / side, top))
}

/// Final regimes of starts at the centres of `side * side` cells, row by row. Phases are 0..2 pi,
/// velocities 0..`top`.
pub fn ends(endings: &Endings, side: usize, top: f64, desk: &Desk) -> Result<Vec<Regime>> {
    Map::state(0.0, top)?;
    // Long blocks keep the registers full; short ones suit any number of threads.
    let rows = (side * side / 64).max(ORBITS_PER_BLOCK).div_ceil(side);
    let ends = desk.map("basins", side.div_ceil(rows), |task| {
        let all = task * rows..side.min((task + 1) * rows);
        let cells = all.start * side..all.end * side;
        endings.classify_all(cells.map(|cell| start(cell, side, top)))
    })?;
    Ok(ends.into_iter().flatten().collect())
}

fn picture(arguments: &Arguments, drive_text: &str, endings: &Endings, ends: &[Regime]) -> Picture {
    let r = number(arguments.restitution, 6);
    let contact = arguments.contact.describe();
    let (grid, impacts) = (arguments.grid, arguments.impacts);
    let fills = ends.iter().map(|end| ending::fill(*end)).collect();
    let locks = endings.locks().map(Lock::state);
    let locks = locks.filter(|state| state.velocity <= arguments.velocity);
    let locks = locks.map(|state| (state.phase, state.velocity)).collect();
    let phase = Axis::new("phase t of the drive at the start", "rad", 0.0, TAU).in_pi();
    let velocity = Axis::new("velocity ψ at the start", "b·ω", 0.0, arguments.velocity);
    let panel = Panel::new(phase, velocity)
        .height(560.0)
        .classes(Grid::new(grid, fills), &ending::name_shares(ends))
        .markers("the locked orbit", 1, locks);
    Picture::new("Where a part ends, by how it starts")
        .width(780.0)
        .panel(panel)
        .caption(format!(
            "{drive_text}, R = {r}{contact}; {grid} × {grid} starts, up to {impacts} impacts each"
        ))
}
