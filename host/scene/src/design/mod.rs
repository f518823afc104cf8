//! Feeder design: parts a minute against share in gear, with the drive of a scene.
//!
//! A candidate is a frequency, an angle of throw, an incline, an amplitude and tones. The share in
//! gear depends on k and the tones alone (docs/theory-real-parts.md#t10.1). A [table] of
//! simulated parts gives share and speed of every candidate, and random search with narrowing
//! rounds finds the Pareto front. The front is simulated anew; its best are run in the closed loop.

mod feeder;
mod search;
mod table;
mod verdict;

use kband::regime::band;
use kband_control::{Settings, Target};

use crate::refusal::Refusal;
use crate::scene::SceneFile;
pub use feeder::Feeder;
use table::{Axis, Lot, Table};
use verdict::{AS_IT_IS, FRONT_RUNS, close, closed, judge, simulate};
pub use verdict::{Conveyed, Sensitivity};

/// Asks whether to go on; refuses where the work is to end.
pub type Ask<'a> = &'a dyn Fn() -> Result<(), Refusal>;

/// Threads that work on numbered tasks.
pub trait Workers {
    /// `work` on each of `0..count`, results in order, or the first refusal in order. Each result
    /// depends on its number alone.
    fn map<T: Send + Sync>(
        &self,
        title: &str,
        count: usize,
        work: impl Fn(usize, Ask<'_>) -> Result<T, Refusal> + Sync + Send,
    ) -> Result<Vec<T>, Refusal>;
}

/// What is searched: the lowest and highest value of each quantity, and how.
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
    /// Smallest share in gear of the front, 0..=1.
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
    /// Their derivatives.
    pub sensitivity: Sensitivity,
    /// Share and speed in the closed loop; `None` where the drive did not run.
    pub closed: Option<Conveyed>,
}

/// Deviation of the table from simulated parts, over the front that the table has.
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

/// What a search found.
#[derive(Clone, Debug, PartialEq)]
pub struct Design {
    /// Candidates that were tried.
    pub tried: usize,
    /// Those within the limits of the drive.
    pub within: usize,
    /// The scene's own feeder with its own target; `None` where it does not run.
    pub today: Option<Designed>,
    /// The front by simulated parts, by falling speed.
    pub front: Vec<(Feeder, Conveyed)>,
    /// Feeders of the front with their runs in the closed loop, by falling speed.
    pub best: Vec<Designed>,
    /// Deviation of the table.
    pub error: TableError,
    /// What holds the best feeders: limits of the drive, and ends of the ranges.
    pub held_by: Vec<String>,
}

/// Smallest share in gear that the board reports READY at (docs/theory-real-parts.md#t10.7).
const LEAST_SHARE: f64 = 0.65;
/// Angles of throw of feeders in degrees, for a search without a range.
const THROW_ANGLES: [f64; 2] = [20.0, 45.0];
/// Lowest k of the table. Below it no lot has its best k.
const LOWEST_K: f64 = 0.2;
/// Angles of the second tone in rad, about those that are best for order 1.
const SECOND_TONE_ANGLES: [f64; 2] = [1.9, 3.1];
/// Parts of a lot that is no single restitution.
const PARTS: usize = 5;

impl Ranges {
    /// What the drive of a scene allows: half to twice its frequency, every amplitude, its tones,
    /// and its own incline and phase lead.
    pub fn of(file: &SceneFile) -> Self {
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
            least_share: LEAST_SHARE,
            checked: 10,
            seed: file.scene.seed,
        }
    }

    /// Refuses a value out of range.
    ///
    /// # Errors
    /// A `Refusal` that names the range.
    pub fn check(&self) -> Result<(), Refusal> {
        let intervals = [
            ("frequency", self.frequency, [5.0, 500.0], "Hz"),
            ("amplitude", self.amplitude, [0.0, 100.0], "mm"),
            ("throw angle", self.throw_angle, [5.0, 90.0], "degrees"),
            ("phase lead", self.phase_lead, [-180.0, 180.0], "degrees"),
            ("incline", self.incline, [-60.0, 60.0], "degrees"),
            (
                "second and third tone",
                self.tones,
                [0.0, 0.5],
                "of the first",
            ),
        ];
        for (name, [low, high], [least, most], unit) in intervals {
            let within = |value: f64| (least..=most).contains(&value);
            let is_ordered = low <= high || name.contains("tone");
            if !within(low) || !within(high) || !is_ordered {
                return Err(Refusal::value(
                    name,
                    format!("{low}..{high}"),
                    format!("{least}..{most} {unit}, the lower end first"),
                    format!("give a {name} in this range"),
                ));
            }
        }
        for (name, value, [least, most]) in [
            ("candidates", self.candidates as f64, [1e3, 1e8]),
            ("least share", self.least_share, [0.0, 1.0]),
            ("checked", self.checked as f64, [1.0, 100.0]),
        ] {
            if !(least..=most).contains(&value) {
                let accepted = format!("{least}..{most}");
                return Err(Refusal::value(name, value, accepted, "give another number"));
            }
        }
        if self.tones[1] > 0.0 && self.tones[0] == 0.0 {
            return Err(Refusal::value(
                "third tone",
                self.tones[1],
                "0 without a second tone",
                "allow a second tone too",
            ));
        }
        Ok(())
    }
}

/// The lot of a scene: as many restitutions over its interval as are simulated.
fn lot(settings: &Settings, scatter: f64, seed: u64) -> Lot {
    let (low, high) = (
        f64::from(settings.restitution_low),
        f64::from(settings.restitution_high),
    );
    let last = (PARTS - 1) as f64;
    let restitutions = if low == high {
        vec![low]
    } else {
        let part = |n: usize| low + (high - low) * n as f64 / last;
        (0..PARTS).map(part).collect()
    };
    Lot {
        restitutions,
        scatter,
        seed,
    }
}

impl Design {
    /// Searches feeders with the drive of a scene.
    ///
    /// # Errors
    /// A `Refusal` for ranges out of range, for a scene with another order than 1, where no
    /// candidate is within the drive's limits or has the least share, and that of `workers`.
    pub fn search(
        file: &SceneFile,
        ranges: &Ranges,
        workers: &impl Workers,
    ) -> Result<Self, Refusal> {
        ranges.check()?;
        if let Target::Gear { order } | Target::Locked { order } = file.scene.target
            && order != 1
        {
            return Err(Refusal::value(
                "order of the target",
                order,
                "1: one flight in every drive cycle",
                "set gear = 1 in [target]",
            ));
        }
        let settings = &file.scene.settings;
        let lot = lot(settings, settings.scatter.into(), ranges.seed);
        let today = today(file, &lot, workers)?;
        let table = Table::compute(&file.scene, &lot, axes(settings, ranges)?, workers)?;
        let found = search::search(settings, ranges, &table, workers)?;
        if found.front.is_empty() {
            return Err(none_found(&found, ranges));
        }
        let feeders: Vec<Feeder> = found.front.iter().map(|of| of.feeder).collect();
        let simulated = simulate(file, &lot, &feeders, &[AS_IT_IS], FRONT_RUNS, workers)?;
        let deviations = found.front.iter().zip(&simulated);
        let error = error(
            deviations.map(|(table, of)| [table.share - of.share, table.speed / of.speed - 1.0]),
        );
        let front: Vec<(Feeder, Conveyed)> =
            search::not_beaten(&simulated, |of| (of.share, of.speed))
                .into_iter()
                .map(|n| (feeders[n], simulated[n]))
                .collect();
        let chosen: Vec<Feeder> = spread(front.len(), ranges.checked)
            .map(|n| front[n].0)
            .collect();
        let judged = judge(file, &lot, &chosen, workers)?;
        // Fresh runs may show that one of them is beaten.
        let kept = search::not_beaten(&judged, |(of, _)| (of.share, of.speed));
        let chosen: Vec<Feeder> = kept.iter().map(|n| chosen[*n]).collect();
        let judged = kept.iter().map(|n| judged[*n]);
        let runs = workers.map("closed loop", chosen.len(), |n, go_on| {
            close(file, &lot, Some(&chosen[n]), go_on).map(|outcome| closed(&outcome))
        })?;
        let all = chosen.iter().zip(judged).zip(runs);
        let best = all.map(|((feeder, (simulated, sensitivity)), closed)| Designed {
            feeder: *feeder,
            simulated,
            sensitivity,
            closed,
        });
        Ok(Self {
            tried: found.tried,
            within: found.within,
            today,
            front,
            best: best.collect(),
            error,
            held_by: held_by(settings, ranges, &chosen),
        })
    }

    /// The fastest feeder in the closed loop whose simulated share is at least that of the scene's
    /// own, less 0.01; `None` where there is none.
    pub fn better(&self) -> Option<&Designed> {
        let share = self.today?.simulated.share - 0.01;
        let speed = |of: &&Designed| of.closed.map_or(0.0, |closed| closed.speed);
        let best = self.best.iter().filter(|of| of.simulated.share >= share);
        best.max_by(|a, b| speed(a).total_cmp(&speed(b)))
    }
}

/// Up to `wanted` of `0..count`, the ends among them.
fn spread(count: usize, wanted: usize) -> impl Iterator<Item = usize> {
    let shown = wanted.min(count);
    (0..shown).map(move |n| n * (count - 1) / (shown - 1).max(1))
}

/// The scene's own feeder: where its controller holds it, and what parts do there.
fn today(file: &SceneFile, lot: &Lot, workers: &impl Workers) -> Result<Option<Designed>, Refusal> {
    let outcome = workers.map("closed loop", 1, |_, go_on| close(file, lot, None, go_on))?;
    let Some((outcome, run)) = outcome.first().and_then(|of| Some((of, closed(of)?))) else {
        return Ok(None);
    };
    let tones = outcome.last().shape.numbers();
    let feeder = Feeder::of(&file.scene.settings, outcome.k(), tones);
    let judged = judge(file, lot, &[feeder], workers)?;
    Ok(judged.first().map(|(simulated, sensitivity)| Designed {
        feeder,
        simulated: *simulated,
        sensitivity: *sensitivity,
        closed: Some(run),
    }))
}

/// A quantity of a feeder: its name, its range, its value, its unit.
type Coordinate = (&'static str, [f64; 2], fn(&Feeder) -> f64, &'static str);

/// Limits of the drive and ends of the ranges that more than half of the feeders reach.
fn held_by(settings: &Settings, ranges: &Ranges, feeders: &[Feeder]) -> Vec<String> {
    let most = |reached: &dyn Fn(&Feeder) -> bool| {
        2 * feeders.iter().filter(|of| reached(of)).count() > feeders.len()
    };
    let limits = ["stroke", "acceleration", "force"].into_iter();
    let mut all: Vec<String> = limits
        .filter(|name| most(&|of| feeder::limit_reached(settings, of) == Some(name)))
        .map(|name| format!("the drive's {name}"))
        .collect();
    let coordinates: [Coordinate; 5] = [
        ("frequency", ranges.frequency, |of| of.frequency, "Hz"),
        (
            "angle of throw",
            ranges.throw_angle,
            |of| of.throw_angle,
            "degrees",
        ),
        (
            "phase lead",
            ranges.phase_lead,
            |of| of.phase_lead,
            "degrees",
        ),
        ("incline", ranges.incline, |of| of.incline, "degrees"),
        (
            "second tone",
            [0.0, ranges.tones[0]],
            |of| of.tones[0][0],
            "of the first",
        ),
    ];
    for (name, [low, high], of, unit) in coordinates {
        for (end, other) in [(low, high), (high, low)] {
            let near = |feeder: &Feeder| (of(feeder) - end).abs() <= 0.02 * (high - low);
            if end != other && most(&near) {
                all.push(format!("{name} {end} {unit}"));
            }
        }
    }
    all
}

/// The axes of the table for these ranges. With restitution along the track the speed is linear in
/// eta; with friction it is not.
fn axes(settings: &Settings, ranges: &Ranges) -> Result<table::Axes, Refusal> {
    let born = band::birth(f64::from(settings.restitution_high).min(0.99), 1)?;
    let highest = (1.02 * born).min(0.98);
    let ratio = |angle: f64| angle.to_radians().tan().recip().max(0.0);
    let [shallow, steep] = ranges.throw_angle;
    let [second, third] = ranges.tones;
    let angles = if second > 0.0 {
        SECOND_TONE_ANGLES
    } else {
        [0.0; 2]
    };
    Ok([
        Axis::new([LOWEST_K, highest], if second > 0.0 { 31 } else { 41 }),
        Axis::new([0.0, second], 5),
        Axis::new(angles, 5),
        Axis::new([0.0, third], 3),
        Axis::new([ratio(steep), ratio(shallow)], 5),
        Axis::new(ranges.phase_lead, 5),
        Axis::new(ranges.incline.map(|angle| angle.to_radians().tan()), 2),
    ])
}

fn none_found(found: &search::Found, ranges: &Ranges) -> Refusal {
    if found.within == 0 {
        return Refusal::new(
            format!(
                "none of {} feeders of these ranges is within the limits of the drive",
                found.tried
            ),
            "allow other frequencies, or raise gain, amplitude_limit or acceleration_limit in [drive]",
        );
    }
    Refusal::new(
        format!(
            "none of {} feeders within the limits of the drive has a share in gear of {}",
            found.within, ranges.least_share
        ),
        "allow a second tone (drive.second_tone in the scene), less scatter, or a smaller share",
    )
}

fn error(deviations: impl Iterator<Item = [f64; 2]>) -> TableError {
    let (mut error, mut count) = (TableError::default(), 0.0);
    for [share, speed] in deviations {
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

    /// Works on so many threads in turn of the numbers.
    struct Threads(usize);

    impl Workers for Threads {
        fn map<T: Send + Sync>(
            &self,
            _: &str,
            count: usize,
            work: impl Fn(usize, Ask<'_>) -> Result<T, Refusal> + Sync + Send,
        ) -> Result<Vec<T>, Refusal> {
            let mut all: Vec<Option<Result<T, Refusal>>> = (0..count).map(|_| None).collect();
            let together = count.div_ceil(self.0).max(1);
            std::thread::scope(|scope| {
                for (chunk, places) in all.chunks_mut(together).enumerate() {
                    let work = &work;
                    scope.spawn(move || {
                        for (n, place) in places.iter_mut().enumerate() {
                            *place = Some(work(chunk * together + n, &|| Ok(())));
                        }
                    });
                }
            });
            all.into_iter().flatten().collect()
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
            ..Ranges::of(&file)
        };
        let found = Design::search(&file, &ranges, &Threads(3)).unwrap();
        assert_eq!(found, Design::search(&file, &ranges, &Threads(1)).unwrap());
        assert!(
            found.within > 1000 && found.within < found.tried,
            "{found:?}"
        );
        let pairs = found.front.windows(2);
        for (above, below) in pairs.map(|pair| (pair[0].1, pair[1].1)) {
            assert!(above.speed > below.speed && above.share < below.share);
        }
        assert!((1..=3).contains(&found.best.len()), "{found:?}");
        for best in &found.best {
            let closed = best.closed.unwrap();
            let simulated = best.simulated;
            assert!((closed.share - simulated.share).abs() < 0.06, "{best:?}");
            assert!(
                (closed.speed / simulated.speed - 1.0).abs() < 0.06,
                "{best:?}"
            );
            // Its amplitude is one that the drive makes.
            let settings = feeder::settings_of(&file.scene.settings, &best.feeder);
            assert!(best.feeder.amplitude(9.80665) <= f64::from(settings.amplitude_limit));
        }
        // A stroke of 1 mm allows about half the frequency, at which parts move twice as far.
        let (today, better) = (found.today.unwrap(), found.better().unwrap());
        let gain = better.closed.unwrap().speed / today.closed.unwrap().speed;
        assert!((1.4..3.0).contains(&gain), "{gain} {better:?}");
        assert!(better.feeder.frequency < 40.0, "{better:?}");
        let held = found.held_by.join(", ");
        assert!(
            held.contains("stroke") && held.contains("throw 20"),
            "{held}"
        );
    }

    #[test]
    fn ranges_and_orders_out_of_range_are_refused() {
        let file = default_scene();
        let of = Ranges::of(&file);
        type Change = fn(&mut Ranges);
        let cases: [(Change, &str); 8] = [
            (|of| of.frequency = [60.0, 50.0], "5..500"),
            (|of| of.throw_angle = [0.0, 30.0], "5..90"),
            (|of| of.incline = [f64::NAN; 2], "-60..60"),
            (|of| of.tones = [0.0, 0.1], "0 without"),
            (|of| of.candidates = 10, "1000.."),
            (|of| of.least_share = 1.5, "0..1"),
            // At 500 Hz no k below 1 is within 120 m/s^2 and beyond 10 mm.
            (|of| of.amplitude = [10.0, 20.0], "limits of the drive"),
            (|of| of.least_share = 1.0, "share in gear of 1"),
        ];
        for (change, expected) in cases {
            let mut ranges = Ranges {
                candidates: 1000,
                ..of
            };
            change(&mut ranges);
            let refused = Design::search(&file, &ranges, &Threads(2)).unwrap_err();
            assert!(refused.to_string().contains(expected), "{refused}");
        }
        let second = DEFAULT.replace("gear = 1 ", "gear = 2 ");
        let second = SceneFile::parse(&second).unwrap();
        let refused = Design::search(&second, &Ranges::of(&second), &Threads(1)).unwrap_err();
        assert!(
            refused.to_string().contains("order of the target"),
            "{refused}"
        );
    }
}
