//! `kband impacts`: the map itself, impact by impact.

mod portrait;
pub mod rows;

use std::path::PathBuf;

use clap::ValueEnum as _;
use kband::feeder::OutOfRange;
use kband::impact::batch::{Block, LANES};
use kband::impact::{
    Hybrid, Impact, Integer, Kernel, Map, PartState, Single, Tone, WaveKernel, WaveMap, WaveSingle,
};

use crate::arguments::{self, AmplitudeArguments, Drawn, ScatterArguments};
use crate::desk::Desk;
use crate::file;
use crate::refusal::{Exit, Refusal};
use crate::report::{Format, Printout, Table, columns};
use portrait::{States, portrait};
use rows::{Row, Rows, not_held, read_rows};

/// Consecutive impacts of one orbit, or one impact for each row of a file.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband impacts --k 0.43 --restitution 0.2 --phase 0.5 --velocity 0.45 --count 20
  kband impacts --k 0.35 --restitution 0.2 --phase 0.4 --velocity 0.4 --count 20000 --out portrait.svg
  kband impacts --k 0.35 --restitution 0.2 --phase 0.5 --velocity 0.45 --count 20 --second-tone 0.15,2.356
  kband impacts --b 0.235 --frequency 50 --restitution 0.2 --phase 0.5 --velocity 0.45 --count 20
  kband impacts --from states.csv --arithmetic f64 --format csv

A file has the columns k,restitution,phase,velocity (others are ignored); each row gives \
flight,next_phase,next_velocity; they are empty, with a warning on standard error, where only the \
arithmetic cannot hold the row. Phases are in rad, velocities in units of b w.

With a second tone the track moves as sin t + e sin(2 t + th), th in rad (135 degrees are 2.356).")]
pub struct Arguments {
    /// k = g cos(alpha) / (b w^2).
    #[arg(long, value_parser = arguments::number, required_unless_present_any = ["from", "b"])]
    k: Option<f64>,

    #[command(flatten)]
    amplitude: AmplitudeArguments,

    /// Restitution of the part, 0..1.
    #[arg(long, value_name = "R", value_parser = arguments::number, required_unless_present = "from")]
    restitution: Option<f64>,

    /// Phase of the drive just after an impact, rad.
    #[arg(long, value_name = "T", value_parser = arguments::number, required_unless_present = "from")]
    phase: Option<f64>,

    /// Velocity relative to the track just after it, units of b w, at least 0.
    #[arg(long, value_name = "PSI", value_parser = arguments::number, required_unless_present = "from")]
    velocity: Option<f64>,

    #[command(flatten)]
    scatter: ScatterArguments,

    /// Number of consecutive impacts.
    #[arg(long, value_name = "N", value_parser = arguments::count(1, 1_000_000), default_value = "1", conflicts_with = "from")]
    count: usize,

    /// CSV file with the columns k,restitution,phase,velocity; `-` for standard input.
    #[arg(long, value_name = "FILE.csv", conflicts_with_all = ["k", "b", "restitution", "phase", "velocity"])]
    from: Option<PathBuf>,

    /// Second tone of the track: amplitude over that of the first, 0..0.5, and phase angle in rad.
    #[arg(long, value_name = "E,TH", value_parser = arguments::tone, allow_hyphen_values = true)]
    second_tone: Option<Tone>,

    /// Third tone of the track, likewise.
    #[arg(long, value_name = "E,TH", value_parser = arguments::tone, allow_hyphen_values = true)]
    third_tone: Option<Tone>,

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
    let output = arguments.drawn.output(Format::Table)?;
    let tones = [arguments.second_tone, arguments.third_tone].map(Option::unwrap_or_default);
    let one = tones.iter().all(|tone| tone.amplitude == 0.0);
    let (table, states) = if one {
        on_one_tone(arguments, desk)?
    } else {
        on_tones(arguments, desk, tones)?
    };
    let report = Printout::new(table.plain_header());
    let drive_text = match arguments.amplitude.or_k(arguments.k)? {
        Some(k) => arguments.amplitude.describe(k)?,
        None => String::new(),
    };
    report.print(arguments.format)?;
    output.write(&report, || portrait(arguments, &drive_text, states))?;
    Ok(Exit::Done)
}

fn on_one_tone(arguments: &Arguments, desk: &Desk) -> Result<(Table, States), Refusal> {
    match arguments.arithmetic {
        Arithmetic::F64 => table(arguments, desk, Map::build, one_by_one),
        Arithmetic::Hybrid => table(arguments, desk, Hybrid::build, one_by_one),
        Arithmetic::F32 => table(arguments, desk, Single::build, one_by_one),
        Arithmetic::Integer => table(arguments, desk, Integer::build, one_by_one),
        Arithmetic::Batch => {
            let mut block = Block::new();
            table(arguments, desk, Map::build, |rows| {
                in_blocks(&mut block, rows)
            })
        }
    }
}

fn on_tones(
    arguments: &Arguments,
    desk: &Desk,
    tones: [Tone; 2],
) -> Result<(Table, States), Refusal> {
    fn of<K: WaveKernel>(tones: [Tone; 2]) -> impl Fn(f64, f64) -> Result<K, OutOfRange> {
        move |k, restitution| K::on_tones(tones, k, restitution)
    }
    match arguments.arithmetic {
        Arithmetic::F64 => table(arguments, desk, of::<WaveMap>(tones), one_by_one),
        Arithmetic::F32 => table(arguments, desk, of::<WaveSingle>(tones), one_by_one),
        Arithmetic::Hybrid | Arithmetic::Integer | Arithmetic::Batch => Err(Refusal::value(
            "--arithmetic",
            arguments
                .arithmetic
                .to_possible_value()
                .map_or_else(String::new, |value| value.get_name().to_owned()),
            "f64 or f32 with --second-tone or --third-tone",
            "choose one of them, or leave out the tones",
        )),
    }
}

fn one_by_one<K: Kernel>(rows: &[Row<K>]) -> Vec<Impact<K::State>> {
    rows.iter()
        .map(|row| row.kernel.impact(row.state))
        .collect()
}

fn in_blocks(block: &mut Block, rows: &[Row<Map>]) -> Vec<Impact<PartState>> {
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
    build: impl Fn(f64, f64) -> Result<K, OutOfRange>,
    mut impacts: impl FnMut(&[Row<K>]) -> Vec<Impact<K::State>>,
) -> Result<(Table, States), Refusal> {
    let mut states = Vec::new();
    if arguments.from.is_some() && arguments.scatter.scatter > 0.0 {
        return Err(Refusal::value(
            "--scatter",
            arguments.scatter.scatter,
            "0 with --from: each row has a restitution of its own",
            "draw the restitutions in the file",
        ));
    }
    if let Some(path) = &arguments.from {
        let Rows { held, places, left } = read_rows(path, &file::read_text(path)?, build)?;
        let mut table = Table::new(&[
            columns::FLIGHT.digits(17),
            columns::NEXT_PHASE.digits(17),
            columns::NEXT_VELOCITY.digits(17),
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
    let k = given(arguments.amplitude.or_k(arguments.k)?);
    let mut row = [Row {
        kernel: build(k, given(arguments.restitution))?,
        state: K::state(given(arguments.phase), given(arguments.velocity))?,
    }];
    let mut scatter = arguments.scatter.stream(given(arguments.restitution), 0)?;
    let mut table = Table::new(&[
        columns::N,
        columns::PHASE.digits(17),
        columns::VELOCITY.digits(17),
        columns::FLIGHT.digits(17),
    ]);
    for n in 1..=arguments.count {
        if n % 1024 == 0 {
            desk.go_on()?;
        }
        if let Some(scatter) = &mut scatter {
            row[0].kernel = K::build(k, scatter.draw())?;
        }
        for impact in impacts(&row) {
            let next = K::observe(impact.next);
            states.push((next.phase, next.velocity));
            // What it cannot hold it cannot fly either; the state itself keeps its last bits.
            K::state(next.phase, next.velocity).map_err(|refused| {
                not_held::<K>(refused, "ask for fewer impacts").at(format!("after impact {n}"))
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
