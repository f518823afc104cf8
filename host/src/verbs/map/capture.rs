//! `kband capture`: search for the kick of the amplitude that brings parts from rest into lock.

use std::task::Poll;

use kband::feeder::{OutOfRange, Restitution};
use kband::impact::ContactTime;
use kband::regime::band::Band;
use kband::regime::capture::{
    DriveLag, DriveLagSettings, Kick, KickSettings, Lot, Outcome, Plan, PlanSettings, Planner,
    ScoredKick, Trial, TrialRun,
};

use super::{common_band, describe_lot};
use crate::arguments::{self, AmplitudeArguments, OutputArguments, Range};
use crate::desk::Desk;
use crate::picture::{Axis, Grid, Panel, Picture};
use crate::random::SplitMix;
use crate::refusal::{Exit, Refusal, Result};
use crate::report::{Printout, columns, fields, number};

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

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let output = arguments.output.check()?;
    let task = Task::new(arguments)?;
    let plan = task.plan(desk)?;
    let map = Kicks::draw(&task, &plan, desk)?;
    let rates = capture_rates(&task, &plan, desk)?;
    let report = report(&task, &plan, &map, &rates);
    output.show(&report, || map.picture(&task, &plan))
}

/// Number of impacts after which a part counts as not captured.
const MAX_IMPACTS: u32 = 20_000;

fn captures(part: Trial, drive: DriveLag, kick: Kick) -> Result<bool> {
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
    fn new(arguments: &'a Arguments) -> Result<Self> {
        let order = arguments.order as u32;
        let contact = ContactTime::INSTANT;
        let band = common_band(arguments.restitution, order, contact)?.map_err(|none| {
            let next = "narrow --restitution, or choose another --order";
            Refusal::new(none.to_string(), next)
        })?;
        let k = (arguments.amplitude.or_k(arguments.k)?).unwrap_or(band.setpoint());
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
                contact,
            },
            drive: drive(arguments.start)?,
            retry_drive: drive(1.0)?,
        })
    }

    fn plan(&self, desk: &Desk) -> Result<Plan> {
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

/// Capture rates of a lot, shares of the parts 0..1, by Monte Carlo simulation: without a kick, then
/// after each attempt, including earlier ones. Restitution and relative error of the amplitude are
/// uniform within the lot's ranges.
fn capture_rates(task: &Task<'_>, plan: &Plan, desk: &Desk) -> Result<Vec<f64>> {
    let (runs, attempts) = (task.arguments.runs, task.arguments.attempts);
    let results = desk.try_map("capture runs", runs, |run| {
        let seed = (task.arguments.seed as u64).wrapping_mul(0xD129_0B26_68E5_4F27);
        let mut random = SplitMix(SplitMix(seed.wrapping_add(run as u64)).bits());
        let (low, high) = (task.lot.restitution.low(), task.lot.restitution.high());
        let part = Trial {
            restitution: random.within(low, high),
            k: task.lot.k / (1.0 + task.lot.amplitude_error * random.within(-1.0, 1.0)),
            order: task.lot.order,
            contact: task.lot.contact,
        };
        let alone = captures(part, task.drive, Kick::NONE)?;
        for attempt in 0..attempts {
            let drive = [task.drive, task.retry_drive][attempt.min(1)];
            let Some(kick) = plan.attempt(attempt as u32) else {
                break;
            };
            if captures(part, drive, kick)? {
                return Ok((alone, attempt));
            }
        }
        Ok((alone, attempts))
    })?;
    let alone = results.iter().filter(|(alone, _)| *alone).count();
    let after = |last: usize| results.iter().filter(|(_, at)| *at <= last).count();
    let counts = std::iter::once(alone).chain((0..attempts).map(after));
    Ok(counts.map(|count| count as f64 / runs as f64).collect())
}

fn describe_kick(kick: KickSettings) -> String {
    let mut text = format!("factor {} for {} cycles", number(kick.factor, 4), kick.hold);
    if kick.descent > 0 {
        let (release, descent) = (number(kick.release, 4), kick.descent);
        text += &format!(", falling to {release} within {descent} more");
    }
    text
}

/// Name of a kick, the kick, and the share of parts captured by it or by earlier ones.
type Attempt = (String, KickSettings, f64);

fields! {
    fn attempt_view(row: Attempt) {
        read ATTEMPT => row.0.clone();
        all FACTOR.digits(4) => f64::from(row.1.factor);
        all HOLD => u32::from(row.1.hold);
        all DESCENT => u32::from(row.1.descent);
        all RELEASE.digits(4) => f64::from(row.1.release);
        read CAPTURED.titled("captured so far").digits(4) => row.2;
        data SHARE => row.2;
    }
}

fn report(task: &Task<'_>, plan: &Plan, map: &Kicks, rates: &[f64]) -> Printout {
    let kicks = (0..task.arguments.attempts as u32).filter_map(|attempt| plan.attempt(attempt));
    let kicks: Vec<KickSettings> = kicks.map(|kick| kick.settings()).collect();
    let mut attempts = vec![("band alone".to_string(), Kick::NONE.settings(), rates[0])];
    for (n, kick) in (1..).zip(&kicks) {
        attempts.push((n.to_string(), *kick, rates[n]));
    }
    let Lot { order, k, .. } = task.lot;
    let lot = describe_lot(task.lot.restitution);
    let (low, high) = (task.band.low(), task.band.high());
    let (runs, seed) = (task.arguments.runs, task.arguments.seed);
    let mut report = attempt_view().printout(&attempts).heading(format!(
        "{lot}, order {order}, k = {k:.4} in the band {low:.4}..{high:.4}; {runs} runs, seed {seed}"
    ));
    report = match plan.best() {
        Some(best) => report.note(format!(
            "best planned kick: {}; it captured {} of {} parts",
            describe_kick(best.kick.settings()),
            best.locked,
            best.tried
        )),
        None if plan.effort() < task.arguments.effort as u32 => report.note(format!(
            "no kick of the plan captured a part, and every kick up to {} times the amplitude was tried: choose \
             another k or --order",
            task.arguments.limit
        )),
        None => report.note("no kick of the plan captured a part: raise --effort"),
    };
    let (impacts, set_ups, tried) = (plan.impacts, plan.set_ups, plan.kicks);
    let (effort, max_effort) = (plan.effort(), task.arguments.effort);
    report = report.note(format!(
        "the plan took {impacts} impacts and {set_ups} set-ups of the map ({effort} of {max_effort} of effort), {tried} kicks tried"
    ));
    let kick_alone = attempt_view().without(columns::SHARE);
    let kick = |kick: KickSettings| kick_alone.object(&(String::new(), kick, 0.0));
    let cells = map.cells();
    let report = report.json(serde_json::json!({
        "restitution": [task.lot.restitution.low(), task.lot.restitution.high()],
        "order": order,
        "k": k,
        "band": [low, high],
        "best": plan.best().map(|best: ScoredKick| serde_json::json!({
            "kick": kick(best.kick.settings()),
            "tried": best.tried,
            "locked": best.locked,
        })),
        "plan": {
            "impacts": plan.impacts,
            "set_ups": plan.set_ups,
            "effort": plan.effort(),
            "kicks": plan.kicks,
            "attempts": kicks.into_iter().map(kick).collect::<Vec<_>>(),
        },
        "runs": runs,
        "seed": seed,
        "captured_alone": rates[0],
        "captured": rates[1..],
        "map": attempt_view().objects(&cells),
    }));
    report.csv_of(attempt_view().table_of(&cells))
}

struct Kicks {
    factors: Vec<f64>,
    /// Number of cycles of hold, or of descent after the hold in `slow`.
    lengths: Vec<u16>,
    /// Shape of the kicks. `Some`: a hold of this length, then a descent; its end is this share of
    /// the range from the target to the factor.
    slow: Option<(u16, f32)>,
    shares: Vec<f64>,
}

const LENGTH_COUNT: usize = 48;

impl Kicks {
    fn draw(task: &Task<'_>, plan: &Plan, desk: &Desk) -> Result<Self> {
        let best = plan.best().map_or(Kick::NONE, |best| best.kick).settings();
        let slow = (best.descent > 40).then(|| {
            let release_share = (best.release - 1.0) / (best.factor - 1.0);
            (best.hold, release_share)
        });
        let longest = task.arguments.longest.unwrap_or(match slow {
            Some(_) => (2 * usize::from(best.descent)).max(120),
            None => (10.0 * task.arguments.time_constant) as usize + LENGTH_COUNT / 4,
        });
        let lengths = (0..LENGTH_COUNT).map(|n| (n * longest / (LENGTH_COUNT - 1)) as u16);
        let mut map = Self {
            factors: task.arguments.factor.values().collect(),
            lengths: lengths.collect(),
            slow,
            shares: Vec::new(),
        };
        map.shares = desk.try_map("capture map", map.factors.len() * LENGTH_COUNT, |cell| {
            let Ok(kick) = map.kick(cell) else {
                return Ok(0.0);
            };
            let mut locked = 0_u32;
            for part in 0..task.arguments.parts {
                locked += u32::from(captures(task.lot.part(part as u32), task.drive, kick)?);
            }
            Ok(f64::from(locked) / task.arguments.parts as f64)
        })?;
        Ok(map)
    }

    fn kick(&self, cell: usize) -> Result<Kick, OutOfRange> {
        let factor = self.factors[cell / LENGTH_COUNT] as f32;
        let length = self.lengths[cell % LENGTH_COUNT];
        let (hold, descent, release) = match self.slow {
            None => (length, 0, 1.0),
            Some((hold, share)) => {
                let release = 1.0 + (factor - 1.0) * share;
                (hold, length, release.clamp(1.0, factor))
            }
        };
        Kick::build(KickSettings {
            factor,
            hold,
            descent,
            release,
        })
    }

    /// Every kick of the map with its captured share, except those beyond the drive's limit.
    fn cells(&self) -> Vec<Attempt> {
        let shares = self.shares.iter().enumerate();
        let kicks = shares.filter_map(|(cell, share)| {
            let kick = self.kick(cell).ok()?;
            Some((String::new(), kick.settings(), *share))
        });
        kicks.collect()
    }

    fn picture(&self, task: &Task<'_>, plan: &Plan) -> Picture {
        let span = |values: &[f64]| {
            let (first, last) = (values[0], values[values.len() - 1]);
            let half = 0.5 * (last - first) / (values.len().max(2) - 1) as f64;
            (first - half, last + half)
        };
        let lengths: Vec<f64> = self.lengths.iter().map(|length| (*length).into()).collect();
        let (left, right) = span(&lengths);
        let (bottom, top) = span(&self.factors);
        let (title, shape) = match self.slow {
            None => ("hold", "rectangular kicks".to_string()),
            Some((hold, release_share)) => (
                "descent of the amplitude",
                format!(
                    "kicks held {hold} cycles, then falling to {:.0} % of the way down",
                    100.0 * (1.0 - release_share)
                ),
            ),
        };
        let length = Axis::new(title, "drive cycles", left, right);
        let factor = Axis::new("factor of the amplitude", "", bottom, top);
        let captured = Axis::new("share of the parts captured", "", 0.0, 1.0);
        let grid = Grid::new(LENGTH_COUNT, self.shares.clone());
        let mut panel = Panel::new(length, factor)
            .height(420.0)
            .heat(grid, captured);
        let place = |kick: KickSettings| {
            let length = self.slow.map_or(kick.hold, |_| kick.descent);
            (f64::from(length), f64::from(kick.factor))
        };
        let planned = plan.best().map(|best| place(best.kick.settings()));
        if let Some((x, y)) = planned.filter(|(x, y)| *x <= right && *y <= top) {
            panel = panel.markers("planned as on the board", 1, vec![(x, y)]);
        }
        let (lot, k) = (describe_lot(task.lot.restitution), number(task.lot.k, 4));
        let (error, parts) = (task.arguments.amplitude_error, task.arguments.parts);
        let time_constant = task.arguments.time_constant;
        Picture::new(format!("Kicks that capture parts in lock of order {}", task.lot.order))
            .caption(format!(
                "{lot}, k = {k}, amplitude within {error} %, time constant {time_constant} cycles; {shape}; {parts} parts each"
            ))
            .panel(panel)
    }
}
