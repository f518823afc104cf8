//! `kband capture`: search for the kick of the amplitude that brings parts from rest into lock.
//!
//! It prints the controller's plan, a map of the captured share over factor and length (cycles) of
//! the kick, and capture rates of random parts.

mod draws;
mod kicks;
mod page;

use draws::Rates;
use kicks::Kicks;
use page::report;

use std::task::Poll;

use kband::feeder::Restitution;
use kband::impact::ContactTime;
use kband::regime::band::Band;
use kband::regime::band::BandError;
use kband::regime::capture::{
    DriveLag, DriveLagSettings, Kick, Lot, Outcome, Plan, PlanSettings, Planner, Trial, TrialRun,
};

use crate::arguments::{self, AmplitudeArguments, OutputArguments, Range};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use crate::report::span;

/// Find the kick of the amplitude that brings the parts of a lot from rest onto the locked orbit.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband capture --restitution 0.28..0.32 --out capture.svg
  kband capture --restitution 0.48..0.52 --runs 1000 --seed 1
  kband capture --restitution 0.2 --k 0.43 --time-constant 8 --format json
  kband capture --restitution 0.2 --b 0.235 --frequency 50

The plan is that of the board, with its arithmetic and effort. The map tries kicks of every factor \
and length on parts of the lot. The runs draw other parts at random and use f64.")]
pub struct Arguments {
    /// Restitution of the part, or LO..HI of the lot.
    #[arg(long, value_name = "R|LO..HI", default_value = "0.28..0.32", value_parser = arguments::restitution)]
    restitution: Restitution,

    /// Order of the requested lock: drive cycles per impact.
    #[arg(long, value_name = "r", default_value = "1", value_parser = arguments::count(1, 100))]
    order: usize,

    /// Target k [default: the setpoint of the band].
    #[arg(long, value_parser = arguments::within(0.001, 1000.0, ""))]
    k: Option<f64>,

    #[command(flatten)]
    amplitude: AmplitudeArguments,

    /// Largest error of the amplitude in per cent.
    #[arg(long, value_name = "PERCENT", default_value = "2", value_parser = arguments::within(0.0, 20.0, "per cent"))]
    amplitude_error: f64,

    /// Time constant of the drive's amplitude in drive cycles.
    #[arg(long, value_name = "CYCLES", default_value = "5", value_parser = arguments::within(0.0, 1000.0, "drive cycles"))]
    time_constant: f64,

    /// Amplitude before the kick over the target amplitude.
    #[arg(long, value_name = "FACTOR", default_value = "0", value_parser = arguments::within(0.0, 1.0, ""))]
    start: f64,

    /// Largest amplitude of the drive over the target amplitude.
    #[arg(long, value_name = "FACTOR", default_value = "2.5", value_parser = arguments::within(1.0, 10.0, ""))]
    limit: f64,

    /// Effort of the plan in impacts; the board uses the default.
    #[arg(long, value_name = "IMPACTS", default_value_t = PlanSettings::DEFAULT_EFFORT as usize,
          value_parser = arguments::count(1000, 1_000_000_000))]
    effort: usize,

    /// Factors of the map, LO..HI[:N] times the target amplitude.
    #[arg(long, value_name = "RANGE", default_value = "1..2.5:46",
          value_parser = arguments::range_or_value((1.0, 10.0), 46))]
    factor: Range,

    /// Longest kick of the map in drive cycles [default: from the plan].
    #[arg(long, value_name = "CYCLES", value_parser = arguments::count(10, 10_000))]
    longest: Option<usize>,

    /// Number of parts on which each kick of the map is tried.
    #[arg(long, value_name = "N", default_value = "12", value_parser = arguments::count(1, 1000))]
    parts: usize,

    /// Number of random parts for the capture rates.
    #[arg(long, value_name = "N", default_value = "200", value_parser = arguments::count(1, 1_000_000))]
    runs: usize,

    /// Seed of the random parts.
    #[arg(long, value_name = "S", default_value = "1", value_parser = arguments::count(0, usize::MAX))]
    seed: usize,

    /// Largest number of kicks for a part until it is captured.
    #[arg(long, value_name = "N", default_value = "6", value_parser = arguments::count(1, 20))]
    attempts: usize,

    #[command(flatten)]
    output: OutputArguments,
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.output.check()?;
    let task = Task::new(arguments)?;
    let plan = task.plan(desk)?;
    let map = Kicks::draw(&task, &plan, desk)?;
    let rates = Rates::measure(&task, &plan, desk)?;
    let report = report(&task, &plan, &map, &rates)?;
    output.show(&report, || map.picture(&task, &plan))
}

/// Number of impacts after which a part counts as not captured.
const MAX_IMPACTS: u32 = 20_000;

/// Whether one kick captures one part.
fn captures(part: Trial, drive: DriveLag, kick: Kick) -> Result<bool, Refusal> {
    let mut trial_run = TrialRun::new(part, drive, kick)?;
    while trial_run.steps() < MAX_IMPACTS {
        if let Some(outcome) = trial_run.simulate_impact() {
            return Ok(outcome == Outcome::Locked);
        }
    }
    Ok(false)
}

struct Task<'a> {
    arguments: &'a Arguments,
    band: Band,
    lot: Lot,
    drive: DriveLag,
    /// The same drive for later attempts, which start at the target amplitude.
    retry_drive: DriveLag,
}

impl<'a> Task<'a> {
    fn new(arguments: &'a Arguments) -> Result<Self, Refusal> {
        let order = arguments.order as u32;
        let band = Band::common(arguments.restitution, order).map_err(|error| match error {
            BandError::OutOfRange(refusal) => Refusal::from(refusal),
            BandError::Empty(none) => Refusal::new(
                none.to_string(),
                "narrow --restitution, or choose another --order",
            ),
        })?;
        let k = arguments.amplitude.or_k(arguments.k)?;
        let k = k.unwrap_or(band.setpoint());
        if !band.contains(k) {
            let (low, high) = (band.low(), band.high());
            return Err(Refusal::value(
                "the target",
                arguments.amplitude.describe(k)?,
                format!("k = {low:.4}..{high:.4}, the band of order {order} for this restitution"),
                "leave out --k and --b for the setpoint with the largest margin",
            ));
        }
        let drive = |start| {
            DriveLag::build(DriveLagSettings {
                time_constant: arguments.time_constant,
                start,
                limit: arguments.limit,
            })
        };
        Ok(Self {
            arguments,
            band,
            lot: Lot {
                k,
                restitution: arguments.restitution,
                order,
                amplitude_error: arguments.amplitude_error / 100.0,
                contact: ContactTime::INSTANT,
            },
            drive: drive(arguments.start)?,
            retry_drive: drive(1.0)?,
        })
    }

    /// Restitution of the lot in words: a number, or `LO..HI`.
    fn restitution(&self) -> String {
        span(self.lot.restitution.low(), self.lot.restitution.high(), 6)
    }

    fn plan(&self, desk: &Desk) -> Result<Plan, Refusal> {
        let mut planner = Planner::new(PlanSettings {
            lot: self.lot,
            drive: self.drive,
            time_constant: self.arguments.time_constant,
            effort: self.arguments.effort as u32,
        })?;
        loop {
            desk.check_stop()?;
            if let Poll::Ready(plan) = planner.advance(10_000) {
                return Ok(plan);
            }
        }
    }
}
