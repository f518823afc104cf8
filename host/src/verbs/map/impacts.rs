//! `kband impacts`: the impact map evaluated impact by impact, in a selected number system.

pub mod rows;

use std::f64::consts::{PI, TAU};
use std::path::PathBuf;

use clap::ValueEnum as _;
use kband::feeder::OutOfRange;
use kband::impact::{Impact, Integer, Kernel, Map, PartState, Single, Tone, WaveKernel, WaveMap};
use rows::{Row, check_rows, compute_rows};

use crate::arguments::{
    self, AmplitudeArguments, ContactArguments, FileArguments, Output, ScatterArguments,
    ToneArguments,
};
use crate::desk::{Desk, Progress};
use crate::file;
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::{Exit, Refusal, Result};
use crate::report::columns::{FLIGHT, N, NEXT_PHASE, NEXT_VELOCITY, PHASE, VELOCITY};
use crate::report::{Column, Format, Value, number, print_rows, when};

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
picture the first 131072 states.

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
    #[command(flatten)]
    tones: ToneArguments,
    /// Number system of the map.
    #[arg(long, value_enum, default_value_t = Arithmetic::F64)]
    arithmetic: Arithmetic,
    /// Form of the result on standard output.
    #[arg(long, value_enum, default_value_t = Format::Csv)]
    format: Format,
    #[command(flatten)]
    drawn: FileArguments,
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
}

impl Arithmetic {
    fn refuse(self, accepted: &str, next: &str) -> Refusal {
        let name = self.to_possible_value();
        let name = name.map_or_else(String::new, |value| value.get_name().to_owned());
        Refusal::value("--arithmetic", name, accepted, next)
    }
}

pub(crate) fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let output = arguments.drawn.check(Format::Table, true)?;
    let tones = arguments.tones.upper();
    let one = tones.iter().all(|tone| tone.amplitude == 0.0);
    let k = arguments.amplitude.or_k(arguments.k)?;
    let drive_text = k.map(|k| arguments.amplitude.describe(k));
    let drive_text = drive_text.transpose()?.unwrap_or_default();
    let task = Task {
        arguments,
        desk,
        output: &output,
    };
    let contact = arguments.contact.time(arguments.amplitude.hertz())?;
    let arithmetic = arguments.arithmetic;
    let held = |Row { kernel, state }: &Row<WaveMap>| {
        let (k, restitution) = (kernel.k(), kernel.restitution());
        contact.hold(restitution, kernel.impact(*state), k, Some(kernel.wave()))
    };
    let states = match (arithmetic, contact.is_instant()) {
        (Arithmetic::F64, false) => task.compute(build_on(tones), held),
        (_, false) => Err(arithmetic.refuse(
            "f64 with --contact",
            "leave out --arithmetic, or leave out --contact",
        )),
        (Arithmetic::F64, true) if one => task.compute(Map::build, impact),
        (Arithmetic::F32, true) if one => task.compute(Single::build, impact),
        (Arithmetic::Integer, true) if one => task.compute(Integer::build, impact),
        (Arithmetic::F64, true) => task.compute(build_on::<WaveMap>(tones), impact),
        (Arithmetic::F32, true) => task.compute(build_on::<Single>(tones), impact),
        (Arithmetic::Integer, true) => Err(arithmetic.refuse(
            "f64 or f32 with --second-tone or --third-tone",
            "choose one of them, or leave out the tones",
        )),
    };
    let states = states?;
    output.draw(|| portrait(arguments, &drive_text, states))
}

struct Task<'a> {
    arguments: &'a Arguments,
    desk: &'a Desk,
    output: &'a Output,
}

fn build_on<K: WaveKernel>(tones: [Tone; 2]) -> impl Fn(f64, f64) -> Result<K, OutOfRange> {
    move |k, restitution| K::on_tones(tones, k, restitution)
}

fn impact<K: Kernel>(row: &Row<K>) -> Impact<K::State> {
    row.kernel.impact(row.state)
}

impl Task<'_> {
    /// Computes the impacts and passes them on one by one, in constant memory.
    fn compute<K: Kernel>(
        &self,
        build: impl Fn(f64, f64) -> Result<K, OutOfRange>,
        impact: impl Fn(&Row<K>) -> Impact<K::State>,
    ) -> Result<States> {
        let Some(path) = &self.arguments.from else {
            return self.compute_orbit(build, impact);
        };
        let scatter = self.arguments.scatter.scatter;
        if scatter > 0.0 {
            let accepted = "0 with --from: each row has a restitution of its own";
            let next = "draw the restitutions in the file";
            return Err(Refusal::value("--scatter", scatter, accepted, next));
        }
        let launches = rows::open(path)?;
        let (reader, size) = rows::whole(path, &launches)?;
        let progress = Progress::beside_rows("checking rows", size);
        let count = check_rows(path, reader, |bytes| {
            progress.advance(bytes);
            self.desk.check_stop()
        })?;
        drop(progress);
        self.write(&[FLIGHT, NEXT_PHASE, NEXT_VELOCITY], count, |receive| {
            compute_rows(path, rows::whole(path, &launches)?.0, &build, |row| {
                let impact = row.map(|row| impact(&row));
                let flight = impact.map(|impact| impact.flight);
                let next = impact.map(|impact| K::observe(impact.next));
                let (phase, velocity) = next.map(|next| (next.phase, next.velocity)).unzip();
                receive(&[flight, phase, velocity].map(Value::from), next)
            })
        })
    }

    fn compute_orbit<K: Kernel>(
        &self,
        build: impl Fn(f64, f64) -> Result<K, OutOfRange>,
        impact: impl Fn(&Row<K>) -> Impact<K::State>,
    ) -> Result<States> {
        let arguments = self.arguments;
        // clap requires all four.
        let or_nan = |value: Option<f64>| value.unwrap_or(f64::NAN);
        let k = or_nan(arguments.amplitude.or_k(arguments.k)?);
        let mut row = Row {
            kernel: build(k, or_nan(arguments.restitution))?,
            state: K::state(or_nan(arguments.phase), or_nan(arguments.velocity))?,
        };
        let mut scatter = arguments.scatter.stream(or_nan(arguments.restitution), 0)?;
        let count = arguments.count as u64;
        self.write(&[N, PHASE, VELOCITY, FLIGHT], count, |receive| {
            for n in 1..=count {
                if let Some(scatter) = &mut scatter {
                    row.kernel = build(k, scatter.draw())?;
                }
                let impact = impact(&row);
                let next = K::observe(impact.next);
                // A state out of the kernel's range ends the orbit.
                K::state(next.phase, next.velocity).map_err(|refused| {
                    let accepted = format!("{} (arithmetic {})", refused.accepted, K::NAME);
                    let next = "ask for fewer impacts, or choose another --arithmetic";
                    Refusal::value(refused.parameter, refused.value, accepted, next)
                        .at(format!("after impact {n}"))
                })?;
                row.state = impact.next;
                let values = [next.phase, next.velocity, impact.flight].map(Value::from);
                let [phase, velocity, flight] = values;
                receive(&[n.into(), phase, velocity, flight], Some(next))?;
            }
            Ok(())
        })
    }

    /// Calls `work` with the receiver of its rows, about as many as `rows`.
    fn write(
        &self,
        columns: &[Column],
        rows: u64,
        work: impl FnOnce(&mut Receiver) -> Result<()>,
    ) -> Result<States> {
        let columns: Vec<Column> = columns.iter().map(|one| one.digits(17).plain()).collect();
        let draws = self.output.is_picture();
        let (mut states, mut count) = (States::default(), 0_u64);
        self.output.rows(&columns, |mut file| {
            print_rows(self.arguments.format, &columns, |printed| {
                // `None` after the reader has closed the pipe.
                let mut printed = Some(printed);
                let progress = Progress::beside_rows("impacts", rows);
                work(&mut |row, next| {
                    if let Some(printer) = &mut printed
                        && let Err(error) = printer.row(row)
                    {
                        if !file::is_reader_closed() || (file.is_none() && !draws) {
                            return Err(error);
                        }
                        printed = None;
                    }
                    if let Some(file) = &mut file {
                        file.row(row)?;
                    }
                    if let Some(next) = next {
                        states.impacts += 1;
                        if draws && states.drawn.len() < MAX_DRAWN {
                            states.drawn.push((next.phase, next.velocity));
                        }
                    }
                    count += 1;
                    if count.is_multiple_of(ROWS_AT_ONCE) {
                        self.desk.check_stop()?;
                        progress.advance(ROWS_AT_ONCE);
                    }
                    Ok(())
                })
            })
        })?;
        Ok(states)
    }
}

/// Receiver of the values of a row, and of the state after its impact.
type Receiver<'a> = dyn FnMut(&[Value], Option<PartState>) -> Result<()> + 'a;

/// Number of rows between two checks for an interruption by the user.
const ROWS_AT_ONCE: u64 = 1024;
const MAX_DRAWN: usize = 1 << 17;

/// Phase and velocity after each impact; of many, those after the first impacts.
#[derive(Default)]
struct States {
    drawn: Vec<(f64, f64)>,
    impacts: u64,
}

/// Phase portrait: the state after each impact, with phases within -pi..pi.
fn portrait(arguments: &Arguments, drive_text: &str, states: States) -> Picture {
    let (mut states, impacts) = (states.drawn, states.impacts);
    for (phase, _) in &mut states {
        if *phase > PI {
            *phase -= TAU;
        }
    }
    let phases = states.iter().map(|state| state.0);
    let velocities = states.iter().map(|state| state.1);
    let phase = Axis::over_values("phase t of the drive after the impact", "rad", phases).in_pi();
    let velocity = Axis::over_values("velocity ψ after the impact", "b·ω", velocities);
    let panel = Panel::new(phase, velocity).height(460.0);
    let contact = arguments.contact.describe();
    let map = |r| format!("{drive_text}, R = {}{contact}; ", number(r, 6));
    let map = arguments.restitution.map(map).unwrap_or_default();
    let all_drawn = impacts == states.len() as u64;
    let drawn = when(!all_drawn, || format!(", the first {} drawn", states.len()));
    Picture::new("Phase portrait")
        .caption(format!("{map}{impacts} impacts{drawn}"))
        .panel(panel.markers("impacts", 0, states))
}
