//! `kband transport` with friction: conveying speed in mm/s and shares of time over one axis.
//!
//! The axis is the throw number, the amplitude (mm), the incline or phase lead (degrees), or the
//! friction. Each value is an event-driven simulation with Coulomb friction
//! (docs/theory-real-parts.md#t10.4), from rest and from every attracting lock. Bisection locates
//! reversals of the speed; golden-section search (Kiefer 1953) finds the best phase lead.
//!
//! Regimes have the names of Hongler & Figour 1989: always in contact (S), hop and slide (H-S),
//! hopping (H).

use kband::feeder::{STANDARD_GRAVITY, Track, TrackSettings};
use kband::impact::{Friction, FrictionSettings, Kernel, Map, Tone, Wave, WaveMap};
use kband::regime::wave_band::{WaveBand, WaveBands, WaveLock};
use kband::transport::{Measured, Motion, Origin, measure, measure_on_tones};
use serde_json::json;

use super::{Arguments, Computed, Feeder, ORDERS, effort, half_ways, locks};
use crate::arguments::Range;
use crate::desk::Desk;
use crate::picture::{Axis, Fill, Panel, Picture};
use crate::refusal::Refusal;
use crate::report::{Column, Field, Printout, View, columns, fields, number};

/// Quantity of the horizontal axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Over {
    /// The throw number Gamma = 1/k.
    Throw,
    /// The amplitude normal to the track, in mm.
    Amplitude,
    /// The incline, in degrees.
    Incline,
    /// The coefficient of friction.
    Friction,
    /// The phase lead of the parallel motion (gamma), in degrees.
    PhaseLead,
}

impl Over {
    fn axis(self, range: Range) -> Axis {
        let (name, unit) = match self {
            Self::Throw => ("throw number Γ = 1/k", ""),
            Self::Amplitude => return Axis::of_b(range.low, range.high),
            Self::Incline => ("incline", "°"),
            Self::Friction => ("friction μ", ""),
            Self::PhaseLead => ("phase lead γ", "°"),
        };
        Axis::new(name, unit, range.low, range.high)
    }

    /// Its column, its lowest and highest value, and its range where none is given. `unit` is the
    /// amplitude in mm at a throw number of 1.
    fn values(self, unit: f64) -> (Column, [f64; 2], (f64, f64, usize)) {
        match self {
            Self::Throw => (columns::THROW, [1e-3, 1e3], (0.3, 3.5, 129)),
            Self::Amplitude => (columns::B, [1e-6, 1e3], (0.3 * unit, 3.5 * unit, 129)),
            Self::Incline => (columns::INCLINE, [-45.0, 45.0], (-10.0, 30.0, 81)),
            Self::Friction => (columns::FRICTION, [0.0, 10.0], (0.0, 1.0, 101)),
            Self::PhaseLead => (columns::PHASE_LEAD, [-180.0, 180.0], (-180.0, 180.0, 145)),
        }
    }

    fn column(self) -> Column {
        self.values(1.0).0
    }
}

/// The paper's name of a regime, and its fill.
fn regime(motion: Motion) -> (&'static str, Fill) {
    match motion {
        Motion::Rest => ("S", Fill::Rest),
        Motion::HopAndRest => ("H-S", Fill::HopAndRest),
        Motion::Hopping => ("H", Fill::Locked),
    }
}

const FILLS: [(Fill, &str); 3] = [
    (Fill::Rest, "S: always in contact"),
    (Fill::HopAndRest, "H-S: hops and lies"),
    (Fill::Locked, "H: hops on"),
];

/// The track's motion, and on several tones the bands in which parts of a restitution may lock,
/// each with its order.
#[derive(Clone, Debug)]
struct Shape {
    wave: Wave,
    bands: Vec<(u32, WaveBand)>,
}

impl Shape {
    fn of(arguments: &Arguments) -> Result<Self, Refusal> {
        let tones = [arguments.second_tone, arguments.third_tone].map(Option::unwrap_or_default);
        let wave = Wave::build(tones[0], tones[1])?;
        let mut bands = Vec::new();
        if !wave.is_sine() {
            for order in ORDERS {
                let found = WaveBands::find(&wave, arguments.restitution, order)?;
                bands.extend(found.iter().map(|band| (order, band)));
            }
        }
        Ok(Self { wave, bands })
    }

    /// Throw number above which a part that lies on the track slides up it, or down.
    fn slides_above(&self, settings: &FrictionSettings, upwards: bool) -> Option<f64> {
        if self.wave.is_sine() {
            settings.sliding_throw_number(upwards)
        } else {
            settings.sliding_throw_number_on(&self.wave, upwards)
        }
    }

    fn words(&self) -> Vec<String> {
        let named = [
            (self.wave.second(), "e", "th"),
            (self.wave.third(), "e3", "th3"),
        ];
        let given = named.iter().filter(|(tone, ..)| tone.amplitude > 0.0);
        let tone = |(Tone { amplitude, angle }, e, th): &(Tone, &str, &str)| {
            let (amplitude, angle) = (number(*amplitude, 4), number(*angle, 5));
            format!("{e} = {amplitude} at {th} = {angle}")
        };
        given.map(tone).collect()
    }
}

/// What is computed: the requested feeder over an axis.
struct Task<'a> {
    feeder: Feeder,
    arguments: &'a Arguments,
    shape: Shape,
    over: Over,
    range: Range,
    /// Amplitude in mm, where the axis is another one.
    amplitude: f64,
}

impl<'a> Task<'a> {
    fn of(feeder: &Feeder, arguments: &'a Arguments, over: Over) -> Result<Self, Refusal> {
        let (range, amplitude) = requested_range(feeder, arguments, over)?;
        Ok(Self {
            feeder: *feeder,
            arguments,
            shape: Shape::of(arguments)?,
            over,
            range,
            amplitude,
        })
    }

    /// The feeder with a value of the axis.
    fn at(&self, value: f64) -> Result<Point, Refusal> {
        self.point(self.over, value)
    }

    fn point(&self, over: Over, value: f64) -> Result<Point, Refusal> {
        let arguments = self.arguments;
        let (sliding, sticking) = arguments.friction.unwrap_or((0.0, 0.0));
        let incline = match over {
            Over::Incline => value,
            _ => self.feeder.track.incline().to_degrees(),
        };
        let phase_lead = match over {
            Over::PhaseLead => value,
            _ => arguments.phase_lead,
        };
        let track = Track::build(TrackSettings {
            frequency: arguments.drive.frequency,
            incline,
            amplitude_ratio: arguments.amplitude_ratio,
            phase_lead,
            gravity: STANDARD_GRAVITY,
        })?;
        let k = match over {
            Over::Throw => 1.0 / value,
            Over::Amplitude => track.k(1e-3 * value),
            _ => track.k(1e-3 * self.amplitude),
        };
        let (sliding, sticking) = match over {
            // The one that sticks keeps its share.
            Over::Friction if sliding > 0.0 => (value, value * sticking / sliding),
            Over::Friction => (value, value),
            _ => (sliding, sticking),
        };
        Ok(Point {
            track,
            settings: FrictionSettings::on(&track, sticking, sliding),
            k,
        })
    }

    /// Starts on the locks that attract at `k`.
    fn locked(&self, k: f64) -> Result<Vec<Origin>, Refusal> {
        let restitution = self.arguments.restitution;
        if self.shape.wave.is_sine() {
            let starts = locks(k, &self.feeder).into_iter();
            return Ok(starts.map(|lock| Origin::Hop(lock.state())).collect());
        }
        let mut starts = Vec::new();
        for (order, band) in &self.shape.bands {
            let lock = WaveLock::find_in_band(band, &self.shape.wave, k, restitution, *order)?;
            starts.extend(lock.map(|lock| Origin::Hop(lock.state())));
        }
        Ok(starts)
    }

    fn measured(&self, point: &Point, start: Origin) -> Result<Measured, Refusal> {
        let (k, restitution) = (point.k, self.arguments.restitution);
        let (wave, effort) = (&self.shape.wave, effort(self.arguments));
        let along = Friction::on(wave, k, point.settings)?;
        if wave.is_sine() {
            let map = Map::build(k, restitution)?;
            let orbit = start.orbit(&map).with_contact(self.feeder.contact);
            return Ok(measure(orbit, along, effort, &mut ()));
        }
        let map = WaveMap::on(*wave, k, restitution)?;
        let orbit = start.orbit(&map).with_contact(self.feeder.contact);
        Ok(measure_on_tones(orbit, along, effort))
    }

    /// The regimes at one value: from rest, and from each lock that attracts where that is another.
    fn rows(&self, value: f64) -> Result<Vec<Row>, Refusal> {
        let point = self.at(value)?;
        let mut rows: Vec<Row> = Vec::new();
        for start in std::iter::once(Origin::Rest).chain(self.locked(point.k)?) {
            let row = Row {
                value,
                point,
                from_rest: start == Origin::Rest,
                measured: self.measured(&point, start)?,
            };
            let near = |old: &Row| match (old.speed(), row.speed()) {
                (Some(one), Some(other)) => (one - other).abs() < 1e-6 * (1.0 + one.abs()),
                (one, other) => one == other,
            };
            let motion = row.measured.motion;
            if !rows
                .iter()
                .any(|old| old.measured.motion == motion && near(old))
            {
                rows.push(row);
            }
        }
        Ok(rows)
    }

    /// Notable points: onset of sliding and hopping, best phase lead, change of sign of the speed.
    fn notes(&self, rows: &[Row]) -> Result<Vec<(f64, String)>, Refusal> {
        let over = self.over;
        let mut notes = Vec::new();
        let speed = |value: f64| -> Result<f64, Refusal> {
            let found = self.measured(&self.at(value)?, Origin::Rest)?;
            Ok(found.conveyed.time_mean().unwrap_or(f64::NAN))
        };
        if matches!(over, Over::Throw | Over::Amplitude) {
            let unit = match over {
                Over::Throw => 1.0,
                _ => self.feeder.amplitude(1.0),
            };
            let point = self.point(Over::Throw, 1.0)?;
            let threshold = |upwards: bool| self.shape.slides_above(&point.settings, upwards);
            let hops = 1.0 / self.shape.wave.highest_throw();
            for (throw, words) in [
                (threshold(true), "slides forward"),
                (threshold(false), "slides backward"),
                (Some(hops), "hops"),
            ] {
                if let Some(throw) = throw.filter(|throw| *throw <= hops) {
                    notes.push((throw * unit, words.to_string()));
                }
            }
        }
        let rest = rows.iter().filter(|row| row.from_rest);
        let rest: Vec<(f64, f64)> = rest
            .filter_map(|row| Some((row.value, row.measured.conveyed.time_mean()?)))
            .collect();
        for pair in rest.windows(2) {
            let [(mut low, one), (mut high, other)] = [pair[0], pair[1]];
            if one * other >= 0.0 {
                continue;
            }
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if speed(middle)? * one > 0.0 {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            let words = match over {
                Over::Incline => "just climbs",
                _ => "reverses",
            };
            notes.push((0.5 * (low + high), words.to_string()));
        }
        if over == Over::PhaseLead
            && let Some(top) = rest.iter().max_by(|a, b| a.1.total_cmp(&b.1))
        {
            let step = rest.get(1).map_or(1.0, |second| second.0 - rest[0].0);
            // Golden section about the best of the grid.
            let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
            let (mut low, mut high) = ((top.0 - step).max(-180.0), (top.0 + step).min(180.0));
            for _ in 0..30 {
                let (a, b) = (high - golden * (high - low), low + golden * (high - low));
                if speed(a)? > speed(b)? {
                    high = b;
                } else {
                    low = a;
                }
            }
            notes.push((0.5 * (low + high), "conveys most".to_string()));
        }
        Ok(notes)
    }

    fn words(&self) -> String {
        let (feeder, arguments, over) = (&self.feeder, self.arguments, self.over);
        let (sliding, sticking) = arguments.friction.unwrap_or((0.0, 0.0));
        let mut words = vec![format!("R = {}", number(feeder.restitution, 6))];
        if over != Over::Friction {
            words.push(format!("μ = {}", number(sliding, 6)));
            let at_rest = || format!("at rest {}", number(sticking, 6));
            words.extend((sticking > sliding).then(at_rest));
        }
        words.push(format!("η = {}", number(arguments.amplitude_ratio, 6)));
        if over != Over::PhaseLead {
            words.push(format!("γ = {}°", number(arguments.phase_lead, 6)));
        }
        if over != Over::Incline {
            words.push(format!(
                "incline {}°",
                number(feeder.track.incline().to_degrees(), 6)
            ));
        }
        if !matches!(over, Over::Throw | Over::Amplitude) {
            words.push(format!(
                "b = {} mm (throw number {})",
                number(self.amplitude, 4),
                number(self.amplitude / feeder.amplitude(1.0), 4)
            ));
        }
        words.push(format!(
            "{} Hz{}",
            number(feeder.track.frequency(), 6),
            feeder.milliseconds.words()
        ));
        words.extend(self.shape.words());
        words.join(", ")
    }
}

#[derive(Clone, Copy, Debug)]
struct Point {
    track: Track,
    settings: FrictionSettings,
    k: f64,
}

impl Point {
    /// mm/s of a mean velocity in `b w`.
    fn speed(&self, velocity: f64) -> f64 {
        1e3 * velocity * self.track.velocity_unit(self.track.amplitude(self.k))
    }

    /// Amplitude normal to the track in mm.
    fn amplitude(&self) -> f64 {
        1e3 * self.track.amplitude(self.k)
    }
}

/// A regime that some start reached.
struct Row {
    value: f64,
    point: Point,
    from_rest: bool,
    measured: Measured,
}

impl Row {
    /// mm/s; `None` where an incline is too steep for any steady speed.
    fn speed(&self) -> Option<f64> {
        let mean = self.measured.conveyed.time_mean()?;
        Some(self.point.speed(mean))
    }

    /// A share of the time; `None` where no time passes.
    fn share(&self, part: usize) -> Option<f64> {
        let share = self.shares()[part];
        share.is_finite().then_some(share)
    }

    /// Shares of the time in flight, sliding up, sliding down, lying still.
    fn shares(&self) -> [f64; 4] {
        let conveyed = &self.measured.conveyed;
        let time = conveyed.flying + conveyed.resting;
        let still = conveyed.resting - conveyed.forward - conveyed.backward;
        // Sums of slides miss what they are part of by a rounding.
        let still = still.max(0.0);
        let parts = [conveyed.flying, conveyed.forward, conveyed.backward, still];
        parts.map(|part| {
            if part < 1e-12 * time {
                0.0
            } else {
                part / time
            }
        })
    }
}

/// How fast a part from rest travels at one throw number.
#[derive(Clone, Copy, Debug)]
pub struct Speed {
    /// Throw number (symbol Gamma).
    pub throw: f64,
    /// Amplitude normal to the track in mm (symbol b).
    pub amplitude: f64,
    /// mm/s; `None` where friction cannot hold the part.
    pub speed: Option<f64>,
    /// S, H-S or H.
    pub regime: &'static str,
}

/// The speeds from rest over the throw number.
pub(super) fn speeds(
    feeder: &Feeder,
    arguments: &Arguments,
    desk: &Desk,
) -> Result<Vec<Speed>, Refusal> {
    let task = Task::of(feeder, arguments, Over::Throw)?;
    let values: Vec<f64> = task.range.values().collect();
    desk.try_map("conveying", values.len(), |n| {
        let point = task.at(values[n])?;
        let measured = task.measured(&point, Origin::Rest)?;
        Ok(Speed {
            throw: values[n],
            amplitude: point.amplitude(),
            speed: measured.conveyed.time_mean().map(|mean| point.speed(mean)),
            regime: regime(measured.motion).0,
        })
    })
}

pub(super) fn computed(
    feeder: Feeder,
    arguments: &Arguments,
    desk: &Desk,
) -> Result<Computed, Refusal> {
    let over = match (arguments.over, arguments.b) {
        (Some(over), _) => over,
        (None, Some(_)) => Over::Amplitude,
        (None, None) => Over::Throw,
    };
    let task = Task::of(&feeder, arguments, over)?;
    let values: Vec<f64> = task.range.values().collect();
    let found = desk.try_map("conveying", values.len(), |n| task.rows(values[n]))?;
    let rows: Vec<Row> = found.into_iter().flatten().collect();
    let (range, notes, words) = (task.range, task.notes(&rows)?, task.words());
    let report = report(over, &rows, &notes, &words)?;
    Ok((
        report,
        Box::new(move || picture(over, range, &rows, &notes, &words)),
    ))
}

/// The values that are shown, and the amplitude in mm where they are no amplitudes.
fn requested_range(
    feeder: &Feeder,
    arguments: &Arguments,
    over: Over,
) -> Result<(Range, f64), Refusal> {
    let unit = feeder.amplitude(1.0);
    let of_k = |range: Range, of: &dyn Fn(f64) -> f64| {
        let (one, other) = (of(range.low), of(range.high));
        Range::new(one.min(other), one.max(other), range.count)
    };
    let of_k_or_b = match (arguments.k, arguments.b) {
        (Some(k), _) => Some(of_k(k, &|k| 1.0 / k)),
        (None, b) => b.map(|b| of_k(b, &|b| b / unit)),
    };
    let throws = arguments.throw.or(of_k_or_b);
    let (_, [low, high], (first, last, count)) = over.values(unit);
    let given = match over {
        Over::Throw => throws,
        Over::Amplitude => throws.map(|range| of_k(range, &|throw| throw * unit)),
        _ => arguments.values,
    };
    let range = given.unwrap_or(Range::new(first, last, count));
    if range.low < low || range.high > high {
        return Err(Refusal::value(
            "--values",
            range,
            format!("{low}..{high} over this axis"),
            "give a range within it",
        ));
    }
    let amplitude = match (over, throws) {
        (Over::Throw | Over::Amplitude, _) => unit,
        // Where feeders of industry run.
        (_, None) => 1.5 * unit,
        (_, Some(range)) if range.count == 1 => range.low * unit,
        (_, Some(range)) => {
            return Err(Refusal::value(
                "--throw, --k or --b",
                range,
                "one value with --over incline, friction or phase-lead",
                "for example --throw 1.5",
            ));
        }
    };
    Ok((range, amplitude))
}

fields! {
    fn motions(row: Row) {
        json K => row.point.k;
        all FROM_REST => row.from_rest;
        all REGIME => regime(row.measured.motion).0;
        all SPEED.digits(5) => row.speed();
        all VELOCITY.digits(6) => row.measured.conveyed.time_mean();
        all IN_FLIGHT.digits(3) => row.share(0);
        all SLIDING_UP.digits(3) => row.share(1);
        all SLIDING_DOWN.digits(3) => row.share(2);
        all STILL.digits(3) => row.share(3);
    }
}

fn report(
    over: Over,
    rows: &[Row],
    notes: &[(f64, String)],
    words: &str,
) -> Result<Printout, Refusal> {
    let axis = |axis: Over, value: fn(&Row) -> f64| {
        if axis == over {
            Field::json(axis.column(), value)
        } else {
            Field::all(axis.column(), value)
        }
    };
    let view = View::of(vec![
        Field::table(over.column(), |row: &Row| row.value),
        Field::json(columns::VALUE, |row: &Row| row.value),
        axis(Over::Throw, |row| 1.0 / row.point.k),
        axis(Over::Amplitude, |row| row.point.amplitude()),
    ])
    .and(motions());
    let json: Vec<_> = rows.iter().map(|row| view.object(row)).collect();
    let unheld = rows.iter().any(|row| row.speed().is_none());
    let report =
        view.printout(rows)
            .heading(format!("Conveying speed with friction; {words}"))
            .notes(
                notes
                    .iter()
                    .map(|(value, words)| format!("{words} at {}", number(*value, 6))),
            )
            .notes(unheld.then_some(
                "no speed where friction cannot hold the part: it slides down ever faster",
            ));
    let notes = notes
        .iter()
        .map(|(value, words)| json!({"value": value, "what": words}));
    report.json(&json!({"rows": json, "notes": notes.collect::<Vec<_>>()}))
}

fn picture(
    over: Over,
    range: Range,
    rows: &[Row],
    notes: &[(f64, String)],
    words: &str,
) -> Picture {
    let speeds: Vec<f64> = rows.iter().filter_map(Row::speed).collect();
    let highest = speeds.iter().copied().fold(0.0, f64::max);
    let lowest = speeds.iter().copied().fold(0.0, f64::min);
    let room = 0.12 * (highest - lowest).max(1e-6);
    let mut panel = Panel::new(
        over.axis(range),
        Axis::new("conveying speed", "mm/s", lowest - room, highest + room),
    )
    .height(380.0);
    let of = |from_rest: bool| -> Vec<(f64, f64)> {
        let of = rows.iter().filter(|row| row.from_rest == from_rest);
        of.map(|row| (row.value, row.speed().unwrap_or(f64::NAN)))
            .collect()
    };
    panel = panel.line("from rest", 0, of(true));
    let locked = of(false);
    if !locked.is_empty() {
        panel = panel.markers("from a lock", 2, locked);
    }
    for (value, words) in notes {
        panel = panel.mark(*value, words);
    }
    let rest = || rows.iter().filter(|row| row.from_rest);
    let fills = rest().map(|row| (row.value, regime(row.measured.motion).1));
    panel = panel.ribbon(half_ways(range.low, range.high, fills), &FILLS);
    let share = Axis::new("share of the time", "", 0.0, 1.0);
    let mut below = Panel::new(over.axis(range), share).height(200.0);
    let names = ["in flight", "sliding up", "sliding down", "still"];
    for (series, name) in names.into_iter().enumerate() {
        let points = rest().map(|row| (row.value, row.shares()[series]));
        below = below.line(name, series, points.collect());
    }
    Picture::new("Conveying speed with friction")
        .caption(words)
        .panel(panel)
        .panel(below)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(options: &str) -> Vec<Row> {
        let arguments = super::super::read(options).unwrap();
        let feeder = Feeder::build(&arguments).unwrap();
        let over = arguments.over.unwrap_or(Over::Throw);
        let task = Task::of(&feeder, &arguments, over).unwrap();
        let values = task.range.values();
        values.flat_map(|value| task.rows(value).unwrap()).collect()
    }

    #[test]
    fn a_lock_with_friction_is_the_paper_with_no_speed_kept() {
        use kband::impact::{ContactTime, TangentialSettings};
        use kband::regime::Lock;
        use kband::transport::locked;
        for milliseconds in [0.0, 0.4] {
            let rows = found(&format!(
                "--k 0.43 --friction 0.3 --restitution 0.2 --incline 3 --contact {milliseconds}"
            ));
            let hopping = rows
                .iter()
                .find(|row| row.measured.motion == Motion::Hopping)
                .unwrap();
            let contact = ContactTime::from_milliseconds(milliseconds, 50.0).unwrap();
            let lock = Lock::with_contact(0.43, 0.2, 1, contact).unwrap().unwrap();
            let dead = TangentialSettings::on(&hopping.point.track, 0.0);
            let expected = locked::velocity(&lock, 0.43, &dead);
            let mean = hopping.measured.conveyed.time_mean().unwrap();
            assert!((mean - expected).abs() < 1e-9, "{mean} {expected}");
        }
    }

    /// Speeds by small time steps and a contact that takes time, each with its own error:
    /// tests/reference/friction.py.
    const STEPPED: &str = include_str!("../../../../tests/reference/friction.csv");
    /// Speeds by Siconos, an engine for unilateral contacts, likewise:
    /// tests/reference/friction_siconos.py.
    const SICONOS: &str = include_str!("../../../../tests/reference/friction-siconos.csv");
    /// Those of small time steps on several tones.
    const ON_TONES: &str = include_str!("../../../../tests/reference/friction-tones.csv");

    #[test]
    fn speeds_are_those_of_small_steps_and_of_another_engine() {
        // What is of first order in the contact's time is as far from its limit as from its double;
        // the engine's error is that of its limit.
        assert_eq!(judged_by(STEPPED, 2.0), 6);
        assert_eq!(judged_by(SICONOS, 1.0), 8);
        assert_eq!(judged_by(ON_TONES, 2.0), 7);
    }

    /// Compares with speeds that come with an error, of which so many are allowed; how many there
    /// were.
    fn judged_by(speeds: &str, errors: f64) -> usize {
        let mut cases = 0;
        for line in speeds.lines().skip(1) {
            let columns: Vec<f64> = line.split(',').map(|word| word.parse().unwrap()).collect();
            let [
                throw,
                eta,
                mu,
                incline,
                lead,
                restitution,
                ..,
                velocity,
                error,
            ] = columns[..]
            else {
                panic!("{line}");
            };
            let tones = match columns[6..columns.len() - 2] {
                [e, th, e3, th3] => format!("--second-tone {e},{th} --third-tone {e3},{th3}"),
                _ => String::new(),
            };
            let rows = found(&format!(
                "--throw {throw} --amplitude-ratio {eta} --friction {mu} --incline={incline} --phase-lead={lead} \
                 --restitution {restitution} {tones}"
            ));
            let mean = rows[0].measured.conveyed.time_mean().unwrap();
            // 20 cycles leave 2e-5 of the way to a steady slide.
            assert!(
                (mean - velocity).abs() < errors * error + 2e-5,
                "{line}: {mean}"
            );
            cases += 1;
        }
        cases
    }

    /// Friction holds an incline of mu at most; above it a part has no steady speed in any regime.
    #[test]
    fn what_friction_cannot_hold_has_no_speed() {
        for throw in [0.8, 1.5, 2.4] {
            let options =
                format!("--throw {throw} --friction 0.3 --over incline --values 10..22:7");
            for row in found(&options) {
                let held = row.value.to_radians().tan() <= 0.3;
                assert_eq!(row.speed().is_some(), held, "{throw} {}", row.value);
            }
        }
    }

    #[test]
    fn regimes_follow_each_other_over_the_throw_number() {
        let rows = found("--throw 0.3..3.5:33 --friction 0.3 --restitution 0.2 --incline 3");
        for row in rows.iter().filter(|row| row.from_rest) {
            let [flying, up, down, still] = row.shares();
            assert!((flying + up + down + still - 1.0).abs() < 1e-9);
            assert_eq!(
                row.measured.motion == Motion::Rest,
                row.value <= 1.0,
                "{}",
                row.value
            );
            assert_eq!(flying == 0.0, row.value <= 1.0);
        }
    }
}
