//! `kband simulate`: the controller against the impact map, for one scene.

use std::path::{Path, PathBuf};

use serde_json::json;

use kband::feeder::Restitution;

use crate::arguments;
use crate::board::Line;
use crate::desk::Desk;
use crate::file::{self, Target};
use crate::picture::{Picture, Theme};
use crate::refusal::{Exit, Refusal};
use crate::report::{self, Column, Format, Report, Table, Value, number};
use crate::simulate::{DEFAULT, Outcome, Runs, SceneFile, draw, runs, words};

/// The firmware's control loop against the impact map, for one scene [the default verb].
///
/// Prints what happened and what came of it, draws it, and writes the trace of every drive cycle.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband simulate
  kband simulate --print-scene > my.toml
  kband simulate my.toml --out my.svg --trace my.csv
  kband simulate my.toml --on qemu
  kband simulate --restitution 0.28..0.32 --duration 20 --runs 200")]
pub struct Arguments {
    /// Scene file (TOML); without one, the default scene.
    #[arg(value_name = "SCENE.toml")]
    scene: Option<PathBuf>,

    /// Print the default scene, commented, and stop.
    #[arg(long)]
    print_scene: bool,

    /// Restitution of the lot instead of the scene's; the simulated parts become its middle.
    #[arg(long, value_name = "R or LO..HI", value_parser = arguments::restitution)]
    restitution: Option<Restitution>,

    /// Duration in s instead of the scene's.
    #[arg(long, value_name = "S", value_parser = arguments::within(0.1, 86_400.0, "s"))]
    duration: Option<f64>,

    /// Run it N times with restitution, amplitude error and noise drawn anew, beside as many runs
    /// that set the amplitude from the band alone.
    #[arg(long, value_name = "N", value_parser = arguments::count(1, 1_000_000))]
    runs: Option<usize>,

    /// Seed of what is drawn.
    #[arg(long, value_name = "S", value_parser = arguments::count(0, 4_294_967_295), default_value = "1")]
    seed: usize,

    /// Run the controller on a board, in lock-step with the plant at the desk: qemu (the emulated CPU)
    /// or a serial port; its drive stays off.
    #[arg(long, value_name = "qemu or /dev/PORT", conflicts_with = "runs")]
    on: Option<String>,

    /// Image for --on qemu, instead of the one that cargo builds here.
    #[arg(long, value_name = "FILE", requires = "on")]
    image: Option<PathBuf>,

    /// Picture to write, .svg or .png.
    #[arg(long, value_name = "FILE", default_value = "kband-simulate.svg")]
    out: PathBuf,

    /// Trace to write: one row for each drive cycle, or for each run.
    #[arg(long, value_name = "FILE.csv", default_value = "kband-simulate.csv")]
    trace: PathBuf,

    /// Colours of the picture.
    #[arg(long, value_enum, default_value_t = Theme::Light)]
    theme: Theme,

    /// Form of the result on standard output.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

impl Default for Arguments {
    /// The default scene, as bare `kband` runs it.
    fn default() -> Self {
        Self {
            scene: None,
            print_scene: false,
            restitution: None,
            duration: None,
            runs: None,
            seed: 1,
            on: None,
            image: None,
            out: "kband-simulate.svg".into(),
            trace: "kband-simulate.csv".into(),
            theme: Theme::Light,
            format: Format::Table,
        }
    }
}

/// Runs the scene.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    if arguments.print_scene {
        report::print(DEFAULT)?;
        return Ok(Exit::Done);
    }
    let mut file = match &arguments.scene {
        Some(path) => {
            let text = file::read_text(path)?;
            SceneFile::parse(&text).map_err(|refusal| refusal.at(path.display()))?
        }
        None => SceneFile::parse(DEFAULT)?,
    };
    if let Some(lot) = arguments.restitution {
        let settings = &mut file.scene.settings;
        settings.restitution_low = lot.low() as f32;
        settings.restitution_high = lot.high() as f32;
        file.scene.parts.fill(lot.middle() as f32);
    }
    if let Some(duration) = arguments.duration {
        file.duration = duration as f32;
    }
    file.check()?;
    let picture = Target::check(&arguments.out)?;
    let ending = picture.ending();
    if ending != "svg" && ending != "png" {
        return Err(Refusal::value(
            "--out",
            arguments.out.display(),
            "a file name that ends in .svg or .png",
            "change the ending",
        ));
    }
    let trace = Target::check(&arguments.trace)?;
    if let Some(count) = arguments.runs {
        let all = many(&file, count, arguments.seed as u64, desk)?;
        write_picture(&picture, &runs::draw(&all, &file), arguments.theme)?;
        let table = runs::table(&all);
        trace.write(|out| table.write_csv(out))?;
        Report::new(runs::summary(&all))
            .note(format!("picture          {}", picture.path().display()))
            .note(format!("runs             {}", trace.path().display()))
            .print(arguments.format)?;
        return Ok(Exit::Done);
    }
    let outcome = match &arguments.on {
        Some(on) => {
            let line = Line::open(on, arguments.image.as_deref())?;
            Outcome::run_on(line, &file, desk)?
        }
        None => Outcome::run(&file, desk)?,
    };
    write_picture(&picture, &draw(&outcome), arguments.theme)?;
    let table = outcome.trace();
    trace.write(|out| table.write_csv(out))?;
    let unmet = file
        .expectation
        .as_ref()
        .map(|expected| expected.unmet(&outcome));
    told(&outcome, unmet.as_deref(), picture.path(), trace.path())?.print(arguments.format)?;
    Ok(match unmet {
        Some(unmet) if !unmet.is_empty() => Exit::CheckFailed,
        _ => Exit::Done,
    })
}

fn write_picture(target: &Target, picture: &Picture, theme: Theme) -> Result<(), Refusal> {
    let bytes = if target.ending() == "svg" {
        picture.to_svg(theme).into_bytes()
    } else {
        picture.to_png(theme).ok_or_else(|| {
            Refusal::new(
                "there is no memory for the picture",
                "write an .svg instead",
            )
        })?
    };
    target.write_bytes(&bytes)
}

/// The controller's runs, and those of an amplitude set from the band alone.
fn many(file: &SceneFile, count: usize, seed: u64, desk: &Desk) -> Result<[Runs; 2], Refusal> {
    let mut alone = file.clone();
    alone.scene.settings.capture_attempts = 0.0;
    Ok([
        Runs::run("planned kicks", file, count, seed, desk)?,
        Runs::run("band alone", &alone, count, seed, desk)?,
    ])
}

/// The timeline and the result in words.
fn told(
    outcome: &Outcome,
    unmet: Option<&[String]>,
    picture: &Path,
    trace: &Path,
) -> Result<Report, Refusal> {
    let mut table = Table::new(&[
        Column::new("time", "s").digits(4),
        Column::new("event", ""),
        Column::new("state", ""),
        Column::new("b", "mm").digits(3),
        Column::new("k", "").digits(4),
    ]);
    for happened in outcome.events() {
        let report = happened.report;
        let k = f64::from(report.k);
        let mut event = happened.event.name().to_string();
        if happened.event == kband::control::Event::KickBegun {
            event = format!("{event} ({} of {})", report.attempts, outcome.attempts_allowed());
        }
        if let (kband::control::Event::Faulted, Some(fault)) = (happened.event, report.fault) {
            event = format!("{event}: {} (fault {})", fault.name(), fault.number());
        }
        table.push([
            f64::from(happened.time).into(),
            event.into(),
            report.state.name().into(),
            (f64::from(report.amplitude) * 1e3).into(),
            if k < 1e3 { k.into() } else { Value::Missing },
        ]);
    }
    let settings = &outcome.file().scene.settings;
    let last = outcome.last();
    let mut report = Report::new(table).heading(format!(
        "target {}; {} Hz, incline {} degrees, restitution {}..{}, Q {}",
        crate::simulate::describe(outcome.target()),
        settings.frequency,
        settings.incline,
        settings.restitution_low,
        settings.restitution_high,
        settings.quality
    ));
    let mut say = |words: String| report = std::mem::take(&mut report).note(words);
    say(format!(
        "state            {}{}",
        last.state.name(),
        last.fault.map_or(String::new(), |fault| format!(
            ": {} (fault {})",
            fault.name(),
            fault.number()
        ))
    ));
    for limit in outcome.limits() {
        say(format!("held back by     {limit}"));
    }
    if let Some(why) = outcome.no_setpoint() {
        say(format!("no setpoint      {why}"));
    }
    say(format!(
        "amplitude b      {} mm",
        number(outcome.amplitude() * 1e3, 4)
    ));
    let k = outcome.k();
    if k.is_finite() {
        say(format!("k                {}", number(k, 4)));
    }
    match outcome.band() {
        Some(band) => say(format!(
            "band             k {} .. {} (order {}), {}",
            number(band.low(), 4),
            number(band.high(), 4),
            band.order(),
            if band.contains(k) { "k inside" } else { "k outside" }
        )),
        None => say(format!(
            "band             none: {}",
            outcome.no_band().unwrap_or_default()
        )),
    }
    say(format!("regime           {}", outcome.regime()));
    if let Some(heard) = last.regime {
        say(format!(
            "heard            {} (confidence {})",
            words(heard.regime),
            number(f64::from(heard.confidence), 2)
        ));
    }
    if let Some(phase) = outcome.lock_phase() {
        let expected = outcome
            .expected_phase()
            .map_or(String::new(), |phase| format!(" (the map says {} for the middle of the lot)", number(phase, 3)));
        say(format!(
            "lock phase       {} rad, heard {} rad{expected}",
            number(phase, 3),
            number(f64::from(last.phase), 3)
        ));
    }
    say(format!(
        "conveying speed  {} mm/s",
        number(outcome.speed() * 1e3, 3)
    ));
    if let Some(unmet) = unmet {
        if unmet.is_empty() {
            say("expectation      met".into());
        }
        for line in unmet {
            say(format!("NOT AS EXPECTED  {line}"));
        }
    }
    say(format!("picture          {}", picture.display()));
    say(format!("trace            {}", trace.display()));
    let events: Vec<_> = outcome
        .events()
        .map(|happened| json!({"time": happened.time, "event": happened.event.name(), "state": happened.report.state.name()}))
        .collect();
    report.json(&json!({
        "events": events,
        "state": last.state.name(),
        "fault": last.fault.map(|fault| fault.name()),
        "limits": outcome.limits(),
        "amplitude_mm": outcome.amplitude() * 1e3,
        "k": k.is_finite().then_some(k),
        "band": outcome.band().map(|band| [band.low(), band.high()]),
        "regime": outcome.regime(),
        "lock_phase_rad": outcome.lock_phase(),
        "speed_mm_s": outcome.speed() * 1e3,
        "not_as_expected": unmet,
        "picture": picture.display().to_string(),
        "trace": trace.display().to_string(),
    }))
}
