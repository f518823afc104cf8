//! `kband impacts`: the map itself, impact by impact.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use kband::impact::batch::{Block, LANES};
use kband::impact::{Exact, Hybrid, Impact, Integer, Kernel, Map, Single, State};

use crate::arguments::{self, Drawn};
use crate::desk::Desk;
use crate::file;
use crate::picture::{Axis, Panel, Picture, Unit};
use crate::refusal::{Exit, Refusal};
use crate::report::{Column, Format, Report, Table, number};

/// Consecutive impacts of one orbit, or one impact for each row of a file.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband impacts --k 0.43 --restitution 0.2 --phase 0.5 --velocity 0.45 --count 20
  kband impacts --k 0.35 --restitution 0.2 --phase 0.4 --velocity 0.4 --count 20000 --out portrait.svg
  kband impacts --from states.csv --arithmetic f64 --format csv

A file has the columns k,restitution,phase,velocity (others are ignored); each row gives \
flight,next_phase,next_velocity; they are empty, and standard error tells, where only the \
arithmetic cannot hold the row. Phases are in rad, velocities in units of b w.")]
pub struct Arguments {
    /// k = g cos(alpha) / (b w^2).
    #[arg(long, value_parser = arguments::number, required_unless_present = "from")]
    k: Option<f64>,

    /// Restitution of the part, 0..1.
    #[arg(long, value_name = "R", value_parser = arguments::number, required_unless_present = "from")]
    restitution: Option<f64>,

    /// Phase of the drive just after an impact, rad.
    #[arg(long, value_name = "T", value_parser = arguments::number, required_unless_present = "from")]
    phase: Option<f64>,

    /// Velocity relative to the track just after it, units of b w, at least 0.
    #[arg(long, value_name = "PSI", value_parser = arguments::number, required_unless_present = "from")]
    velocity: Option<f64>,

    /// Number of consecutive impacts.
    #[arg(long, value_name = "N", value_parser = arguments::count(1, 1_000_000), default_value = "1", conflicts_with = "from")]
    count: usize,

    /// CSV file with the columns k,restitution,phase,velocity.
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["k", "restitution", "phase", "velocity"])]
    from: Option<PathBuf>,

    /// Number system of the map.
    #[arg(long, value_enum, default_value_t = Arithmetic::F64)]
    arithmetic: Arithmetic,

    /// Form of the result on standard output.
    #[arg(long, value_enum, default_value_t = Format::Csv)]
    format: Format,

    #[command(flatten)]
    drawn: Drawn,
}

/// The number systems in which the map exists.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Arithmetic {
    /// f64, the desk's default.
    F64,
    /// f64 with a twofold residual: phases right to their rounding.
    F64Exact,
    /// Phase and velocity in fixed point, residual in i64, correction in f32: the board's default.
    Hybrid,
    /// Phase in u32, velocity in f32.
    F32,
    /// Phase in u32, velocity in i32, for a CPU without an FPU.
    Integer,
    /// f64 in the widest registers of this CPU, the same bits.
    Batch,
}

/// Prints the impacts and draws their phase portrait.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.drawn.output()?;
    let (table, states) = match arguments.arithmetic {
        Arithmetic::F64 => table::<Map>(arguments, desk, one_by_one)?,
        Arithmetic::F64Exact => table::<Exact>(arguments, desk, one_by_one)?,
        Arithmetic::Hybrid => table::<Hybrid>(arguments, desk, one_by_one)?,
        Arithmetic::F32 => table::<Single>(arguments, desk, one_by_one)?,
        Arithmetic::Integer => table::<Integer>(arguments, desk, one_by_one)?,
        Arithmetic::Batch => {
            let mut block = Block::new();
            table::<Map>(arguments, desk, |rows| in_blocks(&mut block, rows))?
        }
    };
    let report = Report::new(table.plain_header());
    report.print(arguments.format)?;
    output.write(&report, || portrait(arguments, states))?;
    Ok(Exit::Done)
}

/// Phase and velocity of the state after each impact.
type States = Vec<(f64, f64)>;

/// The phase portrait: the state after each impact, as large as it fits.
fn portrait(arguments: &Arguments, mut states: States) -> Picture {
    let (first, last) = occupied(&states);
    for (phase, _) in &mut states {
        if *phase > last {
            *phase -= TAU;
        }
    }
    let slowest = states
        .iter()
        .fold(f64::INFINITY, |low, state| low.min(state.1));
    let fastest = states.iter().fold(0.0_f64, |high, state| high.max(state.1));
    let room = 0.05 * (fastest - slowest);
    // Where the velocities reach far down, 0 is among them.
    let foot = if slowest > 0.3 * fastest {
        slowest - room
    } else {
        0.0
    };
    let panel = Panel::new(
        Axis::new(
            "phase t of the drive after the impact",
            Unit::RADIANS,
            first,
            last,
        )
        .in_pi(),
        Axis::new(
            "velocity ψ after the impact",
            Unit::VELOCITY,
            foot,
            fastest + room,
        ),
    )
    .height(460.0);
    let map = match (arguments.k, arguments.restitution) {
        (Some(k), Some(r)) => format!("k = {}, R = {}; ", number(k, 6), number(r, 6)),
        _ => String::new(),
    };
    let count = states.len();
    Picture::new("Phase portrait")
        .caption(format!("{map}{count} impacts"))
        .panel(panel.markers("impacts", 0, states))
}

/// The stretch of phases that holds all states with a little room, its start at or below 0 where it
/// holds 0: the turn without its widest gap, or the whole turn where no gap is wider than a third of it.
fn occupied(states: &States) -> (f64, f64) {
    let mut phases: Vec<f64> = states.iter().map(|state| state.0.rem_euclid(TAU)).collect();
    phases.sort_by(f64::total_cmp);
    let next = phases.iter().skip(1).copied();
    let again = phases.first().map(|first| first + TAU);
    let gaps = phases.iter().copied().zip(next.chain(again));
    let Some((from, until)) = gaps.max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0))) else {
        return (0.0, TAU);
    };
    let gap = until - from;
    if gap < TAU / 3.0 {
        return (0.0, TAU);
    }
    let room = (0.05 * (TAU - gap)).max(0.02);
    let first = if until >= TAU { until - TAU } else { until };
    let (low, high) = (first - room, first + TAU - gap + room);
    if high > TAU {
        (low - TAU, high - TAU)
    } else {
        (low, high)
    }
}

/// A map and the state it is applied to.
struct Row<K: Kernel> {
    kernel: K,
    state: K::State,
}

fn one_by_one<K: Kernel>(rows: &[Row<K>]) -> Vec<Impact<K::State>> {
    rows.iter()
        .map(|row| row.kernel.impact(row.state))
        .collect()
}

fn in_blocks(block: &mut Block, rows: &[Row<Map>]) -> Vec<Impact<State>> {
    let mut impacts = Vec::with_capacity(rows.len());
    for rows in rows.chunks(LANES) {
        for (lane, row) in rows.iter().enumerate() {
            // There is a lane for every row of a chunk.
            let _ = block.put(lane, &row.kernel, row.state);
        }
        block.advance(1);
        for (lane, row) in rows.iter().enumerate() {
            // A block leaves chatter that it can sum to its caller; here every hop is asked for.
            let impact = block.impact(lane).filter(|impact| impact.flight > 0.0);
            impacts.push(impact.unwrap_or_else(|| row.kernel.impact(row.state)));
            block.clear(lane);
        }
    }
    impacts
}

fn table<K: Kernel>(
    arguments: &Arguments,
    desk: &Desk,
    mut impacts: impl FnMut(&[Row<K>]) -> Vec<Impact<K::State>>,
) -> Result<(Table, States), Refusal> {
    let mut states = Vec::new();
    if let Some(path) = &arguments.from {
        let Rows { held, places, left } = read_rows::<K>(path, &file::read_text(path)?)?;
        let mut table = Table::new(&[
            Column::new("flight", "rad").digits(17),
            Column::new("next_phase", "rad").digits(17),
            Column::new("next_velocity", "b w").digits(17),
        ]);
        let impacts = impacts(&held);
        for place in places {
            let impact = place.and_then(|place| impacts.get(place));
            let next = impact.map(|impact| K::observe(impact.next));
            if let Some(next) = &next {
                states.push((next.phase, next.velocity));
            }
            table.push([
                impact.map(|impact| impact.flight).into(),
                next.map(|next| next.phase).into(),
                next.map(|next| next.velocity).into(),
            ]);
        }
        if let Some((count, first)) = left {
            let first = first.to_string();
            let first = first.trim_start_matches("error: ");
            eprintln!(
                "left empty, as arithmetic {} cannot hold them: {count} row(s), the first in {first}",
                K::NAME
            );
        }
        return Ok((table, states));
    }
    // clap has seen to it that all four are there.
    let given = |value: Option<f64>| value.unwrap_or(f64::NAN);
    let mut row = [Row {
        kernel: K::build(given(arguments.k), given(arguments.restitution))?,
        state: K::state(given(arguments.phase), given(arguments.velocity))?,
    }];
    let mut table = Table::new(&[
        Column::new("n", ""),
        Column::new("phase", "rad").digits(17),
        Column::new("velocity", "b w").digits(17),
        Column::new("flight", "rad").digits(17),
    ]);
    for n in 1..=arguments.count {
        if n % 1024 == 0 {
            desk.go_on()?;
        }
        for impact in impacts(&row) {
            let next = K::observe(impact.next);
            states.push((next.phase, next.velocity));
            row[0].state = K::state(next.phase, next.velocity).map_err(|refused| {
                Refusal::value(
                    refused.parameter,
                    refused.value,
                    format!("{} (arithmetic {})", refused.accepted, K::NAME),
                    "ask for fewer impacts, or choose another --arithmetic",
                )
                .at(format!("after impact {n}"))
            })?;
            row[0].state = impact.next;
            table.push([
                n.into(),
                next.phase.into(),
                next.velocity.into(),
                impact.flight.into(),
            ]);
        }
    }
    Ok((table, states))
}

/// The rows of a file.
struct Rows<K: Kernel> {
    /// Those that the arithmetic holds.
    held: Vec<Row<K>>,
    /// For each row its place among those, if it is one of them.
    places: Vec<Option<usize>>,
    /// How many it does not hold, and what it says of the first.
    left: Option<(usize, Refusal)>,
}

/// All rows of the file. The first that is no launch at all is refused with its line and column, before
/// anything is printed; a launch that only this arithmetic cannot hold is left out.
fn read_rows<K: Kernel>(path: &Path, text: &str) -> Result<Rows<K>, Refusal> {
    const COLUMNS: [&str; 4] = ["k", "restitution", "phase", "velocity"];
    let name = path.display();
    let mut lines = text
        .trim_start_matches('\u{feff}')
        .lines()
        .enumerate()
        .map(|(n, line)| (n + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let header = lines.next().map_or("", |(_, line)| line);
    let names: Vec<&str> = header
        .split(',')
        .map(|name| name.trim().trim_matches('"'))
        .collect();
    let mut places = [0; 4];
    for (place, column) in places.iter_mut().zip(COLUMNS) {
        *place = names
            .iter()
            .position(|name| *name == column)
            .ok_or_else(|| {
                Refusal::value(
                    format!("header of {name}"),
                    format!("'{header}'"),
                    "the columns k,restitution,phase,velocity in any order",
                    format!("add the column {column}"),
                )
            })?;
    }
    let mut rows = Rows {
        held: Vec::new(),
        places: Vec::new(),
        left: None,
    };
    for (line, text) in lines {
        let fields: Vec<&str> = text.split(',').map(str::trim).collect();
        let mut values = [0.0; 4];
        for ((value, place), column) in values.iter_mut().zip(places).zip(COLUMNS) {
            let field = fields.get(place).copied().unwrap_or("");
            *value = field.parse().map_err(|_| {
                Refusal::value(column, format!("'{field}'"), "a number", "correct this row")
                    .at(format!("{name}, line {line}"))
            })?;
        }
        let [k, restitution, phase, velocity] = values;
        let refused = |refused: kband::feeder::OutOfRange| {
            Refusal::value(
                refused.parameter,
                refused.value,
                format!("{} (arithmetic {})", refused.accepted, K::NAME),
                "correct or remove this row, or choose another --arithmetic",
            )
            .at(format!("{name}, line {line}"))
        };
        let launch = K::build(k, restitution)
            .and_then(|kernel| K::state(phase, velocity).map(|state| Row { kernel, state }));
        match launch {
            Ok(row) => {
                rows.places.push(Some(rows.held.len()));
                rows.held.push(row);
            }
            Err(cause) => {
                let cause = refused(cause);
                if Map::build(k, restitution).is_err() || Map::state(phase, velocity).is_err() {
                    return Err(cause);
                }
                rows.places.push(None);
                let (count, first) = rows.left.take().unwrap_or((0, cause));
                rows.left = Some((count + 1, first));
            }
        }
    }
    if let (true, Some((_, first))) = (rows.held.is_empty(), &rows.left) {
        return Err(first.clone());
    }
    if rows.held.is_empty() {
        return Err(Refusal::new(
            format!("{name} has no rows"),
            "give at least one row below the header k,restitution,phase,velocity",
        ));
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(text: &str) -> String {
        match read_rows::<Map>(Path::new("a.csv"), text) {
            Ok(_) => panic!("accepted: {text}"),
            Err(refusal) => refusal.to_string(),
        }
    }

    #[test]
    fn a_bad_row_is_named_by_line_column_value_and_range() {
        let cases = [
            ("", "header of a.csv = '' is refused"),
            ("k,restitution,phase\n1,1,1\n", "add the column velocity"),
            ("k,restitution,phase,velocity\n", "a.csv has no rows"),
            (
                "k,restitution,phase,velocity\n0.4,0.2,1,1\n\n0.4,1.2,1,1\n",
                "line 4: restitution = 1.2",
            ),
            (
                "k,restitution,phase,velocity\r\n\r\n# note\r\n0.4,0.2,x,1\r\n",
                "line 4: phase = 'x'",
            ),
            (
                "k,restitution,phase,velocity\n0.4,0.2,1\n",
                "line 2: velocity = ''",
            ),
            (
                "k,restitution,phase,velocity\n0.4,0.2,1,-1\n",
                "line 2: velocity = -1",
            ),
            (
                "velocity,k,restitution,phase\n1,nan,0.2,1\n",
                "line 2: k = NaN",
            ),
            (
                "k,restitution,phase,velocity\n0,0.2,1,1\n",
                "accepted: 0.001..1000 (arithmetic f64)",
            ),
        ];
        for (text, expected) in cases {
            let message = refusal(text);
            assert!(message.contains(expected), "{text:?}: {message}");
        }
    }

    #[test]
    fn a_row_that_only_the_arithmetic_cannot_hold_is_left_out() {
        let text = "k,restitution,phase,velocity\n0.4,0.2,1,70\n0.4,0.2,1,2\n0.4,0.2,1,80\n";
        let rows = read_rows::<Hybrid>(Path::new("a.csv"), text).unwrap();
        assert_eq!(rows.places, [None, Some(0), None]);
        let (count, first) = rows.left.unwrap();
        assert_eq!(count, 2);
        assert!(
            first.to_string().contains("line 2: velocity = 70"),
            "{first}"
        );
        // Where nothing is left, it is refused.
        let none = read_rows::<Hybrid>(
            Path::new("a.csv"),
            "k,restitution,phase,velocity\n0.4,0.2,1,70\n",
        );
        assert!(none.is_err_and(|refusal| refusal.to_string().contains("0..60")));
    }

    #[test]
    fn a_portrait_shows_the_phases_that_occur() {
        let of = |phases: &[f64]| occupied(&phases.iter().map(|phase| (*phase, 1.0)).collect());
        let near = |(a, b): (f64, f64), (c, d): (f64, f64)| {
            assert!((a - c).abs() < 1e-9 && (b - d).abs() < 1e-9, "{a}..{b}");
        };
        near(of(&[1.0, 2.0, 1.5]), (0.95, 2.05));
        // Around 0.
        near(of(&[TAU - 0.5, 0.5, 0.1]), (-0.55, 0.55));
        near(of(&[0.3]), (0.28, 0.32));
        near(of(&[]), (0.0, TAU));
        near(of(&[0.0, 1.5, 3.0, 4.5, 6.0]), (0.0, TAU));
    }

    #[test]
    fn columns_may_come_in_any_order_among_others() {
        let text = "class,velocity,phase,restitution,k\nhigh,2,1,0.5,0.4\n";
        let rows = read_rows::<Map>(Path::new("a.csv"), text).unwrap().held;
        assert_eq!(
            (rows.len(), rows[0].kernel.k(), rows[0].state.velocity),
            (1, 0.4, 2.0)
        );
    }
}
