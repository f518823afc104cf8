//! `kband transport` with friction: conveying speed in mm/s and shares of time over one axis.
//!
//! Each value is an event-driven simulation with Coulomb friction
//! (docs/theory-real-parts.md#t10.4), from rest and from every attracting lock.

use kband::feeder::{Track, TrackSettings};
use kband::impact::{Friction, FrictionSettings, Kernel, Map, Tone, Wave, WaveMap};
use kband::regime::wave_band::{WaveBand, WaveBands, WaveLock};
use kband::transport::{Measured, Motion, Origin, measure, measure_on_tones};
use serde_json::json;

use super::{Feeder, ORDERS};
use crate::arguments::{Output, Range};
use crate::desk::Desk;
use crate::picture::{Axis, Fill, Panel, Picture};
use crate::refusal::{Exit, Refusal, Result};
use crate::report::{Column, Field, Printout, View, columns, fields, finite, number, numbers};

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
        let name = match self {
            Self::Throw => "throw number Γ = 1/k",
            Self::Amplitude => "amplitude b normal to the track",
            Self::Incline => "incline",
            Self::Friction => "friction μ",
            Self::PhaseLead => "phase lead γ",
        };
        Axis::new(name, self.column().unit, range.low, range.high)
    }

    /// Column of the quantity, its lowest and highest value, and its default range. `unit` is the
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

struct Task<'a> {
    feeder: Feeder<'a>,
    wave: Wave,
    /// Bands in which parts may lock on several tones, each with its order.
    bands: Vec<(u32, WaveBand)>,
    over: Over,
    range: Range,
    /// Amplitude in mm, unless the axis is amplitude or throw number.
    amplitude: f64,
}

impl<'a> Task<'a> {
    fn new(feeder: Feeder<'a>, over: Over) -> Result<Self> {
        let (range, amplitude) = requested_range(&feeder, over)?;
        let wave = feeder.arguments.tones.wave()?;
        let mut bands = Vec::new();
        for order in ORDERS.filter(|_| !wave.is_sine()) {
            let ranges = WaveBands::find(&wave, feeder.arguments.restitution, order)?;
            bands.extend(ranges.iter().map(|band| (order, band)));
        }
        Ok(Self {
            feeder,
            wave,
            bands,
            over,
            range,
            amplitude,
        })
    }

    /// The feeder at a value of a quantity.
    fn point(&self, over: Over, value: f64) -> Result<Point> {
        let arguments = self.feeder.arguments;
        let (sliding, sticking) = arguments.friction.unwrap_or((0.0, 0.0));
        let mut settings = TrackSettings {
            incline: self.feeder.track.incline().to_degrees(),
            ..arguments
                .drive
                .settings(arguments.amplitude_ratio, arguments.phase_lead)
        };
        match over {
            Over::Incline => settings.incline = value,
            Over::PhaseLead => settings.phase_lead = value,
            _ => {}
        }
        let track = Track::build(settings)?;
        let k = match over {
            Over::Throw => 1.0 / value,
            Over::Amplitude => track.k(1e-3 * value),
            _ => track.k(1e-3 * self.amplitude),
        };
        let (sliding, sticking) = match over {
            // The ratio of static to sliding friction stays constant.
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
    fn locked(&self, k: f64) -> Result<Vec<Origin>> {
        let restitution = self.feeder.arguments.restitution;
        if self.wave.is_sine() {
            return Ok(self.feeder.locked(k).collect());
        }
        let mut starts = Vec::new();
        for (order, band) in &self.bands {
            let lock = WaveLock::find_in_band(band, &self.wave, k, restitution, *order)?;
            starts.extend(lock.map(|lock| Origin::Hop(lock.state())));
        }
        Ok(starts)
    }

    fn measured(&self, point: &Point, start: Origin) -> Result<Measured> {
        let (k, restitution) = (point.k, self.feeder.arguments.restitution);
        let (wave, effort) = (&self.wave, self.feeder.effort());
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

    fn row(&self, value: f64, start: Origin) -> Result<Row> {
        let point = self.point(self.over, value)?;
        Ok(Row {
            value,
            from_rest: start == Origin::Rest,
            measured: self.measured(&point, start)?,
            point,
        })
    }

    /// Regimes at one value: from rest, and from each attracting lock with another regime.
    fn rows(&self, value: f64) -> Result<Vec<Row>> {
        let from_rest = self.row(value, Origin::Rest)?;
        let starts = self.locked(from_rest.point.k)?;
        let mut rows = vec![from_rest];
        for start in starts {
            let row = self.row(value, start)?;
            let is_near = |old: &Row| match (old.speed(), row.speed()) {
                (Some(one), Some(other)) => (one - other).abs() < 1e-6 * (1.0 + one.abs()),
                (one, other) => one == other,
            };
            let motion = row.measured.motion;
            let mut same = rows.iter().filter(|old| old.measured.motion == motion);
            if !same.any(is_near) {
                rows.push(row);
            }
        }
        Ok(rows)
    }

    /// Notable points: onset of sliding and hopping, best phase lead, change of sign of the speed.
    fn notes(&self, rows: &[Row]) -> Result<Vec<Note>> {
        let over = self.over;
        let mut notes = Vec::new();
        // In `b w`; `None` where friction cannot hold the part.
        let velocity = |value: f64| Ok(self.row(value, Origin::Rest)?.mean());
        if matches!(over, Over::Throw | Over::Amplitude) {
            let is_throw = over == Over::Throw;
            let mm = self.feeder.amplitude(1.0);
            let unit = if is_throw { 1.0 } else { mm };
            let settings = self.point(Over::Throw, 1.0)?.settings;
            // A part that lies on the track slides above it, up or down.
            let threshold = |upwards: bool| settings.sliding_throw_number(&self.wave, upwards);
            let hops = 1.0 / self.wave.highest_throw();
            for (throw, text) in [
                (threshold(true), "slides forward"),
                (threshold(false), "slides backward"),
                (Some(hops), "hops"),
            ] {
                let throw = throw.filter(|throw| *throw <= hops);
                notes.extend(throw.map(|throw| (throw * unit, text)));
            }
        }
        let rest = rows.iter().filter(|row| row.from_rest);
        let rest: Vec<_> = rest.map(|row| (row.value, row.mean())).collect();
        for pair in rest.windows(2) {
            let [(low, Some(at_low)), (high, Some(at_high))] = *pair else {
                continue;
            };
            let climbs = over == Over::Incline;
            let text = if climbs { "just climbs" } else { "reverses" };
            if at_low * at_high < 0.0 {
                let root = bisect(velocity, low, high, at_low)?;
                notes.extend(root.map(|root| (root, text)));
            }
        }
        let moving = rest.iter();
        let moving = moving.filter_map(|(value, mean)| Some(*value).zip(*mean));
        if over == Over::PhaseLead
            && let Some((best, _)) = moving.max_by(|a, b| a.1.total_cmp(&b.1))
        {
            let step = rest.get(1).map_or(1.0, |second| second.0 - rest[0].0);
            let (low, high) = ((best - step).max(-180.0), (best + step).min(180.0));
            let slope = |lead: f64| -> Result<Option<f64>> {
                let sides = velocity(lead + 0.01 * step)?.zip(velocity(lead - 0.01 * step)?);
                Ok(sides.map(|(after, before)| after - before))
            };
            let best = bisect(slope, low, high, 1.0)?;
            notes.extend(best.map(|best| (best, "conveys most")));
        }
        Ok(notes)
    }

    fn describe(&self) -> String {
        let (feeder, over) = (&self.feeder, self.over);
        let arguments = feeder.arguments;
        let (sliding, sticking) = arguments.friction.unwrap_or((0.0, 0.0));
        let mut terms = vec![format!("R = {}", number(arguments.restitution, 6))];
        if over != Over::Friction {
            terms.push(format!("μ = {}", number(sliding, 6)));
            let at_rest = || format!("at rest {}", number(sticking, 6));
            terms.extend((sticking > sliding).then(at_rest));
        }
        terms.push(format!("η = {}", number(arguments.amplitude_ratio, 6)));
        if over != Over::PhaseLead {
            terms.push(format!("γ = {}°", number(arguments.phase_lead, 6)));
        }
        if over != Over::Incline {
            let incline = feeder.track.incline().to_degrees();
            terms.push(format!("incline {}°", number(incline, 6)));
        }
        if !matches!(over, Over::Throw | Over::Amplitude) {
            let throw = self.amplitude / feeder.amplitude(1.0);
            let [b, throw] = numbers([self.amplitude, throw], 4);
            terms.push(format!("b = {b} mm (throw number {throw})"));
        }
        let (frequency, contact) = (feeder.track.frequency(), arguments.contact.describe());
        terms.push(format!("{} Hz{contact}", number(frequency, 6)));
        for (Tone { amplitude, angle }, e, th) in [
            (self.wave.second(), "e", "th"),
            (self.wave.third(), "e3", "th3"),
        ] {
            let (size, angle) = (number(amplitude, 4), number(angle, 5));
            terms.extend((amplitude > 0.0).then(|| format!("{e} = {size} at {th} = {angle}")));
        }
        terms.join(", ")
    }
}

struct Point {
    track: Track,
    settings: FrictionSettings,
    k: f64,
}

pub struct Row {
    value: f64,
    point: Point,
    from_rest: bool,
    measured: Measured,
}

impl Row {
    /// Throw number (symbol Gamma).
    pub fn throw(&self) -> f64 {
        1.0 / self.point.k
    }

    /// Amplitude normal to the track in mm (symbol b).
    pub fn amplitude(&self) -> f64 {
        1e3 * self.point.track.amplitude(self.point.k)
    }

    /// Mean velocity in `b w`; `None` where friction cannot hold the part.
    fn mean(&self) -> Option<f64> {
        self.measured.conveyed.time_mean()
    }

    /// Conveying speed in mm/s; `None` where friction cannot hold the part.
    pub fn speed(&self) -> Option<f64> {
        let track = &self.point.track;
        let unit = track.velocity_unit(track.amplitude(self.point.k));
        self.mean().map(|mean| 1e3 * mean * unit)
    }

    pub fn regime(&self) -> &'static str {
        regime(self.measured.motion).0
    }

    /// Shares of the time in flight, sliding up, sliding down, lying still; NaN if no time passes.
    fn shares(&self) -> [f64; 4] {
        let conveyed = &self.measured.conveyed;
        let time = conveyed.flying + conveyed.resting;
        let still = conveyed.resting - conveyed.forward - conveyed.backward;
        // Rounding may make the difference negative.
        let still = still.max(0.0);
        let parts = [conveyed.flying, conveyed.forward, conveyed.backward, still];
        parts.map(|part| {
            let is_none = part < 1e-12 * time;
            if is_none { 0.0 } else { part / time }
        })
    }
}

/// Regimes from rest over the throw number.
pub(super) fn from_rest(feeder: Feeder, desk: &Desk) -> Result<Vec<Row>> {
    let task = Task::new(feeder, Over::Throw)?;
    let values: Vec<f64> = task.range.values().collect();
    let row = |n: usize| task.row(values[n], Origin::Rest);
    desk.try_map("conveying", values.len(), row)
}

pub(super) fn run(feeder: Feeder<'_>, output: &Output, desk: &Desk) -> Result<Exit> {
    let over = match (feeder.arguments.over, feeder.arguments.b) {
        (Some(over), _) => over,
        (None, Some(_)) => Over::Amplitude,
        (None, None) => Over::Throw,
    };
    let task = Task::new(feeder, over)?;
    let values: Vec<f64> = task.range.values().collect();
    let blocks = desk.try_map("conveying", values.len(), |n| task.rows(values[n]))?;
    let rows: Vec<Row> = blocks.into_iter().flatten().collect();
    let (range, notes, text) = (task.range, task.notes(&rows)?, task.describe());
    let report = report(over, &rows, &notes, &text);
    output.show(&report, || picture(over, range, &rows, &notes, &text))
}

/// Root of a function between `low` and `high`, by 40 bisections; `None` where it has no value.
fn bisect(
    function: impl Fn(f64) -> Result<Option<f64>>,
    mut low: f64,
    mut high: f64,
    at_low: f64,
) -> Result<Option<f64>> {
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        let Some(value) = function(middle)? else {
            return Ok(None);
        };
        if value * at_low > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(Some(0.5 * (low + high)))
}

/// Requested values of the axis, and the amplitude in mm for the other axes.
fn requested_range(feeder: &Feeder, over: Over) -> Result<(Range, f64)> {
    let (unit, arguments) = (feeder.amplitude(1.0), feeder.arguments);
    let throws = match (arguments.throw, arguments.k, arguments.b) {
        (Some(throw), ..) => Some(throw),
        (_, Some(k), _) => Some(Range::new(1.0 / k.high, 1.0 / k.low, k.count)),
        (.., b) => b.map(|b| Range::new(b.low / unit, b.high / unit, b.count)),
    };
    let (_, [low, high], (first, last, count)) = over.values(unit);
    let in_mm = |range: Range| Range::new(range.low * unit, range.high * unit, range.count);
    let given = match over {
        Over::Throw => throws,
        Over::Amplitude => throws.map(in_mm),
        _ => arguments.values,
    };
    let range = given.unwrap_or(Range::new(first, last, count));
    if range.low < low || range.high > high {
        let accepted = format!("{low}..{high} over this axis");
        let next = "give a range within it";
        return Err(Refusal::value("--values", range, accepted, next));
    }
    let amplitude = match (over, throws) {
        (Over::Throw | Over::Amplitude, _) => unit,
        // Usual throw number of industrial feeders.
        (_, None) => 1.5 * unit,
        (_, Some(range)) if range.count == 1 => range.low * unit,
        (_, Some(range)) => {
            let accepted = "one value with --over incline, friction or phase-lead";
            let next = "for example --throw 1.5";
            return Err(Refusal::value("--throw, --k or --b", range, accepted, next));
        }
    };
    Ok((range, amplitude))
}

fields! {
    fn motions(row: Row) {
        json K => row.point.k;
        all FROM_REST => row.from_rest;
        all REGIME => row.regime();
        all SPEED.digits(5) => row.speed();
        all VELOCITY.digits(6) => row.mean();
        all IN_FLIGHT.digits(3) => finite(row.shares()[0]);
        all SLIDING_UP.digits(3) => finite(row.shares()[1]);
        all SLIDING_DOWN.digits(3) => finite(row.shares()[2]);
        all STILL.digits(3) => finite(row.shares()[3]);
    }
}

/// A notable value of the axis, and what happens there.
type Note = (f64, &'static str);

fn report(over: Over, rows: &[Row], notes: &[Note], text: &str) -> Printout {
    let axis = |axis: Over, value: fn(&Row) -> f64| match axis == over {
        true => Field::json(axis.column(), value),
        false => Field::all(axis.column(), value),
    };
    let view = View::from_fields(vec![
        Field::table(over.column(), |row: &Row| row.value),
        Field::json(columns::VALUE, |row: &Row| row.value),
        axis(Over::Throw, Row::throw),
        axis(Over::Amplitude, Row::amplitude),
    ])
    .and(motions());
    let unheld = "no speed where friction cannot hold the part: it slides down ever faster";
    let is_unheld = rows.iter().any(|row| row.speed().is_none());
    let in_words = |(value, what): &Note| format!("{what} at {}", number(*value, 6));
    let in_json = |(value, what): &Note| json!({"value": value, "what": what});
    let in_json: Vec<_> = notes.iter().map(in_json).collect();
    view.printout(rows)
        .heading(format!("Conveying speed with friction; {text}"))
        .notes(notes.iter().map(in_words))
        .notes(is_unheld.then_some(unheld))
        .json(json!({"rows": view.objects(rows), "notes": in_json}))
}

fn picture(over: Over, range: Range, rows: &[Row], notes: &[Note], text: &str) -> Picture {
    let speeds = rows.iter().filter_map(Row::speed).chain([0.0]);
    let speed = Axis::over_values("conveying speed", "mm/s", speeds);
    let mut panel = Panel::new(over.axis(range), speed).height(380.0);
    let points = |from_rest: bool| -> Vec<(f64, f64)> {
        let own = rows.iter().filter(|row| row.from_rest == from_rest);
        own.map(|row| (row.value, row.speed().unwrap_or(f64::NAN)))
            .collect()
    };
    panel = panel.line("from rest", 0, points(true));
    let locked = points(false);
    if !locked.is_empty() {
        panel = panel.markers("from a lock", 2, locked);
    }
    for (value, text) in notes {
        panel = panel.mark(*value, *text);
    }
    let rest = || rows.iter().filter(|row| row.from_rest);
    let fills = rest().map(|row| (row.value, regime(row.measured.motion).1));
    panel = panel.ribbon_of_points([range.low, range.high], fills, &FILLS);
    let share = Axis::new("share of the time", "", 0.0, 1.0);
    let mut below = Panel::new(over.axis(range), share).height(200.0);
    let names = ["in flight", "sliding up", "sliding down", "still"];
    for (series, name) in names.into_iter().enumerate() {
        let points = rest().map(|row| (row.value, row.shares()[series]));
        below = below.line(name, series, points.collect());
    }
    let picture = Picture::new("Conveying speed with friction").caption(text);
    picture.panel(panel).panel(below)
}

#[cfg(test)]
mod tests {
    use super::super::from_rest;
    use super::*;

    #[test]
    fn speeds_are_those_of_small_steps_and_of_another_engine() {
        // tests/reference/friction.py: by small time steps and a finite contact time. The error is
        // that of doubling that time: first order in it, so the distance to the limit.
        let stepped = include_str!("../../../../../tests/reference/friction.csv");
        assert_eq!(judged_by(stepped, 2.0), 6);
        // tests/reference/friction_siconos.py: by Siconos, with the error of its contact limit.
        let siconos = include_str!("../../../../../tests/reference/friction-siconos.csv");
        assert_eq!(judged_by(siconos, 1.0), 8);
        let on_tones = include_str!("../../../../../tests/reference/friction-tones.csv");
        assert_eq!(judged_by(on_tones, 2.0), 7);
    }

    /// Number of cases of a reference that agree within `errors` times the error that it states.
    fn judged_by(speeds: &str, errors: f64) -> usize {
        let desk = Desk::new(Some(2));
        let mut cases = 0;
        for line in speeds.lines().skip(1) {
            let columns: Vec<f64> = line.split(',').map(|word| word.parse().unwrap()).collect();
            let (feeder, results) = columns.split_at(columns.len() - 2);
            let [throw, eta, mu, incline, lead, restitution] = feeder[..6] else {
                panic!("{line}");
            };
            let [velocity, error] = [results[0], results[1]];
            let tones = match feeder[6..] {
                [e, th, e3, th3] => format!("--second-tone {e},{th} --third-tone {e3},{th3}"),
                _ => String::new(),
            };
            let options = format!(
                "--throw {throw} --amplitude-ratio {eta} --friction {mu} --incline={incline} --phase-lead={lead} \
                 --restitution {restitution} {tones}"
            );
            let mean = from_rest(&options, &desk).unwrap()[0].mean().unwrap();
            // After 20 cycles the speed is within 2e-5 of a steady slide.
            let allowed = errors * error + 2e-5;
            assert!((mean - velocity).abs() < allowed, "{line}: {mean}");
            cases += 1;
        }
        cases
    }
}
