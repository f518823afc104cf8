//! `kband capture`: which kick of the amplitude brings parts from rest onto the locked orbit.

use kband::feeder::Restitution;
use kband::impact::{Hybrid, Kernel, Map};
use kband::regime::Band;
use kband::regime::band::BandError;
use kband::regime::capture::{
    Drive, DriveSettings, Follow, Kick, KickSettings, Lot, Outcome, Plan, PlanSettings, Planner,
    Progress, Scored, Trial,
};

use crate::arguments::{self, Drawn, Printed, Range};
use crate::desk::Desk;
use crate::picture::{Axis, Grid, Panel, Picture, Unit};
use crate::refusal::{Exit, Refusal};
use crate::report::{Column, Report, Table, number};

/// Which kick of the amplitude brings parts from rest onto the locked orbit, for a whole lot of parts.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband capture --restitution 0.28..0.32 --out capture.svg
  kband capture --restitution 0.48..0.52 --runs 1000 --seed 1
  kband capture --restitution 0.2 --k 0.43 --time-constant 8 --format json

The plan is the one the board makes, with the board's arithmetic and effort. The map tries kicks of every
factor and length on parts of the lot; the runs draw other parts at random, in f64.")]
pub struct Arguments {
    /// Restitution of the part, or LO..HI of the lot.
    #[arg(long, value_name = "R|LO..HI", default_value = "0.28..0.32", value_parser = arguments::restitution)]
    restitution: Restitution,

    /// Drive cycles per impact of the lock that is wanted.
    #[arg(long, value_name = "r", default_value = "1", value_parser = arguments::count(1, 100))]
    order: usize,

    /// Target k [default: the setpoint of the band].
    #[arg(long, value_parser = arguments::within(0.001, 1000.0, ""))]
    k: Option<f64>,

    /// How far off the true amplitude may be, in per cent.
    #[arg(long, value_name = "PERCENT", default_value = "2", value_parser = arguments::within(0.0, 20.0, "per cent"))]
    amplitude_error: f64,

    /// Time constant of the drive's amplitude in drive cycles.
    #[arg(long, value_name = "CYCLES", default_value = "5", value_parser = arguments::within(0.0, 1000.0, "drive cycles"))]
    time_constant: f64,

    /// Amplitude before the kick over the target amplitude.
    #[arg(long, value_name = "FACTOR", default_value = "0", value_parser = arguments::within(0.0, 1.0, ""))]
    start: f64,

    /// Highest amplitude of the drive over the target amplitude.
    #[arg(long, value_name = "FACTOR", default_value = "2.5", value_parser = arguments::within(1.0, 10.0, ""))]
    limit: f64,

    /// Effort of the plan in impacts; the board spends the default.
    #[arg(long, value_name = "IMPACTS", default_value_t = PlanSettings::EFFORT as usize,
          value_parser = arguments::count(1000, 1_000_000_000))]
    effort: usize,

    /// Factors of the map, LO..HI[:N] times the target amplitude.
    #[arg(long, value_name = "RANGE", default_value = "1..2.5:46",
          value_parser = arguments::range_or_value((1.0, 10.0), 46))]
    factor: Range,

    /// Longest kick of the map in drive cycles [default: to suit the plan].
    #[arg(long, value_name = "CYCLES", value_parser = arguments::count(10, 10_000))]
    longest: Option<usize>,

    /// Parts that each kick of the map is tried on.
    #[arg(long, value_name = "N", default_value = "12", value_parser = arguments::count(1, 1000))]
    parts: usize,

    /// Parts drawn at random for the capture rates.
    #[arg(long, value_name = "N", default_value = "200", value_parser = arguments::count(1, 1_000_000))]
    runs: usize,

    /// Seed of the random parts.
    #[arg(long, value_name = "S", default_value = "1", value_parser = arguments::count(0, usize::MAX))]
    seed: usize,

    /// Kicks tried on each part that the kicks before have not captured.
    #[arg(long, value_name = "N", default_value = "6", value_parser = arguments::count(1, 20))]
    attempts: usize,

    #[command(flatten)]
    printed: Printed,

    #[command(flatten)]
    drawn: Drawn,
}

/// Plans, maps, and draws parts at random.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.drawn.output()?;
    let task = Task::new(arguments)?;
    let plan = task.plan(desk)?;
    let map = Kicks::draw(&task, &plan, desk)?;
    let rates = Rates::measure(&task, &plan, desk)?;
    let report = report(&task, &plan, &map, &rates)?;
    report.print(arguments.printed.format)?;
    output.write(&report, || map.picture(&task, &plan))?;
    Ok(Exit::Done)
}

/// What is to be captured, by what.
struct Task<'a> {
    arguments: &'a Arguments,
    band: Band,
    lot: Lot,
    drive: Drive,
    /// The same drive for another attempt: the parts hop and rest at the target amplitude.
    again: Drive,
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
        let k = arguments.k.unwrap_or(band.setpoint());
        if !band.contains(k) {
            return Err(Refusal::value(
                "k",
                k,
                format!(
                    "{:.4}..{:.4}, the band of order {order} for this restitution",
                    band.low(),
                    band.high()
                ),
                "leave out --k for the setpoint with the largest margin",
            ));
        }
        let drive = |start| {
            Drive::build(DriveSettings {
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
            },
            drive: drive(arguments.start)?,
            again: drive(1.0)?,
        })
    }

    fn plan(&self, desk: &Desk) -> Result<Plan, Refusal> {
        let mut planner = Planner::<Hybrid>::new(PlanSettings {
            lot: self.lot,
            drive: self.drive,
            time_constant: self.arguments.time_constant,
            effort: self.arguments.effort as u32,
        })?;
        loop {
            desk.go_on()?;
            if let Progress::Done(plan) = planner.advance(10_000) {
                return Ok(plan);
            }
        }
    }
}

/// Impacts after which a part counts as missed.
const LONGEST: u32 = 20_000;

/// Whether `kick` captures a part.
fn captures<K: Kernel>(part: Trial, drive: Drive, kick: Kick) -> Result<bool, Refusal> {
    let mut follow = Follow::<K>::new(part, drive, kick)?;
    while follow.steps() < LONGEST {
        if let Some(outcome) = follow.step() {
            return Ok(outcome == Outcome::Locked);
        }
    }
    Ok(false)
}

/// Share of the lot's parts that each kick captures, over factor and length.
struct Kicks {
    factors: Vec<f64>,
    /// Cycles of hold, or of descent after `hold`.
    lengths: Vec<u16>,
    /// Shape of the kicks: where `Some`, lengths are descents after this hold that end at this share of
    /// the way from the target to the factor.
    slow: Option<(u16, f32)>,
    shares: Vec<f64>,
    best: Option<Widest>,
}

/// The kick of the map in the middle of the widest patch.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Widest {
    kick: KickSettings,
    share: f64,
    /// The factor may be off by this fraction and the length by so many cycles, both at once.
    factor_margin: f64,
    length_margin: f64,
}

/// Lengths in a map.
const LENGTHS: usize = 48;

impl Kicks {
    fn draw(task: &Task<'_>, plan: &Plan, desk: &Desk) -> Result<Self, Refusal> {
        let best = plan.best().map_or(Kick::NONE, |best| best.kick).settings();
        let slow = (best.descent > 40).then(|| {
            let way = (best.release - 1.0) / (best.factor - 1.0);
            (best.hold, way)
        });
        let longest = task.arguments.longest.unwrap_or(match slow {
            Some(_) => (2 * usize::from(best.descent)).max(120),
            None => (10.0 * task.arguments.time_constant) as usize + LENGTHS / 4,
        });
        let factors: Vec<f64> = task.arguments.factor.values().collect();
        let lengths: Vec<u16> = (0..LENGTHS)
            .map(|n| (n * longest / (LENGTHS - 1)) as u16)
            .collect();
        let mut map = Self {
            factors,
            lengths,
            slow,
            shares: Vec::new(),
            best: None,
        };
        let columns = map.lengths.len();
        map.shares = desk.try_map("capture map", map.factors.len() * columns, |cell| {
            let Ok(kick) = map.kick(cell) else {
                return Ok(0.0);
            };
            let mut locked = 0_u32;
            for part in 0..task.arguments.parts {
                locked += u32::from(captures::<Map>(task.lot.part(part as u32), task.drive, kick)?);
            }
            Ok(f64::from(locked) / task.arguments.parts as f64)
        })?;
        map.best = map.widest();
        Ok(map)
    }

    fn kick(&self, cell: usize) -> Result<Kick, kband::feeder::OutOfRange> {
        let factor = self.factors[cell / self.lengths.len()] as f32;
        let length = self.lengths[cell % self.lengths.len()];
        Kick::build(match self.slow {
            None => KickSettings {
                factor,
                hold: length,
                descent: 0,
                release: 1.0,
            },
            Some((hold, way)) => KickSettings {
                factor,
                hold,
                descent: length,
                release: (1.0 + (factor - 1.0) * way).clamp(1.0, factor),
            },
        })
    }

    /// The cell with most cells around it, as a square in steps of the map, that capture nine tenths of
    /// what the best does; beyond the edge of the map nothing is known.
    fn widest(&self) -> Option<Widest> {
        let columns = self.lengths.len();
        let rows = self.factors.len();
        let most = self.shares.iter().copied().fold(0.0, f64::max);
        if most <= 0.0 {
            return None;
        }
        let least = 0.9 * most;
        let mut best: Option<(usize, usize)> = None;
        for cell in 0..self.shares.len() {
            let (row, column) = (cell / columns, cell % columns);
            let room = row
                .min(column)
                .min(rows - 1 - row)
                .min(columns - 1 - column);
            let reach = (0..=room)
                .take_while(|reach| {
                    (row - reach..=row + reach).all(|row| {
                        (column - reach..=column + reach)
                            .all(|column| self.shares[row * columns + column] >= least)
                    })
                })
                .last();
            if let Some(reach) = reach
                && best.is_none_or(|(_, widest)| reach > widest)
            {
                best = Some((cell, reach));
            }
        }
        let (cell, reach) = best?;
        let (row, column) = (cell / columns, cell % columns);
        Some(Widest {
            kick: self.kick(cell).ok()?.settings(),
            share: self.shares[cell],
            factor_margin: (self.factors[row + reach] - self.factors[row]) / self.factors[row],
            length_margin: f64::from(self.lengths[column + reach] - self.lengths[column]),
        })
    }

    fn picture(&self, task: &Task<'_>, plan: &Plan) -> Picture {
        let span = |values: &[f64]| {
            let (first, last) = (values[0], values[values.len() - 1]);
            let half = 0.5 * (last - first) / (values.len().max(2) - 1) as f64;
            (first - half, last + half)
        };
        let lengths: Vec<f64> = self.lengths.iter().map(|length| f64::from(*length)).collect();
        let (left, right) = span(&lengths);
        let (bottom, top) = span(&self.factors);
        let words = if self.slow.is_some() { "descent of the amplitude" } else { "hold" };
        let mut panel = Panel::new(
            Axis::new(words, Unit::new("drive cycles"), left, right),
            Axis::new("factor of the amplitude", Unit::NONE, bottom, top),
        )
        .height(420.0)
        .heat(
            Grid::new(self.lengths.len(), self.shares.clone()),
            Axis::new("share of the parts captured", Unit::NONE, 0.0, 1.0),
        );
        let place = |kick: KickSettings| {
            let length = if self.slow.is_some() { kick.descent } else { kick.hold };
            (f64::from(length), f64::from(kick.factor))
        };
        let planned = plan.best().map(|best| place(best.kick.settings()));
        if let Some((x, y)) = planned.filter(|(x, y)| *x <= right && *y <= top) {
            panel = panel.markers("planned as on the board", 1, vec![(x, y)]);
        }
        if let Some(best) = self.best {
            panel = panel.markers("widest margin", 2, vec![place(best.kick)]);
        }
        let shape = match self.slow {
            None => "rectangular kicks".to_string(),
            Some((hold, way)) => format!(
                "kicks held {hold} cycles, then falling to {:.0} % of the way down",
                100.0 * (1.0 - way)
            ),
        };
        Picture::new(format!("Kicks that capture parts in lock of order {}", task.lot.order))
            .caption(format!(
                "R = {}, k = {}, amplitude within {} %, time constant {} cycles; {shape}; {} parts each",
                lot(task),
                number(task.lot.k, 4),
                task.arguments.amplitude_error,
                task.arguments.time_constant,
                task.arguments.parts
            ))
            .panel(panel)
    }
}

/// Capture rates of parts drawn at random.
struct Rates {
    /// Without a kick.
    alone: f64,
    /// After each attempt.
    by_attempt: Vec<f64>,
}

impl Rates {
    fn measure(task: &Task<'_>, plan: &Plan, desk: &Desk) -> Result<Self, Refusal> {
        let (runs, attempts) = (task.arguments.runs, task.arguments.attempts);
        let results = desk.try_map("capture runs", runs, |run| {
            let mut random = Random::new(task.arguments.seed as u64, run as u64);
            let (low, high) = (task.lot.restitution.low(), task.lot.restitution.high());
            let part = Trial {
                restitution: low + (high - low) * random.next(),
                k: task.lot.k / (1.0 + task.lot.amplitude_error * (2.0 * random.next() - 1.0)),
                order: task.lot.order,
            };
            let alone = captures::<Map>(part, task.drive, Kick::NONE)?;
            for attempt in 0..attempts {
                let drive = if attempt == 0 { task.drive } else { task.again };
                let Some(kick) = plan.attempt(attempt as u32) else {
                    break;
                };
                if captures::<Map>(part, drive, kick)? {
                    return Ok((alone, Some(attempt)));
                }
            }
            Ok((alone, None))
        })?;
        let share = |count: usize| count as f64 / runs as f64;
        Ok(Self {
            alone: share(results.iter().filter(|(alone, _)| *alone).count()),
            by_attempt: (0..attempts)
                .map(|attempt| {
                    let held = |at: &Option<usize>| at.is_some_and(|at| at <= attempt);
                    share(results.iter().filter(|(_, at)| held(at)).count())
                })
                .collect(),
        })
    }
}

/// Uniform numbers in 0..1 that depend on seed and run alone (SplitMix64).
struct Random(u64);

impl Random {
    fn new(seed: u64, run: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0xD129_0B26_68E5_4F27).wrapping_add(run));
        let begun = random.word();
        Self(begun)
    }

    fn word(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn next(&mut self) -> f64 {
        (self.word() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn lot(task: &Task<'_>) -> String {
    let (low, high) = (task.lot.restitution.low(), task.lot.restitution.high());
    if low == high {
        number(low, 6)
    } else {
        format!("{}..{}", number(low, 6), number(high, 6))
    }
}

fn spelled(kick: KickSettings) -> String {
    let mut words = format!("factor {} for {} cycles", number(kick.factor.into(), 4), kick.hold);
    if kick.descent > 0 {
        words.push_str(&format!(
            ", falling to {} within {} more",
            number(kick.release.into(), 4),
            kick.descent
        ));
    }
    words
}

fn report(task: &Task<'_>, plan: &Plan, map: &Kicks, rates: &Rates) -> Result<Report, Refusal> {
    let mut table = Table::new(&[
        Column::new("attempt", ""),
        Column::new("factor", "").digits(4),
        Column::new("hold", "cycles"),
        Column::new("descent", "cycles"),
        Column::new("release", "").digits(4),
        Column::new("captured so far", "%").digits(4),
    ]);
    table.push([
        "band alone".into(),
        1.0.into(),
        0_u32.into(),
        0_u32.into(),
        1.0.into(),
        (100.0 * rates.alone).into(),
    ]);
    let kicks: Vec<KickSettings> = (0..task.arguments.attempts)
        .filter_map(|attempt| plan.attempt(attempt as u32))
        .map(|kick| kick.settings())
        .collect();
    for (n, (kick, rate)) in kicks.iter().zip(&rates.by_attempt).enumerate() {
        table.push([
            format!("{}", n + 1).into(),
            f64::from(kick.factor).into(),
            u32::from(kick.hold).into(),
            u32::from(kick.descent).into(),
            f64::from(kick.release).into(),
            (100.0 * rate).into(),
        ]);
    }
    let mut report = Report::new(table).heading(format!(
        "R = {}, order {}, k = {:.4} in the band {:.4}..{:.4}; {} runs, seed {}",
        lot(task),
        task.lot.order,
        task.lot.k,
        task.band.low(),
        task.band.high(),
        task.arguments.runs,
        task.arguments.seed
    ));
    report = match plan.best() {
        Some(best) => report.note(format!(
            "best planned kick: {}; it captured {} of {} parts",
            spelled(best.kick.settings()),
            best.locked,
            best.tried
        )),
        None => report.note(
            "no kick of the plan captured a part: raise --limit or --effort, or choose another k",
        ),
    };
    report = report.note(format!(
        "the plan took {} impacts and {} set-ups of the map ({} of {} of effort), {} kicks tried",
        plan.impacts,
        plan.set_ups,
        plan.effort(),
        task.arguments.effort,
        plan.kicks
    ));
    if let Some(best) = map.best.filter(|best| best.length_margin > 0.0) {
        report = report.note(format!(
            "widest patch of the map: {}; {:.0} % of the parts, and hardly fewer with the factor +-{:.1} % and \
             the length +-{:.0} cycles",
            spelled(best.kick),
            100.0 * best.share,
            100.0 * best.factor_margin,
            best.length_margin
        ));
    }
    let kick = |kick: KickSettings| {
        serde_json::json!({
            "factor": kick.factor,
            "hold": kick.hold,
            "descent": kick.descent,
            "release": kick.release,
        })
    };
    report.json(&serde_json::json!({
        "restitution": [task.lot.restitution.low(), task.lot.restitution.high()],
        "order": task.lot.order,
        "k": task.lot.k,
        "band": [task.band.low(), task.band.high()],
        "best": plan.best().map(|best: Scored| serde_json::json!({
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
        "widest": map.best.map(|best| serde_json::json!({
            "kick": kick(best.kick),
            "share": best.share,
            "factor_margin": best.factor_margin,
            "length_margin": best.length_margin,
        })),
        "runs": task.arguments.runs,
        "seed": task.arguments.seed,
        "captured_alone": rates.alone,
        "captured": rates.by_attempt,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_widest_patch_is_found_and_its_margin_stays_inside() {
        let mut map = Kicks {
            factors: (0..20).map(|n| 1.0 + 0.05 * f64::from(n)).collect(),
            lengths: (0..20).map(|n| 3 * n).collect(),
            slow: None,
            shares: vec![0.5; 400],
            best: None,
        };
        for row in 4..=10 {
            for column in 8..=14 {
                map.shares[row * 20 + column] = 1.0;
            }
        }
        map.shares[17 * 20 + 2] = 1.0;
        let best = map.widest().unwrap();
        assert_eq!((best.kick.hold, best.share), (33, 1.0));
        assert!((f64::from(best.kick.factor) - 1.35).abs() < 1e-6);
        assert_eq!(best.length_margin, 9.0);
        assert!((best.factor_margin - 0.15 / 1.35).abs() < 1e-9);
        map.shares.fill(0.0);
        assert_eq!(map.widest(), None);
    }

    #[test]
    fn random_numbers_are_even_and_differ_between_runs() {
        let mean = (0..1000)
            .map(|run| Random::new(1, run).next())
            .sum::<f64>()
            / 1000.0;
        // Standard error 0.29 / sqrt(1000) = 0.009.
        assert!((mean - 0.5).abs() < 0.04, "{mean}");
        assert_ne!(Random::new(1, 2).next(), Random::new(2, 1).next());
    }
}
