//! `kband simulate`: the controller against the impact map, for one scene.

mod sentences;
mod summary;

use std::path::{Path, PathBuf};

use kband::feeder::Restitution;
use kband_plant::{Moment, Sample};

use crate::board::{Address, Emulated};
use crate::desk::Desk;
use crate::file::Destination;
use crate::picture::{Look, PICTURES};
use crate::refusal::{Exit, Refusal, Result};
use crate::report::{self, Format, Printout, Table, rows};
use crate::simulate::sweep::{Axes, Sweep};
use crate::simulate::{
    DEFAULT, Fidelity, Outcome, Runs, SceneFile, SceneText, Watch, draw, run_on, run_watched, runs,
    schema, trace,
};
use crate::{arguments, provenance};

/// Simulate the firmware's control loop with parts by the impact map, for one scene [the default
/// verb].
///
/// It prints events and results, draws a picture, and writes a trace of every drive cycle.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(after_help = "Examples:
  kband simulate
  kband simulate --print-scene > my.toml
  kband simulate my.toml --out my.svg --trace my.csv
  kband simulate my.toml --fidelity waveform --scope scope.csv
  kband simulate my.toml --on qemu
  kband simulate --restitution 0.28..0.32 --duration 20 --runs 200
  kband simulate --sweep part.restitution=0.1..0.6:26 --runs 20
  kband simulate --schema > scene.schema.json")]
pub struct Arguments {
    /// Scene file (TOML), `-` for standard input; without one, the default scene.
    #[arg(value_name = "SCENE.toml")]
    scene: Option<PathBuf>,
    /// Print the default scene with comments.
    #[arg(long)]
    print_scene: bool,
    /// Print the JSON schema of scenes, for editors.
    #[arg(long)]
    schema: bool,
    /// Fidelity of the simulation instead of the scene's [default: envelope, or waveform with a
    /// scope or a board].
    #[arg(long, value_enum)]
    fidelity: Option<Fidelity>,
    /// Restitution of the lot instead of the scene's. The simulated parts have its middle.
    #[arg(long, value_name = "R or LO..HI", value_parser = arguments::restitution)]
    restitution: Option<Restitution>,
    /// Duration in s instead of the scene's.
    #[arg(long, value_name = "S", value_parser = arguments::within(0.1, 86_400.0, "s"))]
    duration: Option<f64>,
    /// Number of runs with random restitution, amplitude error and noise.
    #[arg(long, value_name = "N", value_parser = arguments::count(1, 1_000_000))]
    runs: Option<usize>,
    /// Seed of all random numbers (noise, parts, runs) instead of the scene's.
    #[arg(long, value_name = "S", value_parser = arguments::count(0, 4_294_967_295))]
    seed: Option<usize>,
    /// Run the scene at N values of a numeric key; several sweeps make every combination.
    #[arg(long, value_name = "KEY=A..B:N", value_parser = Axes::parse)]
    sweep: Vec<Axes>,
    /// Run the controller on a board, in lock-step with the simulated plant: qemu (the emulated
    /// CPU) or a serial port. The board's drive stays off.
    #[arg(long, value_name = "qemu or /dev/PORT", conflicts_with_all = ["runs", "sweep"])]
    on: Option<String>,
    /// Image for --on qemu. Default: the image that cargo builds here.
    #[arg(long, value_name = "FILE", requires = "on")]
    image: Option<PathBuf>,
    /// Picture to write, .svg, .png or .pdf [default: kband-simulate.svg]. A named file is
    /// overwritten, the default only if kband wrote it.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Trace to write, .csv or .parquet: one row for each drive cycle, or for each run [default:
    /// kband-simulate.csv, for a single run of up to 10 min and for many].
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// Samples of the last ten drive cycles to write, .csv or .parquet.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["runs", "sweep", "on"])]
    scope: Option<PathBuf>,
    #[command(flatten)]
    look: Look,
    /// Form of the result on standard output.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

const PICTURE: &str = "kband-simulate.svg";

const TRACE: &str = "kband-simulate.csv";
/// Longest single run in s whose trace is written by default: 30 000 rows at 50 Hz.
const MAX_TRACED_DURATION: f64 = 600.0;

impl Arguments {
    fn apply_to(&self, file: &mut SceneFile) {
        if let Some(lot) = self.restitution {
            let settings = &mut file.scene.settings;
            settings.restitution_low = lot.low() as f32;
            settings.restitution_high = lot.high() as f32;
            file.scene.parts.fill(lot.middle() as f32);
            file.distribution = None;
        }
        if let Some(duration) = self.duration {
            file.duration = duration;
        }
    }

    /// Fidelity of a single run: a scope needs samples, also against the scene.
    fn fidelity(&self, file: &SceneFile) -> Result<Fidelity> {
        match (self.fidelity, &self.scope) {
            (Some(Fidelity::Envelope), Some(_)) => Err(Refusal::value(
                "--scope",
                "(with --fidelity envelope)",
                "--fidelity waveform, which has samples",
                "leave --fidelity out, or say waveform",
            )),
            (_, Some(_)) => Ok(Fidelity::Waveform),
            (requested, None) => Ok(requested.or(file.fidelity).unwrap_or_default()),
        }
    }
}

/// Summary of a run in words; the last line is the next step.
pub(super) fn plain_words(outcome: &Outcome) -> Vec<String> {
    let observed = summary::Observed::from_outcome(outcome);
    let mut lines = observed.lines();
    let next = lines.len() - 1;
    lines.splice(next..next, crate::causes::describe(&observed.causes));
    lines
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    if arguments.print_scene {
        return report::print(DEFAULT).map(|()| Exit::Done);
    }
    if arguments.schema {
        report::print(&format!("{:#}\n", schema::schema()))?;
        return Ok(Exit::Done);
    }
    let read = SceneText::read(arguments.scene.as_deref())?;
    let mut table = read.table.clone();
    if let Some(seed) = arguments.seed {
        if arguments.sweep.iter().any(|axis| axis.key == "seed") {
            let cause = "--seed and --sweep seed=... both set the seed";
            return Err(Refusal::new(cause, "leave one of the two out"));
        }
        table.insert("seed".into(), toml::Value::Integer(seed as i64));
    }
    let mut file = read.scene(&table)?;
    arguments.apply_to(&mut file);
    file.check()?;
    let picture = match &arguments.out {
        Some(path) => {
            arguments::refuse_two_forms(path, arguments.format)?;
            Destination::output(path, "svg")?
        }
        None => {
            Destination::default_name(Path::new(PICTURE), arguments::own_picture, "--out FILE.svg")?
        }
    };
    picture.ends_in("--out", &PICTURES)?;
    let many = arguments.runs.is_some() || !arguments.sweep.is_empty();
    let own_table = |begin: &str| begin.starts_with(provenance::FIRST_COMMENT);
    let trace =
        match &arguments.trace {
            Some(path) => Some(Destination::output(path, "csv")?),
            None if many || file.duration <= MAX_TRACED_DURATION => Some(
                Destination::default_name(Path::new(TRACE), own_table, "--trace FILE.csv")?,
            ),
            None => None,
        };
    let scope = arguments.scope.as_deref();
    let scope = scope.map(|path| Destination::output(path, "csv"));
    let scope = scope.transpose()?;
    for (option, target) in [("--trace", &trace), ("--scope", &scope)] {
        if let Some(target) = target {
            rows::check(option, target)?;
        }
    }
    let trace = trace.as_ref();
    if !arguments.sweep.is_empty() {
        return sweep(arguments, &table, &file, &picture, trace, desk);
    }
    let fidelity = arguments.fidelity(&file)?;
    if let Some(count) = arguments.runs {
        let all = Runs::run(&file, count, fidelity, desk)?;
        arguments.look.write(&picture, &runs::draw(&all, &file))?;
        let table = runs::table(&all);
        let report = runs::summary().printout(&[all]);
        return print_runs(report, &table, &picture, trace, arguments.format);
    }
    if let Some(trace) = trace.filter(|trace| trace.ending() == "csv") {
        let cycles = file.duration * f64::from(file.scene.settings.frequency);
        let bytes = cycles as u64 * trace::ROW_BYTES;
        if bytes > 100_000_000 {
            let (name, size) = (trace.path().display(), bytes / 1_000_000);
            eprintln!("note: {name} will have about {size} MB");
        }
    }
    let (traced, scoped) = (trace::trace(), trace::scope());
    let outcome = rows::write(trace, &traced.columns(), |cycles| {
        rows::write(scope.as_ref(), &scoped.columns(), |samples| {
            let (mut cycle, mut sample);
            let mut watch = Watch::FOR_PICTURE;
            if let Some(rows) = cycles {
                cycle = |moment: &Moment| rows.row(&traced.row(moment));
                watch.cycle = Some(&mut cycle);
            }
            if let Some(rows) = samples {
                sample = |sample: &Sample| rows.row(&scoped.row(sample));
                watch.sample = Some(&mut sample);
            }
            match &arguments.on {
                Some(on) => {
                    let address = Address::new(on, arguments.image.as_deref());
                    run_on(address.open(Emulated::AtRest)?, &file, watch, desk)
                }
                None => run_watched(&file, fidelity, watch, desk),
            }
        })
    })?;
    if let Some(drawn) = draw(&outcome) {
        arguments.look.write(&picture, &drawn)?;
    }
    let unmet = outcome.unmet();
    let fidelity = match arguments.on {
        Some(_) => "processor in the loop",
        None => fidelity.name(),
    };
    let written = [
        ("picture", Some(&picture)),
        ("trace", trace),
        ("scope", scope.as_ref()),
    ]
    .map(|(name, target)| (name, target.map(Destination::path)));
    sentences::report(&outcome, fidelity, unmet.as_deref(), &written).print(arguments.format)?;
    Ok(match unmet {
        Some(unmet) if !unmet.is_empty() => Exit::CheckFailed,
        _ => Exit::Done,
    })
}

fn sweep(
    arguments: &Arguments,
    table: &toml::Table,
    file: &SceneFile,
    picture: &Destination,
    trace: Option<&Destination>,
    desk: &Desk,
) -> Result<Exit> {
    let swept = Sweep::run(
        table,
        &arguments.sweep,
        &|file| arguments.apply_to(file),
        arguments.runs,
        arguments.fidelity,
        desk,
    )?;
    arguments.look.write(picture, &swept.draw(file))?;
    let (report, table) = (swept.summary(), swept.table());
    print_runs(report, &table, picture, trace, arguments.format)
}

fn print_runs(
    report: Printout,
    table: &Table,
    picture: &Destination,
    trace: Option<&Destination>,
    format: Format,
) -> Result<Exit> {
    rows::write(trace, &table.columns, |rows| match rows {
        Some(rows) => table.write_rows(rows),
        None => Ok(()),
    })?;
    let runs = trace.map(|trace| format!("runs             {}", trace.path().display()));
    let picture = format!("picture          {}", picture.path().display());
    report.note(picture).notes(runs).print(format)?;
    Ok(Exit::Done)
}
