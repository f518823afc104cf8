//! `kband gear`: amplitude and second tone at which parts of scattering restitution stay in gear.

mod survey;

use std::f64::consts::TAU;

use kband::feeder::{Restitution, Track};
use kband::impact::{Tone, Wave};
use kband::regime::band;
use serde_json::{Value as Json, json};
use survey::{Point, Survey};

use super::describe_lot;
use crate::arguments::{
    self, ContactArguments, DriveArguments, OutputArguments, Range, ToneArguments,
};
use crate::causes;
use crate::desk::Desk;
use crate::picture::{Axis, Grid, Panel, Picture};
use crate::refusal::{Exit, Result};
use crate::report::{Printout, Value, fields, number, numbers, when};
pub(in crate::verbs) use survey::Lot;

/// Compute the share of time in gear over k and second tone, for parts whose restitution scatters.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband gear --restitution 0.3 --scatter 0.05
  kband gear --restitution 0.10..0.30 --scatter 0.03 --out gear.svg
  kband gear --restitution 0.5 --scatter 0.1 --largest-second-tone 0.25 --format json
  kband gear --restitution 0.3 --scatter 0.05 --second-tone 0.15,2.356 --k 0.3..0.5:41 --format csv
  kband gear --restitution 0.3 --scatter 0.05 --b 0.18..0.3 --frequency 50

A part is in gear of order r while it makes one flight in every r drive periods: at least 8 flights \
of 0.6 to 1.4 r periods in a row, without a rest. They may be locked, doubled or chaotic. Each run \
starts from rest without a kick; its last three quarters count. On one tone the named point is \
the controller's choice for gear on a drive without limits, if the map contains it. Otherwise fresh \
runs select the best points. Further runs give the shares of the named points. CSV has a row for each point of the map. Beside a \
table the map is drawn into kband-gear.svg, unless --out names a file.

The track moves as sin t + e sin(2 t + th) with th in rad (135 degrees are 2.356). --second-tone \
compares that tone with the sine, instead of a search; --third-tone is in every wave with a second one.")]
pub struct Arguments {
    /// Mean restitution of the parts, or LO..HI of the lot.
    #[arg(long, value_name = "R|LO..HI", default_value = "0.3", value_parser = arguments::restitution)]
    restitution: Restitution,
    /// Standard deviation of a part's restitution from impact to impact. Tumbling bodies have 0.27
    /// to 0.52, which this model does not cover.
    #[arg(long, value_name = "S", default_value = "0.05", value_parser = arguments::within(0.0, 0.3, ""))]
    scatter: f64,
    /// Order: drive periods of a flight.
    #[arg(long, value_name = "N", default_value = "1", value_parser = arguments::count(1, 10))]
    order: usize,
    /// k, one value or a range [default: 0.15 over the order, up to the birth of the lock of the
    /// highest restitution, at most 1 over the order].
    #[arg(long, value_name = "LO..HI[:N]", value_parser = arguments::range_or_value((0.005, 4.0), 41))]
    k: Option<Range>,
    /// Amplitude normal to the track in mm, instead of --k: one value or a range.
    #[arg(long, value_name = "MM", value_parser = arguments::range_or_value((1e-6, 1e3), 41), conflicts_with = "k")]
    b: Option<Range>,
    #[command(flatten)]
    tones: ToneArguments,
    /// Largest second tone of the search, over the first tone.
    #[arg(long, value_name = "E", default_value = "0.15", value_parser = arguments::within(0.01, 0.5, ""))]
    largest_second_tone: f64,
    /// Quality of the drive's resonance. From it follows the force that the second tone needs.
    #[arg(long, value_name = "Q", default_value = "25", value_parser = arguments::within(1.0, 1000.0, ""))]
    quality: f64,
    #[command(flatten)]
    contact: ContactArguments,
    /// Number of restitutions of a lot, its ends included.
    #[arg(long, value_name = "N", default_value = "5", value_parser = arguments::count(2, 101))]
    parts: usize,
    /// Number of runs of each part at each point; half of them where no part gets into gear.
    #[arg(long, value_name = "N", default_value = "8", value_parser = arguments::count(1, 1000))]
    runs: usize,
    /// Duration of a run in drive periods.
    #[arg(long, value_name = "N", default_value = "250", value_parser = arguments::count(40, 1_000_000))]
    periods: usize,
    /// Seed of the random restitutions. Equal seeds give equal bits, with any number of threads.
    #[arg(long, value_name = "N", default_value = "1", value_parser = arguments::seed)]
    seed: u64,
    #[command(flatten)]
    drive: DriveArguments,
    #[command(flatten)]
    output: OutputArguments,
}

const SECOND_TONE_AMPLITUDES: u32 = 5;

/// Angles of the second tone in a search: first and last in rad, and their number.
///
/// At order 1 with two tones the best of 32 angles around the circle was 2.2 to 2.9 rad, for each R
/// of 0.2, 0.3, 0.5 and e of 0.15, 0.25.
fn angles(arguments: &Arguments) -> (f64, f64, u32) {
    if arguments.order == 1 && arguments.tones.third_tone.is_none() {
        (1.9, 3.0, 12)
    } else {
        (0.0, TAU * 23.0 / 24.0, 24)
    }
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let output = arguments.output.check_or("kband-gear.svg")?;
    let order = arguments.order as u32;
    let contact = arguments.contact.time(arguments.drive.frequency)?;
    let lot = Lot {
        restitution: arguments.restitution,
        parts: arguments.parts,
        scatter: arguments.scatter,
        order,
        runs: arguments.runs,
        periods: arguments.periods as f64,
        seed: arguments.seed,
        contact,
    };
    let k = match (arguments.k, arguments.b) {
        (Some(range), _) => range,
        (None, Some(b)) => {
            // Evenly spaced in k, as on the map.
            let track = arguments.drive.track()?;
            let [low, high] = [b.high, b.low].map(|b| arguments::k_of(&track, b));
            Range::new(low?, high?, b.count)
        }
        (None, None) => {
            let liveliest = arguments.restitution.high().min(0.99);
            let [edge, _] = band::edges_with_contact(liveliest, order, contact)?;
            let birth = band::birth(liveliest, order)?.max(edge);
            let order = f64::from(order);
            Range::new(0.15 / order, (1.02 * birth).min(1.0 / order), 41)
        }
    };
    // The controller's setpoint for this lot on an unlimited drive, as in `kband bands`.
    let feeder = causes::unbounded(arguments.restitution, arguments.scatter, contact);
    let planned = causes::plan(&feeder, arguments.order as u8).map(|(plan, _)| plan.k.into());
    let k: Vec<f64> = k.values().collect();
    let survey = Survey::run(lot, &k, &waves(arguments)?, planned, desk)?;
    output.show(&report(arguments, &survey)?, || picture(arguments, &survey))
}

/// The waves to try; the sine is the first.
fn waves(arguments: &Arguments) -> Result<Vec<Wave>> {
    let [_, third] = arguments.tones.upper();
    let mut waves = vec![Wave::sine()];
    if arguments.tones.second_tone.is_some() {
        waves.push(arguments.tones.wave()?);
        return Ok(waves);
    }
    let (from, to, count) = angles(arguments);
    for n in 1..=SECOND_TONE_AMPLITUDES {
        let amplitude =
            arguments.largest_second_tone * f64::from(n) / f64::from(SECOND_TONE_AMPLITUDES);
        for m in 0..count {
            let angle = from + (to - from) * (f64::from(m) / f64::from(count - 1));
            waves.push(Wave::build(Tone { amplitude, angle }, third)?);
        }
    }
    Ok(waves)
}

impl Point {
    /// A value of the second tone; `None` on one tone.
    fn of_tone(&self, value: f64) -> Option<f64> {
        (!self.wave.is_sine()).then_some(value)
    }

    /// Forces of the second and of the third tone over that of the first: on a resonance of this
    /// quality, and far above any.
    fn forces(&self, quality: f64) -> [[f64; 2]; 2] {
        let [e, e3] = [self.wave.second(), self.wave.third()].map(|tone| tone.amplitude);
        // The dynamic stiffness of a resonator is |1 - (w/w0)^2|: 1/Q at resonance, 3 at twice
        // and 8 at three times it. That of a mass grows as w^2.
        [[3.0 * quality * e, 4.0 * e], [8.0 * quality * e3, 9.0 * e3]]
    }

    fn until_lost(&self) -> Value {
        let sum = self.shares.sum();
        match sum.time_to_loss() {
            Some(periods) => periods.into(),
            None if sum.in_gear > 0.0 => "not lost".into(),
            None => Value::Missing,
        }
    }
}

fields! {
    fn named_point(at: Point, track: Track, quality: f64) {
        read POINT => at.name;
        all K.digits(4) => at.k;
        read E.titled("e").digits(3) => at.of_tone(at.wave.second().amplitude);
        read TH.digits(4) => at.of_tone(at.wave.second().angle);
        json E => at.wave.second().amplitude;
        json TH => at.wave.second().angle;
        json E3 => at.wave.third().amplitude;
        json TH3 => at.wave.third().angle;
        all IN_GEAR.titled("in gear").digits(3) => at.shares.mean();
        all IN_GEAR_LEAST.titled("worst part").digits(3) => at.shares.min_share();
        json IN_GEAR_AFTER_CAPTURE => at.shares.sum().share_after_capture();
        all PERIODS_TO_CAPTURE.titled("until captured").digits(3) => at.shares.sum().time_to_capture();
        read IN_GEAR_AFTER_CAPTURE.titled("in gear after").digits(3) => at.shares.sum().share_after_capture();
        read PERIODS_TO_LOSS.titled("until lost (periods)").digits(3) => at.until_lost();
        json PERIODS_TO_LOSS => at.shares.sum().time_to_loss();
        all PERIODS_TO_LOSS_ERROR.titled("error").digits(2) => {
            let sum = at.shares.sum();
            sum.time_to_loss().map(|time| time / (sum.losses as f64).sqrt())
        };
        all B.digits(4) => 1e3 * track.amplitude(at.k);
        all PEAK.digits(3) => track.acceleration(track.amplitude(at.k)) * at.wave.peak_acceleration();
        read FORCE_RATIO_ON_RESONANCE.titled("F2/F1").digits(3) => at.of_tone(at.forces(*quality)[0][0]);
        json FORCE_RATIO_ON_RESONANCE => at.forces(*quality)[0][0];
        json FORCE_RATIO_OFF_RESONANCE => at.forces(*quality)[0][1];
        json THIRD_FORCE_RATIO_ON_RESONANCE => at.forces(*quality)[1][0];
        json THIRD_FORCE_RATIO_OFF_RESONANCE => at.forces(*quality)[1][1];
    }
}

fields! {
    fn map_point(at: (Wave, f64, [f64; 2])) {
        table E.titled("e") => at.0.second().amplitude;
        table TH => at.0.second().angle;
        table E3 => at.0.third().amplitude;
        table TH3 => at.0.third().angle;
        table K => at.1;
        table IN_GEAR => at.2[0];
        table IN_GEAR_LEAST => at.2[1];
    }
}

fn lot_name(arguments: &Arguments, survey: &Survey) -> String {
    let parts = survey.lot.restitutions().len();
    let parts = when(parts > 1, || format!(" ({parts} parts)"));
    describe_lot(arguments.restitution) + &parts
}

fn report(arguments: &Arguments, survey: &Survey) -> Result<Printout> {
    let track = arguments.drive.track()?;
    let view = named_point(&track, &arguments.quality);
    let (one, two, middle) = (&survey.points[0], &survey.points[1], survey.points.get(2));
    let lot = arguments.restitution;
    let lot_name = lot_name(arguments, survey);
    let report = view
        .printout(&survey.points)
        .folded()
        .heading(format!(
            "Share of time in gear of order {}, {lot_name}, scatter {}, from rest, {} Hz{}",
            arguments.order,
            number(arguments.scatter, 6),
            number(arguments.drive.frequency, 6),
            arguments.contact.describe()
        ))
        .note(format!(
            "Each part was watched for {} periods at each of these points.",
            number(survey.lot.run_periods(), 6)
        ));
    let unlocked = middle.is_none().then_some(
        "Without scatter no amplitude locks all of this lot with one tone: see kband bands.",
    );
    let [second, third] = two.forces(arguments.quality);
    let ([on, off], quality) = (numbers(second, 3), number(arguments.quality, 4));
    let second = format!(
        "The second tone takes {on} of the first one's force on a resonance of quality {quality}, {off} off it."
    );
    let [on, off] = numbers(third, 3);
    let third = when(two.wave.third().amplitude > 0.0, || {
        format!("The third tone takes {on} of it there, {off} off it.")
    });
    let point = |(k, share)| json!({"k": k, "in_gear": share});
    let over_k = |wave: usize| survey.over_k(wave).map(point).collect::<Json>();
    let json = json!({
        "restitution_low": lot.low(),
        "restitution_high": lot.high(),
        "scatter": arguments.scatter,
        "order": arguments.order,
        "seed": arguments.seed,
        "periods_watched": survey.lot.run_periods(),
        "one_tone": view.object(one),
        "two_tones": view.object(two),
        "band_middle": middle.map(|middle| view.object(middle)),
        "over_k": {
            "one_tone": over_k(0),
            "two_tones": over_k(survey.best_wave()),
        },
    });
    let count = survey.k.len();
    let points: Vec<_> = (survey.map.iter().enumerate())
        .map(|(n, shares)| (survey.waves[n / count], survey.k[n % count], *shares))
        .collect();
    let csv = map_point().table_of(&points);
    let report = report.notes(unlocked).notes([second, third]);
    Ok(report.json(json).csv_of(csv))
}

fn picture(arguments: &Arguments, survey: &Survey) -> Picture {
    let (low, high) = (survey.k[0], survey.k[survey.k.len() - 1]);
    let share = Axis::new("share of time in gear", "", 0.0, 1.0);
    let two = &survey.points[1];
    let [e, th] = numbers([two.wave.second().amplitude, two.wave.second().angle], 4);
    let best = [&survey.points[0], two].map(|at| (at.k, at.shares.mean()));
    let best_over_k = survey.over_k(survey.best_wave()).collect();
    let mut over = Panel::new(Axis::new("k", "", low, high), share)
        .heading("Over the amplitude, k = g cos α / (b ω²)")
        .line("one tone", 0, survey.over_k(0).collect())
        .line(&format!("e = {e}, th = {th}"), 1, best_over_k)
        .markers("best points, fresh runs", 2, best.to_vec());
    if let Some(middle) = survey.points.get(2) {
        over = over.mark(middle.k, "middle of the band");
    }
    let (lot_name, scatter) = (lot_name(arguments, survey), number(arguments.scatter, 4));
    let (order, runs, periods) = (arguments.order, arguments.runs, arguments.periods);
    let mut picture = Picture::new("How much of the time parts are in gear")
        .width(820.0)
        .caption(format!(
            "{lot_name}, scatter {scatter}, order {order}; from rest, {runs} runs of {periods} periods of each part"
        ))
        .panel(over);
    if arguments.tones.second_tone.is_none() {
        let best = |wave| survey.over_k(wave).map(|at| at.1).fold(0.0, f64::max);
        let shares: Vec<f64> = (1..survey.waves.len()).map(best).collect();
        let (from, to, count) = angles(arguments);
        let half = 0.5 * (to - from) / f64::from(count - 1);
        let step = arguments.largest_second_tone / f64::from(SECOND_TONE_AMPLITUDES);
        let angle = Axis::new("angle th of the second tone", "rad", from - half, to + half);
        let top = arguments.largest_second_tone + 0.5 * step;
        let amplitude = Axis::new("amplitude e of the second tone", "", 0.5 * step, top);
        let share = Axis::over_values("in gear", "", shares.iter().copied());
        let best = Panel::new(angle, amplitude)
            .heading("Over the second tone, each at its best k")
            .heat(Grid::new(count as usize, shares), share);
        picture = picture.panel(best);
    }
    picture
}
