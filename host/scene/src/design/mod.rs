//! Feeder design: parts a minute against share in gear, with the drive of a scene. A [table] gives
//! share and speed of every candidate, and random search with narrowing rounds finds the Pareto
//! front. The front is simulated anew; its best are run in the closed loop.

mod feeder;
mod search;
mod table;
mod verdict;

use kband::regime::band;
use kband_control::{Settings, Target};

use crate::parts::restitutions;
use crate::refusal::Refusal;
use crate::scene::SceneFile;
pub use feeder::Feeder;
use table::{Axis, Lot, Table};
pub use verdict::{Conveyed, Sensitivity};
use verdict::{Trial, closed};

/// Called during the work; a refusal ends the work.
pub type CheckStop<'a> = &'a dyn Fn() -> Result<(), Refusal>;

/// Threads that execute numbered tasks.
pub trait Workers {
    /// Results of `work` for each of `0..count`, in order; each may depend only on its number.
    fn map<T: Send + Sync>(
        &self,
        title: &str,
        count: usize,
        work: impl Fn(usize, CheckStop<'_>) -> Result<T, Refusal> + Sync + Send,
    ) -> Result<Vec<T>, Refusal>;
}

/// Settings of a search: the lowest and highest value of each quantity, and its effort.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ranges {
    /// Drive frequency in Hz, 5..=500.
    pub frequency: [f64; 2],
    /// Amplitude normal to the track (symbol b) in mm, 0..=100.
    pub amplitude: [f64; 2],
    /// Angle between track and motion in degrees, 5..=90.
    pub throw_angle: [f64; 2],
    /// Phase lead of the motion along the track in degrees, -180..=180.
    pub phase_lead: [f64; 2],
    /// Incline in degrees, -60..=60.
    pub incline: [f64; 2],
    /// Largest second and third tone over the first, 0..=0.5; 0: none.
    pub tones: [f64; 2],
    /// Number of candidates, 1000..=100 million.
    pub candidates: usize,
    /// Smallest share in gear on the front, 0..=1.
    pub least_share: f64,
    /// Number of feeders of the front that are run in the closed loop, 1..=100.
    pub checked: usize,
    /// Seed of candidates and scatter.
    pub seed: u64,
}

/// A feeder of the front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Designed {
    /// The feeder.
    pub feeder: Feeder,
    /// Share and speed by simulated parts.
    pub simulated: Conveyed,
    /// Derivatives of share and speed.
    pub sensitivity: Sensitivity,
    /// Share and speed in the closed loop; `None` if the drive did not run.
    pub closed: Option<Conveyed>,
}

/// Deviation of the table from simulated parts, over the table's front.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TableError {
    /// Root mean square of the share's deviation.
    pub share_rms: f64,
    /// Largest deviation of the share.
    pub share_max: f64,
    /// Root mean square of the speed's relative deviation.
    pub speed_rms: f64,
    /// Largest relative deviation of the speed.
    pub speed_max: f64,
}

/// Result of a search.
#[derive(Clone, Debug, PartialEq)]
pub struct Design {
    /// Number of candidates.
    pub tried: usize,
    /// Number of candidates within the limits of the drive.
    pub within: usize,
    /// The scene's own feeder with its own target; `None` if it does not run.
    pub today: Option<Designed>,
    /// Front by simulated parts, by falling speed.
    pub front: Vec<(Feeder, Conveyed)>,
    /// Feeders of the front with their closed-loop runs, by falling speed.
    pub best: Vec<Designed>,
    /// Deviation of the table.
    pub error: TableError,
    /// Constraints that the best feeders reach: limits of the drive and ends of the ranges.
    pub held_by: Vec<String>,
}

/// Smallest share in gear at which the board reports READY (docs/theory-real-parts.md#t10.7).
const MIN_SHARE_IN_GEAR: f64 = 0.65;
/// Default range of the angle of throw, degrees.
const THROW_ANGLES: [f64; 2] = [20.0, 45.0];
/// Smallest k of the table; no lot has its best k below.
const MIN_TABLE_K: f64 = 0.2;
/// Angles of the second tone in rad, about the best ones for order 1.
const SECOND_TONE_ANGLES: [f64; 2] = [1.9, 3.1];
const OF_FIRST: &str = "of the first";
/// Number of simulated restitutions of a lot that is an interval.
const LOT_PARTS: usize = 5;

impl Ranges {
    /// Half to twice the scene's frequency, every amplitude, its tones, incline and phase lead.
    pub fn from_scene(file: &SceneFile) -> Self {
        let settings = &file.scene.settings;
        let [frequency, lead, incline] =
            [settings.frequency, settings.phase_lead, settings.incline].map(f64::from);
        Self {
            frequency: [0.5, 2.0].map(|part| (part * frequency).clamp(5.0, 500.0)),
            amplitude: [0.0, 100.0],
            throw_angle: THROW_ANGLES,
            phase_lead: [lead; 2],
            incline: [incline; 2],
            tones: [settings.second_tone, settings.third_tone].map(f64::from),
            candidates: 1_000_000,
            least_share: MIN_SHARE_IN_GEAR,
            checked: 10,
            seed: file.scene.seed,
        }
    }

    /// Refuses a value out of range, with the range.
    pub fn check(&self) -> Result<(), Refusal> {
        let intervals = [
            ("frequency", self.frequency, [5.0, 500.0], "Hz"),
            ("amplitude", self.amplitude, [0.0, 100.0], "mm"),
            ("throw angle", self.throw_angle, [5.0, 90.0], "degrees"),
            ("phase lead", self.phase_lead, [-180.0, 180.0], "degrees"),
            ("incline", self.incline, [-60.0, 60.0], "degrees"),
            ("second and third tone", self.tones, [0.0, 0.5], OF_FIRST),
        ];
        for (name, [low, high], [min, max], unit) in intervals {
            let within = |value: f64| (min..=max).contains(&value);
            let is_ordered = low <= high || name.contains("tone");
            if !within(low) || !within(high) || !is_ordered {
                let value = format!("{low}..{high}");
                let accepted = format!("{min}..{max} {unit}, the lower end first");
                let next = format!("give a {name} in this range");
                return Err(Refusal::value(name, value, accepted, next));
            }
        }
        for (name, value, [min, max]) in [
            ("candidates", self.candidates as f64, [1e3, 1e8]),
            ("least share", self.least_share, [0.0, 1.0]),
            ("checked", self.checked as f64, [1.0, 100.0]),
        ] {
            if !(min..=max).contains(&value) {
                let accepted = format!("{min}..{max}");
                return Err(Refusal::value(name, value, accepted, "give another number"));
            }
        }
        if self.tones[1] > 0.0 && self.tones[0] == 0.0 {
            let accepted = "0 without a second tone";
            let next = "allow a second tone too";
            return Err(Refusal::value("third tone", self.tones[1], accepted, next));
        }
        Ok(())
    }
}

impl Design {
    /// Searches for feeders with the drive of a scene. Refused: invalid ranges, an order other than
    /// 1, and if no candidate within the drive's limits has the least share.
    pub fn search(
        file: &SceneFile,
        ranges: &Ranges,
        workers: &impl Workers,
    ) -> Result<Self, Refusal> {
        ranges.check()?;
        if let Target::Gear { order } | Target::Locked { order } = file.scene.target
            && order != 1
        {
            let accepted = "1: one flight in every drive cycle";
            let next = "set gear = 1 in [target]";
            return Err(Refusal::value("order of the target", order, accepted, next));
        }
        let settings = &file.scene.settings;
        let lot = Lot {
            restitutions: restitutions(settings.lot()?, LOT_PARTS),
            scatter: settings.scatter.into(),
            seed: ranges.seed,
        };
        let trial = Trial { file, lot };
        let today = today(&trial, workers)?;
        let table = Table::compute(&file.scene, &trial.lot, axes(settings, ranges)?, workers)?;
        let result = search::search(settings, ranges, &table, workers)?;
        if result.front.is_empty() {
            return Err(refuse_empty(&result, ranges));
        }
        let feeders: Vec<Feeder> = result.front.iter().map(|best| best.feeder).collect();
        let simulated = trial.front(&feeders, workers)?;
        let error = error(result.front.iter().zip(&simulated));
        let front = search::pareto_front(&simulated, |run| (run.share, run.speed)).into_iter();
        let front = front.map(|n| (feeders[n], simulated[n]));
        let front: Vec<(Feeder, Conveyed)> = front.collect();
        let chosen = spread(front.len(), ranges.checked).map(|n| front[n].0);
        let chosen: Vec<Feeder> = chosen.collect();
        let judged = trial.judge(&chosen, workers)?;
        // The new simulation may show that another feeder is better.
        let undominated = search::pareto_front(&judged, |(run, _)| (run.share, run.speed));
        let chosen: Vec<Feeder> = undominated.iter().map(|n| chosen[*n]).collect();
        let judged = undominated.iter().map(|n| judged[*n]);
        let runs = workers.map("closed loop", chosen.len(), |n, check_stop| {
            let outcome = trial.close(Some(&chosen[n]), check_stop)?;
            Ok(closed(&outcome))
        })?;
        let all = chosen.iter().zip(judged).zip(runs);
        let best = all.map(|((feeder, (simulated, sensitivity)), closed)| Designed {
            feeder: *feeder,
            simulated,
            sensitivity,
            closed,
        });
        Ok(Self {
            tried: result.tried,
            within: result.within,
            today,
            front,
            best: best.collect(),
            error,
            held_by: held_by(settings, ranges, &chosen),
        })
    }

    /// Fastest feeder in the closed loop with a simulated share of at least that of the scene's own
    /// feeder, less 0.01. `None` if none has it.
    pub fn better(&self) -> Option<&Designed> {
        let share = self.today?.simulated.share - 0.01;
        let speed = |row: &&Designed| row.closed.map_or(0.0, |closed| closed.speed);
        let best = self.best.iter().filter(|row| row.simulated.share >= share);
        best.max_by(|a, b| speed(a).total_cmp(&speed(b)))
    }
}

/// Up to `max_count` of the numbers `0..count`, including both ends.
fn spread(count: usize, max_count: usize) -> impl Iterator<Item = usize> {
    let points = max_count.min(count);
    (0..points).map(move |n| n * (count - 1) / (points - 1).max(1))
}

/// The scene's own feeder at its controller's amplitude, with share and speed of parts there.
fn today(trial: &Trial<'_>, workers: &impl Workers) -> Result<Option<Designed>, Refusal> {
    let close = |_, check_stop: CheckStop<'_>| trial.close(None, check_stop);
    let outcome = workers.map("closed loop", 1, close)?;
    let Some((outcome, run)) = outcome.first().and_then(|run| Some((run, closed(run)?))) else {
        return Ok(None);
    };
    let tones = outcome.last().shape.numbers();
    let feeder = Feeder::from_settings(&trial.file.scene.settings, outcome.k(), tones);
    let judged = trial.judge(&[feeder], workers)?;
    Ok(judged.first().map(|(simulated, sensitivity)| Designed {
        feeder,
        simulated: *simulated,
        sensitivity: *sensitivity,
        closed: Some(run),
    }))
}

/// A coordinate of a feeder: name, range, value, unit.
type Coordinate = (&'static str, [f64; 2], fn(&Feeder) -> f64, &'static str);

/// Limits of the drive and ends of the ranges that more than half of the feeders reach.
fn held_by(settings: &Settings, ranges: &Ranges, feeders: &[Feeder]) -> Vec<String> {
    let majority = |reached: &dyn Fn(&Feeder) -> bool| {
        2 * feeders.iter().filter(|f| reached(f)).count() > feeders.len()
    };
    let limits = ["stroke", "acceleration", "force"].into_iter();
    let limits = limits.filter(|n| majority(&|f| feeder::limit_reached(settings, f) == Some(n)));
    let mut all: Vec<String> = limits.map(|name| format!("the drive's {name}")).collect();
    let ([second, _], throw) = (ranges.tones, ranges.throw_angle);
    let coordinates: [Coordinate; 5] = [
        ("frequency", ranges.frequency, |f| f.frequency, "Hz"),
        ("angle of throw", throw, |f| f.throw_angle, "degrees"),
        ("phase lead", ranges.phase_lead, |f| f.phase_lead, "degrees"),
        ("incline", ranges.incline, |f| f.incline, "degrees"),
        ("second tone", [0.0, second], |f| f.tones[0][0], OF_FIRST),
    ];
    for (name, [low, high], value, unit) in coordinates {
        for (end, other) in [(low, high), (high, low)] {
            let near = |feeder: &Feeder| (value(feeder) - end).abs() <= 0.02 * (high - low);
            if end != other && majority(&near) {
                all.push(format!("{name} {end} {unit}"));
            }
        }
    }
    all
}

/// Axes of the table. With friction the speed is not linear in eta.
fn axes(settings: &Settings, ranges: &Ranges) -> Result<table::Axes, Refusal> {
    let birth = band::birth(f64::from(settings.restitution_high).min(0.99), 1)?;
    let highest = (1.02 * birth).min(0.98);
    let ratio = |angle: f64| angle.to_radians().tan().recip().max(0.0);
    let [shallow, steep] = ranges.throw_angle;
    let [second, third] = ranges.tones;
    let angles = SECOND_TONE_ANGLES.map(|angle| if second > 0.0 { angle } else { 0.0 });
    Ok([
        Axis::new([MIN_TABLE_K, highest], if second > 0.0 { 31 } else { 41 }),
        Axis::new([0.0, second], 5),
        Axis::new(angles, 5),
        Axis::new([0.0, third], 3),
        Axis::new([ratio(steep), ratio(shallow)], 5),
        Axis::new(ranges.phase_lead, 5),
        Axis::new(ranges.incline.map(|angle| angle.to_radians().tan()), 2),
    ])
}

fn refuse_empty(result: &search::SearchResult, ranges: &Ranges) -> Refusal {
    let (tried, within, share) = (result.tried, result.within, ranges.least_share);
    if within == 0 {
        let cause = format!("none of {tried} feeders of these ranges is within the limits");
        let next = "allow other frequencies, or raise gain, amplitude_limit or acceleration_limit";
        return Refusal::new(
            format!("{cause} of the drive"),
            format!("{next} in [drive]"),
        );
    }
    let cause = format!("none of {within} feeders within the limits of the drive");
    let cause = format!("{cause} has a share in gear of {share}");
    let next =
        "allow a second tone (drive.second_tone in the scene), less scatter, or a smaller share";
    Refusal::new(cause, next)
}

fn error<'a>(points: impl Iterator<Item = (&'a search::Candidate, &'a Conveyed)>) -> TableError {
    let (mut error, mut count) = (TableError::default(), 0.0);
    for (table, run) in points {
        let (share, speed) = (table.share - run.share, table.speed / run.speed - 1.0);
        error.share_rms += share * share;
        error.speed_rms += speed * speed;
        error.share_max = error.share_max.max(share.abs());
        error.speed_max = error.speed_max.max(speed.abs());
        count += 1.0;
    }
    error.share_rms = (error.share_rms / f64::max(count, 1.0)).sqrt();
    error.speed_rms = (error.speed_rms / f64::max(count, 1.0)).sqrt();
    error
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::DEFAULT;

    struct InOrder;

    impl Workers for InOrder {
        fn map<T: Send + Sync>(
            &self,
            _: &str,
            count: usize,
            work: impl Fn(usize, CheckStop<'_>) -> Result<T, Refusal> + Sync + Send,
        ) -> Result<Vec<T>, Refusal> {
            (0..count).map(|n| work(n, &|| Ok(()))).collect()
        }
    }

    fn default_scene() -> SceneFile {
        SceneFile::parse(DEFAULT).unwrap()
    }

    #[test]
    fn the_front_beats_todays_feeder_and_holds_in_the_closed_loop() {
        let file = default_scene();
        let ranges = Ranges {
            candidates: 20_000,
            checked: 3,
            ..Ranges::from_scene(&file)
        };
        let result = Design::search(&file, &ranges, &InOrder).unwrap();
        assert!((1001..result.tried).contains(&result.within), "{result:?}");
        let pairs = result.front.windows(2);
        for (above, below) in pairs.map(|pair| (pair[0].1, pair[1].1)) {
            assert!(above.speed > below.speed && above.share < below.share);
        }
        assert!((1..=3).contains(&result.best.len()), "{result:?}");
        for best in &result.best {
            let closed = best.closed.unwrap();
            let simulated = best.simulated;
            assert!((closed.share - simulated.share).abs() < 0.06, "{best:?}");
            let deviation = (closed.speed / simulated.speed - 1.0).abs();
            assert!(deviation < 0.06, "{best:?}");
            // The drive reaches the amplitude.
            let settings = feeder::settings_of(&file.scene.settings, &best.feeder);
            assert!(best.feeder.amplitude(9.80665) <= f64::from(settings.amplitude_limit));
        }
        // A stroke of 1 mm allows about half the frequency, at which parts move twice as far.
        let (today, better) = (result.today.unwrap(), result.better().unwrap());
        let gain = better.closed.unwrap().speed / today.closed.unwrap().speed;
        assert!((1.4..3.0).contains(&gain), "{gain} {better:?}");
        assert!(better.feeder.frequency < 40.0, "{better:?}");
        let held = result.held_by.join(", ");
        for expected in ["stroke", "throw 20"] {
            assert!(held.contains(expected), "{held}");
        }
    }

    #[test]
    fn ranges_and_orders_out_of_range_are_refused() {
        let file = default_scene();
        let base = Ranges::from_scene(&file);
        type Change = fn(&mut Ranges);
        let cases: [(Change, &str); 9] = [
            (|ranges| ranges.frequency = [60.0, 50.0], "5..500"),
            (|ranges| ranges.throw_angle = [0.0, 30.0], "5..90"),
            (|ranges| ranges.incline = [f64::NAN; 2], "-60..60"),
            (|ranges| ranges.tones = [0.0, 0.1], "0 without"),
            (|ranges| ranges.candidates = 10, "1000.."),
            (|ranges| ranges.checked = 101, "1..100"),
            (|ranges| ranges.least_share = 1.5, "0..1"),
            // 10 mm exceed the stroke, and from 25 Hz on also 120 m/s^2.
            (|ranges| ranges.amplitude = [10.0, 20.0], "of the drive"),
            (|ranges| ranges.least_share = 1.0, "share in gear of 1"),
        ];
        for (change, expected) in cases {
            let mut ranges = base;
            ranges.candidates = 1000;
            change(&mut ranges);
            let refused = Design::search(&file, &ranges, &InOrder).unwrap_err();
            assert!(refused.to_string().contains(expected), "{refused}");
        }
        let second = DEFAULT.replace("gear = 1 ", "gear = 2 ");
        let second = SceneFile::parse(&second).unwrap();
        let refused = Design::search(&second, &Ranges::from_scene(&second), &InOrder);
        let refused = refused.unwrap_err().to_string();
        assert!(refused.contains("order of the target"), "{refused}");
    }
}
