//! `kband bench`: run time against error of every arithmetic, and what users wait for.

mod chained;
mod classed;
mod scaled;
mod waited;

use crate::arguments::{self, Drawn, Printed};
use crate::bench::contest::{Contestant, LAUNCHES, contestants};
use crate::bench::instructions::{self, Count};
use crate::bench::workload::Workload;
use crate::bench::{Measurement, median, scaling, scene, skips, waves};
use crate::desk::{Desk, Progress};
use crate::picture::{Axis, Panel, Picture, Unit};
use crate::refusal::{Exit, Refusal};
use crate::report::{Printout, Table, columns, number};

/// Run time against error of every arithmetic of the impact map, and what each skip saves.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband bench
  kband bench --format json
  kband bench --out time-against-error.svg
  kband bench --on qemu
  kband bench --on qemu --show classes
  kband bench --show chains
  kband bench --show verbs --only diagram
  kband bench --show scaling --impacts 100000000 --out scaling.svg

All kernels take turns in one run on one core, of 4096 launches (batch of 16384); the median of \
the turns counts. The errors are those of the phase of the next impact against f64, whose own are 0. Workloads: high \
(velocities up to 20), low (up to 3), chatter (1e-6 to 1), sweep (orbits over k and restitution), \
each on one tone and on two, e 0.15, th 2.356 (NAME-tones); batch in the widest registers of this \
CPU, batch-single one orbit at a time; then one pair of lines for each skip, and one line for each fidelity of the closed loop (scene: a \
drive cycle with one impact). Instructions are those of the emulated microcontrollers, where \
tests/run.sh has built their images here.")]
pub struct Arguments {
    /// Where: times at the desk, or instructions of the emulated microcontrollers alone.
    #[arg(long, value_enum, default_value_t = On::Desk)]
    on: On,

    /// What is measured.
    #[arg(long, value_enum, default_value_t = Show::Kernels)]
    show: Show,

    /// How often everything is measured [default: 11, of chains 41, of verbs 3].
    #[arg(long, value_name = "N", value_parser = arguments::count(1, 1000))]
    rounds: Option<usize>,

    /// Launches of each workload [default: 16384].
    #[arg(long, value_name = "N", value_parser = arguments::count(512, 1_000_000))]
    launches: Option<usize>,

    /// With --show verbs: only the commands of this verb.
    #[arg(long, value_name = "VERB")]
    only: Option<String>,

    /// With --show scaling: most impacts that are made at once [default: 1e7].
    #[arg(long, value_name = "N", value_parser = arguments::count(scaling::LEAST, 1_000_000_000))]
    impacts: Option<usize>,

    #[command(flatten)]
    printed: Printed,

    #[command(flatten)]
    drawn: Drawn,
}

/// How often each kernel goes through its launches.
const ROUNDS: usize = 11;

/// What is measured on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum On {
    /// This CPU.
    Desk,
    /// A Cortex-M4F and a Cortex-M0, emulated.
    Qemu,
}

/// What is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Show {
    /// Run time against error of every arithmetic.
    Kernels,
    /// An impact of one orbit, each from where the one before ended.
    Chains,
    /// What users wait for: whole commands, with one thread and with two.
    Verbs,
    /// The cost of an impact by how many are made, with one thread and with two.
    Scaling,
    /// With --on qemu: instructions of an impact by their class.
    Classes,
}

impl Arguments {
    fn rounds(&self, default: usize) -> usize {
        self.rounds.unwrap_or(default)
    }
}

/// Measures and prints.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    match arguments.show {
        Show::Classes => classed::run(arguments),
        _ if arguments.on == On::Qemu => count(arguments),
        Show::Kernels => kernels(arguments, desk),
        Show::Chains => chained::run(arguments, desk),
        Show::Verbs => waited::run(arguments, desk),
        Show::Scaling => scaled::run(arguments, desk),
    }
}

fn kernels(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.drawn.output()?;
    let mut lines = Vec::new();
    let progress = Progress::new("bench", Workload::ALL.len() as u64 + 2);
    for workload in Workload::ALL {
        lines.extend(measure(workload, arguments, desk)?);
        progress.advance(1);
    }
    let skips = skips::lines(arguments.rounds(ROUNDS));
    progress.advance(1);
    desk.go_on()?;
    let scenes = scene::lines(arguments.rounds(ROUNDS));
    progress.finish();
    let (counts, missing) = instructions::counts();

    let mut table = Table::new(&[
        columns::KERNEL,
        columns::WORKLOAD,
        columns::IMPACT_TIME.digits(4),
        columns::IMPACT_RATE.digits(3),
        columns::MEDIAN_ERROR.digits(2),
        columns::P99_ERROR.digits(2),
        columns::MAX_ERROR.digits(2),
        columns::WRONG_ROOTS,
        columns::INSTRUCTIONS_M4F,
        columns::INSTRUCTIONS_M0,
    ]);
    for line in lines.iter().chain(&skips).chain(&scenes) {
        let count = |cpu: &str| find(&counts, line, cpu);
        table.push([
            line.kernel.into(),
            line.workload.into(),
            line.nanoseconds.into(),
            (1e9 / line.nanoseconds).into(),
            line.errors.map(|errors| errors.median).into(),
            line.errors.map(|errors| errors.p99).into(),
            line.errors.map(|errors| errors.largest).into(),
            line.errors.map(|errors| errors.wrong_roots).into(),
            count("m4f").into(),
            count("m0").into(),
        ]);
    }
    let mut report = Printout::new(table).heading("Run time against error, one core, one run");
    for workload in Workload::ALL {
        if let (Some(textbook), Some(f64), Some(batch)) = (
            time(&lines, "textbook", workload),
            time(&lines, "f64", workload),
            time(&lines, "batch", workload),
        ) {
            report = report.note(format!(
                "{}: f64 is {} times as fast as the textbook, batch makes {} million impacts a second",
                workload.name(),
                number(textbook / f64, 3),
                number(1e3 / batch, 3),
            ));
        }
    }
    for workload in Workload::ALL {
        let over = |kernel: &str, tones: &str| {
            Some(time(&lines, tones, workload)? / time(&lines, kernel, workload)?)
        };
        if let (Some(f64), Some(single)) = (over("f64", "f64-tones"), over("f32", "f32-tones")) {
            report = report.note(format!(
                "{}, two tones over one: f64 {}, f32 {}",
                workload.name(),
                number(f64, 3),
                number(single, 3),
            ));
        }
    }
    for line in &scenes {
        report = report.note(format!(
            "closed loop, {}: {} times real time (the default scene in lock, one impact a cycle)",
            line.kernel,
            number(scene::times_real_time(line), 3),
        ));
    }
    if let Some(cause) = missing {
        report = report.note(format!("no instruction counts: {cause}"));
    }
    report.print(arguments.printed.format)?;
    output.write(&report, || picture(&lines))?;
    Ok(Exit::Done)
}

/// The instructions of an impact, and of it on two tones over it on one.
fn count(arguments: &Arguments) -> Result<Exit, Refusal> {
    let (counts, missing) = instructions::counts();
    if let Some(cause) = missing {
        return Err(Refusal::new(cause, instructions::NEXT));
    }
    let mut table = Table::new(&[
        columns::KERNEL,
        columns::WORKLOAD,
        columns::CPU,
        columns::INSTRUCTIONS,
        columns::INSTRUCTIONS_TONES,
        columns::TONES_OVER_ONE.digits(3),
    ]);
    for one in counts
        .iter()
        .filter(|count| !count.kernel.ends_with("-tones"))
    {
        let tones = counts.iter().find(|count| {
            count.kernel.strip_suffix("-tones") == Some(&one.kernel)
                && (&count.workload, &count.cpu) == (&one.workload, &one.cpu)
        });
        table.push([
            one.kernel.as_str().into(),
            one.workload.as_str().into(),
            one.cpu.as_str().into(),
            one.instructions.into(),
            tones.map(|tones| tones.instructions).into(),
            tones
                .map(|tones| tones.instructions as f64 / one.instructions as f64)
                .into(),
        ]);
    }
    Printout::new(table)
        .heading("Instructions of an impact on the emulated microcontrollers")
        .print(arguments.printed.format)?;
    Ok(Exit::Done)
}

fn measure(
    workload: Workload,
    arguments: &Arguments,
    desk: &Desk,
) -> Result<Vec<Measurement>, Refusal> {
    let count = arguments.launches.unwrap_or(16_384);
    let launches = workload.launches(count);
    let mut contestants = contestants(workload, &launches);
    contestants.extend(waves::contestants(workload, count));
    // Of each turn the median of the rounds, of a workload the mean of its turns.
    let mut times: Vec<Vec<Vec<f64>>> = contestants
        .iter()
        .map(|contestant| vec![Vec::new(); contestant.turns().max(1)])
        .collect();
    for turn in 0..arguments.rounds(ROUNDS) * launches.len().div_ceil(LAUNCHES) {
        for (contestant, times) in contestants.iter_mut().zip(&mut times) {
            desk.go_on()?;
            let turns = times.len();
            // Another turn first: wide registers take tens of microseconds to come up to speed after the
            // others' turns, and a sweep runs for seconds.
            contestant.turn(turn + 1);
            times[turn % turns].push(contestant.turn(turn));
        }
    }
    let line = |(mut contestant, times): (Box<dyn Contestant>, Vec<Vec<f64>>)| {
        let medians: Vec<f64> = times
            .into_iter()
            .filter(|turn| !turn.is_empty())
            .map(median)
            .collect();
        Measurement {
            kernel: contestant.name(),
            workload: workload.name(),
            nanoseconds: medians.iter().sum::<f64>() / medians.len() as f64,
            errors: Some(contestant.errors()),
        }
    };
    Ok(contestants.into_iter().zip(times).map(line).collect())
}

fn time(lines: &[Measurement], kernel: &str, workload: Workload) -> Option<f64> {
    lines
        .iter()
        .find(|line| line.kernel == kernel && line.workload == workload.name())
        .map(|line| line.nanoseconds)
}

fn find(counts: &[Count], line: &Measurement, cpu: &str) -> Option<u64> {
    counts
        .iter()
        .find(|count| {
            count.kernel == line.kernel && count.workload == line.workload && count.cpu == cpu
        })
        .map(|count| count.instructions)
}

/// Time across, error up, both in decades; down and to the left is better. Each kernel is one kind of
/// marker; a line joins those that nothing beats in both.
fn picture(lines: &[Measurement]) -> Picture {
    // An error of 0 is drawn at the foot.
    const FOOT: f64 = 1e-18;
    let place = |line: &Measurement| {
        let error = line.errors.map_or(f64::NAN, |errors| errors.median);
        (line.nanoseconds, error.max(FOOT))
    };
    let all: Vec<(f64, f64)> = lines.iter().map(place).collect();
    let (mut fastest, mut slowest) = (f64::INFINITY, 0.0_f64);
    let mut coarsest = FOOT;
    for (time, error) in all.iter().filter(|(_, error)| error.is_finite()) {
        fastest = fastest.min(*time);
        slowest = slowest.max(*time);
        coarsest = error.max(coarsest);
    }
    let mut picture = Picture::new("Run time against error of the impact map")
        .caption("Down and to the left is better; the line joins what nothing beats in both. f64 is what the others are compared with");
    for workload in [Workload::High, Workload::Low] {
        let name = workload.name();
        let mut panel = Panel::new(
            Axis::new(
                "Time of one impact",
                Unit::new("ns"),
                0.5 * fastest,
                2.0 * slowest,
            )
            .logarithmic(),
            Axis::new(
                "Median error of its phase",
                Unit::RADIANS,
                0.1 * FOOT,
                10.0 * coarsest,
            )
            .logarithmic(),
        )
        .heading(match workload {
            Workload::High => "Velocities up to 20",
            _ => "Velocities up to 3",
        })
        .height(300.0);
        let mut points: Vec<(f64, f64)> = Vec::new();
        for line in lines.iter().filter(|line| line.workload == name) {
            points.push(place(line));
        }
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut front: Vec<(f64, f64)> = Vec::new();
        for point in points {
            if front.last().is_none_or(|best| point.1 < best.1) {
                if let Some(&(_, error)) = front.last() {
                    front.push((point.0, error));
                }
                front.push(point);
            }
        }
        panel = panel.line("front", 0, front);
        let groups: [(&str, &[&str]); 3] = [
            ("baselines", &["bracket", "textbook"]),
            ("desk", &["f64", "batch"]),
            (
                "microcontrollers' arithmetic, run at the desk",
                &["hybrid", "f32", "integer"],
            ),
        ];
        for (series, (group, kernels)) in groups.into_iter().enumerate() {
            let members = lines
                .iter()
                .filter(|line| line.workload == name && kernels.contains(&line.kernel));
            panel = panel.markers(group, series + 1, members.clone().map(place).collect());
            for line in members {
                let (x, y) = place(line);
                panel = panel.note(x, y, line.kernel);
            }
        }
        picture = picture.panel(panel);
    }
    picture
}
