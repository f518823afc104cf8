//! `kband impacts`: the impact map evaluated impact by impact, in a number system of choice.
//!
//! A row has phase and flight in rad, and the velocity after the impact in `b w`.

mod portrait;
pub mod rows;

use std::path::{Path, PathBuf};

use clap::ValueEnum as _;
use kband::feeder::OutOfRange;
use kband::impact::batch::{Block, LANES};
use kband::impact::{
    ContactTime, Impact, Integer, Kernel, Map, PartState, Single, Tone, WaveKernel, WaveMap,
};

use crate::arguments::{
    self, AmplitudeArguments, ContactArguments, Drawn, Output, ScatterArguments,
};
use crate::desk::{Desk, Progress};
use crate::file;
use crate::refusal::{Exit, Refusal};
use crate::report::rows_file::row_bytes;
use crate::report::{self, Column, Format, Rows, Value, columns, print_rows};
use portrait::{States, portrait};
use rows::{LaunchFile, Row, Survey, check_rows, fly_rows, not_held};

/// Compute consecutive impacts of one orbit, or one impact for each row of a file.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband impacts --k 0.43 --restitution 0.2 --phase 0.5 --velocity 0.45 --count 20
  kband impacts --k 0.35 --restitution 0.2 --phase 0.4 --velocity 0.4 --count 20000 --out portrait.svg
  kband impacts --k 0.35 --restitution 0.2 --phase 0.5 --velocity 0.45 --count 20 --second-tone 0.15,2.356
  kband impacts --b 0.235 --frequency 50 --restitution 0.2 --phase 0.5 --velocity 0.45 --count 20
  kband impacts --from states.csv --arithmetic f64 --format csv

A file has the columns k,restitution,phase,velocity; others are ignored. Each row gives \
flight,next_phase,next_velocity. If only the arithmetic cannot represent a row, they are empty, with \
a warning on standard error. Phases are in rad, velocities in units of b w. With --contact the flight \
includes the contact, and phase and velocity are those after it.

Each row is written when it is computed, to standard output and to --out FILE.csv, .json or (if \
built in) .parquet: memory does not grow with their number. A table has at most 50000 rows, a \
picture at most 131072 states.

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

    /// Phase of the drive just after an impact in rad.
    #[arg(long, value_name = "T", value_parser = arguments::number, required_unless_present = "from")]
    phase: Option<f64>,

    /// Velocity relative to the track just after an impact, in units of b w, at least 0.
    #[arg(long, value_name = "PSI", value_parser = arguments::number, required_unless_present = "from")]
    velocity: Option<f64>,

    #[command(flatten)]
    contact: ContactArguments,

    #[command(flatten)]
    scatter: ScatterArguments,

    /// Number of consecutive impacts; memory does not grow with it.
    #[arg(long, value_name = "N", value_parser = arguments::count(1, usize::MAX), default_value = "1", conflicts_with = "from")]
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
    /// Phase in u32, velocity in f32: the board's.
    F32,
    /// Fixed point alone; slow.
    Integer,
    /// f64 in the widest registers of this CPU, the same bits.
    Batch,
}

impl Arithmetic {
    fn refuse(self, accepted: &str, next: &str) -> Refusal {
        let name = self.to_possible_value();
        let name = name.map_or_else(String::new, |value| value.get_name().to_owned());
        Refusal::value("--arithmetic", name, accepted, next)
    }
}

/// Prints the impacts and draws their phase portrait.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.drawn.output(Format::Table, true)?;
    let tones = [arguments.second_tone, arguments.third_tone].map(Option::unwrap_or_default);
    let one = tones.iter().all(|tone| tone.amplitude == 0.0);
    let drive_text = match arguments.amplitude.or_k(arguments.k)? {
        Some(k) => arguments.amplitude.describe(k)?,
        None => String::new(),
    };
    let task = Task {
        arguments,
        desk,
        output: &output,
    };
    let contact = arguments.contact.time(arguments.amplitude.hertz())?;
    let states = if !contact.is_instant() {
        with_contact(&task, tones, contact)?
    } else if one {
        on_one_tone(&task)?
    } else {
        on_tones(&task, tones)?
    };
    output.draw(|| portrait(arguments, &drive_text, states))
}

struct Task<'a> {
    arguments: &'a Arguments,
    desk: &'a Desk,
    output: &'a Output,
}

fn on_one_tone(task: &Task) -> Result<States, Refusal> {
    match task.arguments.arithmetic {
        Arithmetic::F64 => task.fly(Map::build, one_by_one),
        Arithmetic::F32 => task.fly(Single::build, one_by_one),
        Arithmetic::Integer => task.fly(Integer::build, one_by_one),
        Arithmetic::Batch => {
            let mut block = Block::new();
            task.fly(Map::build, |rows| in_blocks(&mut block, rows))
        }
    }
}

fn on_tones(task: &Task, tones: [Tone; 2]) -> Result<States, Refusal> {
    match task.arguments.arithmetic {
        Arithmetic::F64 => task.fly(build_on::<WaveMap>(tones), one_by_one),
        Arithmetic::F32 => task.fly(build_on::<Single>(tones), one_by_one),
        other => Err(other.refuse(
            "f64 or f32 with --second-tone or --third-tone",
            "choose one of them, or leave out the tones",
        )),
    }
}

fn build_on<K: WaveKernel>(tones: [Tone; 2]) -> impl Fn(f64, f64) -> Result<K, OutOfRange> {
    move |k, restitution| K::on_tones(tones, k, restitution)
}

/// Impacts that take time; the map of several tones has one as well.
fn with_contact(task: &Task, tones: [Tone; 2], contact: ContactTime) -> Result<States, Refusal> {
    let arithmetic = task.arguments.arithmetic;
    if arithmetic != Arithmetic::F64 {
        return Err(arithmetic.refuse(
            "f64 with --contact",
            "leave out --arithmetic, or leave out --contact",
        ));
    }
    task.fly(build_on::<WaveMap>(tones), |rows| {
        let held = rows.iter().map(|Row { kernel, state }| {
            let (k, restitution) = (kernel.k(), kernel.restitution());
            contact.hold(restitution, kernel.impact(*state), k, Some(kernel.wave()))
        });
        held.collect()
    })
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
            // Every row of a chunk has a lane.
            let _ = block.put(lane, &row.kernel, row.state);
        }
        block.advance(1);
        for (lane, row) in rows.iter().enumerate() {
            // A block leaves summable chatter to its caller; here every hop is computed.
            let impact = block.impact(lane).filter(|impact| impact.flight > 0.0);
            impacts.push(impact.unwrap_or_else(|| row.kernel.impact(row.state)));
            block.clear(lane);
        }
    }
    impacts
}

impl Task<'_> {
    /// Computes the impacts and passes them on one by one: memory does not grow with their number.
    fn fly<K: Kernel>(
        &self,
        build: impl Fn(f64, f64) -> Result<K, OutOfRange>,
        impacts: impl FnMut(&[Row<K>]) -> Vec<Impact<K::State>>,
    ) -> Result<States, Refusal> {
        match &self.arguments.from {
            Some(path) => self.fly_file(path, build, impacts),
            None => self.fly_orbit(build, impacts),
        }
    }

    fn fly_file<K: Kernel>(
        &self,
        path: &Path,
        build: impl Fn(f64, f64) -> Result<K, OutOfRange>,
        mut impacts: impl FnMut(&[Row<K>]) -> Vec<Impact<K::State>>,
    ) -> Result<States, Refusal> {
        let scatter = self.arguments.scatter.scatter;
        if scatter > 0.0 {
            return Err(Refusal::value(
                "--scatter",
                scatter,
                "0 with --from: each row has a restitution of its own",
                "draw the restitutions in the file",
            ));
        }
        let launches = LaunchFile::open(path)?;
        let progress = Progress::beside_rows("checking rows", launches.size()?);
        let Survey { rows, left } = check_rows(path, launches.reader()?, &build, |bytes| {
            progress.advance(bytes);
            self.desk.go_on()
        })?;
        progress.finish();
        if let Some((count, first)) = left {
            let first = first.to_string();
            let first = first.trim_start_matches("error: ");
            eprintln!(
                "left empty, because arithmetic {} cannot represent them: {count} row(s), the first in {first}",
                K::NAME
            );
        }
        let columns = [columns::FLIGHT, columns::NEXT_PHASE, columns::NEXT_VELOCITY];
        self.write(&columns, rows, |sink| {
            fly_rows(path, launches.reader()?, &build, |rows| {
                let is_held: Vec<bool> = rows.iter().map(Option::is_some).collect();
                let held: Vec<Row<K>> = rows.drain(..).flatten().collect();
                let mut flown = impacts(&held).into_iter();
                for is_held in is_held {
                    let impact = is_held.then(|| flown.next()).flatten();
                    let next = impact.map(|impact| K::observe(impact.next));
                    let row = [
                        impact.map(|impact| impact.flight).into(),
                        next.map(|next| next.phase).into(),
                        next.map(|next| next.velocity).into(),
                    ];
                    sink.row(&row, next)?;
                }
                Ok(())
            })
        })
    }

    fn fly_orbit<K: Kernel>(
        &self,
        build: impl Fn(f64, f64) -> Result<K, OutOfRange>,
        mut impacts: impl FnMut(&[Row<K>]) -> Vec<Impact<K::State>>,
    ) -> Result<States, Refusal> {
        let arguments = self.arguments;
        // clap requires all four.
        let given = |value: Option<f64>| value.unwrap_or(f64::NAN);
        let k = given(arguments.amplitude.or_k(arguments.k)?);
        let mut row = [Row {
            kernel: build(k, given(arguments.restitution))?,
            state: K::state(given(arguments.phase), given(arguments.velocity))?,
        }];
        let mut scatter = arguments.scatter.stream(given(arguments.restitution), 0)?;
        let columns = [
            columns::N,
            columns::PHASE,
            columns::VELOCITY,
            columns::FLIGHT,
        ];
        self.write(&columns, arguments.count as u64, |sink| {
            for n in 1..=arguments.count {
                if let Some(scatter) = &mut scatter {
                    row[0].kernel = build(k, scatter.draw())?;
                }
                for impact in impacts(&row) {
                    let next = K::observe(impact.next);
                    // A state out of the kernel's range ends the orbit; the state keeps its bits.
                    K::state(next.phase, next.velocity).map_err(|refused| {
                        not_held::<K>(refused, "ask for fewer impacts")
                            .at(format!("after impact {n}"))
                    })?;
                    row[0].state = impact.next;
                    let row = [
                        n.into(),
                        next.phase.into(),
                        next.velocity.into(),
                        impact.flight.into(),
                    ];
                    sink.row(&row, Some(next))?;
                }
            }
            Ok(())
        })
    }

    /// Calls `work` with the receiver of its rows, about as many as `rows`.
    fn write(
        &self,
        columns: &[Column],
        rows: u64,
        work: impl FnOnce(&mut Sink) -> Result<(), Refusal>,
    ) -> Result<States, Refusal> {
        let columns: Vec<Column> = columns.iter().map(|one| one.digits(17).plain()).collect();
        self.output.rows(&columns, |file| {
            print_rows(self.arguments.format, &columns, |printed| {
                let mut sink = Sink {
                    task: self,
                    columns: &columns,
                    printed: Some(printed),
                    file,
                    states: self.output.draws().then(States::new),
                    count: 0,
                    rows,
                    bytes: [0; 2],
                    progress: Progress::beside_rows("impacts", rows),
                };
                work(&mut sink)?;
                Ok(sink.states.unwrap_or_else(States::new))
            })
        })
    }
}

/// Receiver of the rows: standard output, a file, and the picture.
struct Sink<'a, 'p, 'f> {
    task: &'a Task<'a>,
    columns: &'a [Column],
    /// `None` after its reader has gone away.
    printed: Option<&'p mut (dyn Rows + 'p)>,
    file: Option<&'f mut (dyn Rows + 'f)>,
    states: Option<States>,
    count: u64,
    rows: u64,
    /// Bytes so far, printed and in the file.
    bytes: [u64; 2],
    progress: Progress,
}

/// Number of rows from which the size of all is estimated.
const MEASURED_ROWS: u64 = 1000;

/// Number of rows between two tests for a stop by the user.
const ROWS_AT_ONCE: u64 = 1024;

impl Sink<'_, '_, '_> {
    fn row(&mut self, row: &[Value], next: Option<PartState>) -> Result<(), Refusal> {
        if let Some(printed) = &mut self.printed
            && let Err(error) = printed.row(row)
        {
            if !file::reader_is_gone() || (self.file.is_none() && self.states.is_none()) {
                return Err(error);
            }
            self.printed = None;
        }
        if let Some(file) = &mut self.file {
            file.row(row)?;
        }
        if let (Some(states), Some(next)) = (&mut self.states, next) {
            states.add((next.phase, next.velocity));
        }
        self.count += 1;
        if self.count <= MEASURED_ROWS {
            self.measure(row);
        }
        if self.count.is_multiple_of(ROWS_AT_ONCE) {
            self.task.desk.go_on()?;
            self.progress.advance(ROWS_AT_ONCE);
        }
        Ok(())
    }

    /// Reports the estimated size of all rows after the first ones.
    fn measure(&mut self, row: &[Value]) {
        let form = match self.task.arguments.format {
            Format::Json => "json",
            Format::Csv | Format::Table => "csv",
        };
        let target = self.task.output.rows_target();
        self.bytes[0] += row_bytes(form, self.columns, row);
        if let Some(target) = target {
            self.bytes[1] += row_bytes(&target.ending(), self.columns, row);
        }
        if self.count == MEASURED_ROWS {
            let [printed, saved] = self
                .bytes
                .map(|bytes| (bytes as f64 / MEASURED_ROWS as f64 * self.rows as f64) as u64);
            report::state_size_of("standard output", printed);
            if let Some(target) = target {
                report::state_size(target, saved);
            }
        }
    }
}
