//! `kband design`: feeders with the drive of a scene, by parts a minute and share in gear.

use std::path::PathBuf;

use kband_scene::design::{CheckStop, Conveyed, Design, Designed, Feeder, Ranges, Workers};
use serde_json::json;

use crate::arguments::{self, OutputArguments};
use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::{Exit, Result};
use crate::report::{Printout, View, columns, fields, finite, number, numbers};
use crate::simulate::{SceneFile, SceneText};

/// Find feeders for the drive of a scene: parts a minute against share in gear.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband design my.toml
  kband design my.toml --frequency 30..120 --throw-angle 20..35 --out design.svg
  kband design my.toml --incline 0..3 --largest-second-tone 0.15 --format json

Force, quality, swinging mass, stroke and acceleration are those of the scene's drive, along the \
direction of the motion. The springs are tuned to each frequency. Each row is a feeder of the \
Pareto front: no other feeder has both more parts a minute and a larger share in gear. Both come \
from simulated parts of the lot; further columns have those of a run in the closed loop. Beside a \
table the front is drawn into kband-design.svg, unless --out names a file.")]
pub struct Arguments {
    /// Scene file (TOML), `-` for standard input; without one, the default scene.
    #[arg(value_name = "SCENE.toml")]
    scene: Option<PathBuf>,
    /// Drive frequency in Hz [default: half to twice the scene's].
    #[arg(long, value_name = "LO..HI", value_parser = arguments::interval(5.0, 500.0, "Hz"))]
    frequency: Option<[f64; 2]>,
    /// Amplitude normal to the track in mm [default: the drive's whole range].
    #[arg(long, value_name = "LO..HI", value_parser = arguments::interval(0.0, 100.0, "mm"))]
    amplitude: Option<[f64; 2]>,
    /// Angle between the track and its motion in degrees [default: 20..45].
    #[arg(long, value_name = "LO..HI", value_parser = arguments::interval(5.0, 90.0, "degrees"))]
    throw_angle: Option<[f64; 2]>,
    /// Phase lead of the motion along the track in degrees [default: the scene's].
    #[arg(long, value_name = "LO..HI", value_parser = arguments::interval(-180.0, 180.0, "degrees"))]
    phase_lead: Option<[f64; 2]>,
    /// Incline of the track in degrees, positive where parts climb [default: the scene's].
    #[arg(long, value_name = "LO..HI", value_parser = arguments::interval(-60.0, 60.0, "degrees"))]
    incline: Option<[f64; 2]>,
    /// Largest second tone over the first [default: drive.second_tone of the scene].
    #[arg(long, value_name = "E", value_parser = arguments::within(0.0, 0.5, ""))]
    largest_second_tone: Option<f64>,
    /// Largest third tone [default: drive.third_tone of the scene].
    #[arg(long, value_name = "E3", value_parser = arguments::within(0.0, 0.5, ""))]
    largest_third_tone: Option<f64>,
    /// Smallest share in gear of the front. Below the default the board does not report READY.
    #[arg(long, value_name = "S", default_value = "0.65", value_parser = arguments::within(0.0, 1.0, ""))]
    least_share: f64,
    /// Number of candidates.
    #[arg(long, value_name = "N", default_value = "1000000", value_parser = arguments::count(1000, 100_000_000))]
    candidates: usize,
    /// Number of feeders of the front that are simulated in the closed loop.
    #[arg(long, value_name = "N", default_value = "10", value_parser = arguments::count(1, 100))]
    checked: usize,
    /// Seed of all random numbers instead of the scene's. Equal seeds give equal bits, with any
    /// number of threads.
    #[arg(long, value_name = "N", value_parser = arguments::count(0, 4_294_967_295))]
    seed: Option<usize>,
    #[command(flatten)]
    output: OutputArguments,
}

impl Arguments {
    fn ranges(&self, file: &SceneFile) -> Ranges {
        let scene = Ranges::from_scene(file);
        let [second, third] = scene.tones;
        Ranges {
            frequency: self.frequency.unwrap_or(scene.frequency),
            amplitude: self.amplitude.unwrap_or(scene.amplitude),
            throw_angle: self.throw_angle.unwrap_or(scene.throw_angle),
            phase_lead: self.phase_lead.unwrap_or(scene.phase_lead),
            incline: self.incline.unwrap_or(scene.incline),
            tones: [
                self.largest_second_tone.unwrap_or(second),
                self.largest_third_tone.unwrap_or(third),
            ],
            candidates: self.candidates,
            least_share: self.least_share,
            checked: self.checked,
            seed: scene.seed,
        }
    }
}

impl Workers for Desk {
    fn map<T: Send + Sync>(
        &self,
        title: &str,
        count: usize,
        work: impl Fn(usize, CheckStop<'_>) -> Result<T> + Sync + Send,
    ) -> Result<Vec<T>> {
        self.try_map(title, count, |n| work(n, &|| self.check_stop()))
    }
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let output = arguments.output.check_or("kband-design.svg")?;
    let read = SceneText::read(arguments.scene.as_deref())?;
    let mut table = read.table.clone();
    if let Some(seed) = arguments.seed {
        table.insert("seed".into(), toml::Value::Integer(seed as i64));
    }
    let file = read.scene(&table)?;
    let design = Design::search(&file, &arguments.ranges(&file), desk)?;
    output.show(&report(&file, &design), || picture(&file, &design))
}

fn parts_a_minute(file: &SceneFile, conveyed: Conveyed) -> f64 {
    60.0 * conveyed.speed / file.part_length
}

/// Amplitude b in mm.
fn amplitude(file: &SceneFile, feeder: &Feeder) -> f64 {
    feeder.amplitude(file.scene.settings.gravity.into())
}

fn describe(file: &SceneFile, feeder: &Feeder) -> String {
    let b = amplitude(file, feeder);
    let [frequency, b, angle] = numbers([feeder.frequency, b, feeder.throw_angle], 3);
    format!("{frequency} Hz, b = {b} mm, angle of throw {angle} degrees")
}

fields! {
    fn designed(row: Designed, file: SceneFile) {
        all FREQUENCY.titled("Hz").digits(3) => row.feeder.frequency;
        all B.digits(3) => amplitude(file, &row.feeder);
        all THROW_ANGLE.titled("throw (deg)").digits(3) => row.feeder.throw_angle;
        all PHASE_LEAD.titled("lead (deg)").digits(3) => row.feeder.phase_lead;
        all INCLINE.titled("incline (deg)").digits(3) => row.feeder.incline;
        all K.digits(3) => row.feeder.k;
        all E.titled("e").digits(2) => row.feeder.tones[0][0];
        all TH.titled("th").digits(3) => row.feeder.tones[0][1];
        all E3.titled("e3").digits(2) => row.feeder.tones[1][0];
        data TH3 => row.feeder.tones[1][1];
        all IN_GEAR.titled("in gear").digits(3) => row.simulated.share;
        all PARTS_A_MINUTE.titled("parts/min").digits(4) => parts_a_minute(file, row.simulated);
        data SPEED => row.simulated.speed;
        all IN_GEAR_CLOSED_LOOP.titled("in gear, closed loop").digits(3) => row.closed.map(|closed| closed.share);
        all PARTS_A_MINUTE_CLOSED_LOOP.titled("parts/min, closed loop").digits(4) => row.closed.map(|closed| parts_a_minute(file, closed));
        all PARTS_BY_B.titled("% parts by 1 % b").digits(2) => finite(100.0 * row.sensitivity.amplitude[0]);
        all IN_GEAR_BY_B.titled("in gear by 1 % b").digits(2) => finite(row.sensitivity.amplitude[1]);
        all PARTS_BY_FREQUENCY.titled("% parts by 1 % Hz").digits(2) => finite(100.0 * row.sensitivity.frequency[0]);
        all IN_GEAR_BY_FREQUENCY.titled("in gear by 1 % Hz").digits(2) => finite(row.sensitivity.frequency[1]);
        all PARTS_BY_RESTITUTION.titled("% parts by 0.01 R").digits(2) => finite(100.0 * row.sensitivity.restitution[0]);
        all IN_GEAR_BY_RESTITUTION.titled("in gear by 0.01 R").digits(2) => finite(row.sensitivity.restitution[1]);
    }
}

fn comparison(file: &SceneFile, design: &Design) -> Option<String> {
    let today = design.today?;
    let closed = today.closed?;
    let [frequency, share] = numbers([today.feeder.frequency, closed.share], 3);
    let (rate, feeder) = (parts_a_minute(file, closed), describe(file, &today.feeder));
    let now = format!(
        "Your feeder at {frequency} Hz: {rate:.0} parts a minute at share {share} in gear ({feeder})."
    );
    let better = design.better().and_then(|best| Some((best, best.closed?)));
    let then = match better {
        Some((best, run)) if run.speed > closed.speed => {
            let (rate, share) = (parts_a_minute(file, run), number(run.share, 3));
            let feeder = describe(file, &best.feeder);
            let gain = 100.0 * (run.speed / closed.speed - 1.0);
            format!(
                "With the same drive and about this share: {rate:.0} parts a minute at share {share} ({feeder}), {gain:+.0} %."
            )
        }
        _ => "No feeder of the front with the same drive has more parts a minute at this share."
            .into(),
    };
    Some(format!("{now} {then}"))
}

fn report(file: &SceneFile, design: &Design) -> Printout {
    let all = designed(file);
    let tones = |n: usize| design.best.iter().any(|row| row.feeder.tones[n][0] > 0.0);
    let varies = |value: fn(&Feeder) -> f64| {
        let mut values = design.best.iter().map(|best| value(&best.feeder));
        values.any(|other| other != value(&design.best[0].feeder))
    };
    let optional = [
        (tones(0), columns::E),
        (tones(0), columns::TH),
        (tones(1), columns::E3),
        (varies(|feeder| feeder.phase_lead), columns::PHASE_LEAD),
        (varies(|feeder| feeder.incline), columns::INCLINE),
    ];
    let hidden = optional.into_iter().filter(|(shown, _)| !shown);
    let hidden = hidden.map(|(_, column)| column);
    let view = hidden.fold(designed(file), View::without);
    let error = &design.error;
    let front = design.front.iter().map(|(feeder, simulated)| {
        json!({
            "frequency": feeder.frequency,
            "b": amplitude(file, feeder),
            "throw_angle": feeder.throw_angle,
            "k": feeder.k,
            "in_gear": simulated.share,
            "parts_a_minute": parts_a_minute(file, *simulated),
        })
    });
    let document = json!({
        "candidates": design.tried,
        "within_limits": design.within,
        "today": design.today.map(|today| all.object(&today)),
        "held_by": design.held_by,
        "rows": all.objects(&design.best),
        "front": front.collect::<Vec<_>>(),
        "table_error": {
            "in_gear_rms": error.share_rms,
            "in_gear_max": error.share_max,
            "speed_rms": error.speed_rms,
            "speed_max": error.speed_max,
        },
    });
    let [share_rms, share_max] = numbers([error.share_rms, error.share_max], 2);
    let speeds = [error.speed_rms, error.speed_max].map(|speed| 100.0 * speed);
    let [speed_rms, speed_max] = numbers(speeds, 2);
    let settings = &file.scene.settings;
    let report = view
        .printout(&design.best)
        .folded()
        .heading(format!(
            "Feeders with the same drive: R = {}..{}, scatter {}, parts of {} mm; {} of {} candidates are within its limits",
            settings.restitution_low,
            settings.restitution_high,
            settings.scatter,
            file.part_length,
            design.within,
            design.tried
        ))
        .csv_of(all.table_of(&design.best));
    let none = || "The scene's own feeder does not run: kband simulate says why.".into();
    let held = design.held_by.join(", ");
    let held = || format!("Most of these feeders are held by: {held}.");
    report
        .note(comparison(file, design).unwrap_or_else(none))
        .notes((!design.held_by.is_empty()).then(held))
        .note(format!(
            "The search took shares and speeds from a table. Its front differs from simulated parts by {share_rms} rms, at most {share_max}, in \
             share and {speed_rms} % rms, at most {speed_max} %, in speed; the rows are simulated parts."
        ))
        .json(document)
}

fn picture(file: &SceneFile, design: &Design) -> Picture {
    let simulated = |run: &Conveyed| (run.share, parts_a_minute(file, *run));
    let front: Vec<(f64, f64)> = design.front.iter().map(|(_, run)| simulated(run)).collect();
    let runs = |all: &[Designed]| -> Vec<(f64, f64)> {
        let closed = all.iter().filter_map(|row| row.closed);
        closed.map(|run| simulated(&run)).collect()
    };
    let closed = runs(&design.best);
    let today = runs(design.today.as_slice());
    let all: Vec<(f64, f64)> = [&front[..], &closed, &today].concat();
    let share = Axis::over_values("share of time in gear", "", all.iter().map(|at| at.0));
    let rate = Axis::over_values("parts a minute", "1/min", all.iter().map(|at| at.1));
    Picture::new("Parts a minute against share in gear, with the same drive")
        .caption(format!(
            "{} candidates, {} within the limits of the drive",
            design.tried, design.within
        ))
        .panel(
            Panel::new(share, rate)
                .line("front, simulated parts", 0, front)
                .markers("its feeders in the closed loop", 1, closed)
                .markers("the scene's own feeder", 2, today),
        )
}
