//! Gear as table, JSON and picture.

use kband::impact::Wave;
use kband::regime::gear::Share;
use serde_json::{Value as Json, json};

use super::Arguments;
use super::survey::{Point, Survey};
use crate::picture::{Axis, Grid, Panel, Picture};
use crate::refusal::Refusal;
use crate::report::{Printout, Value, fields, number, span, when};

/// A named point, and its demands on the drive.
struct NamedPoint<'a> {
    name: &'static str,
    point: &'a Point,
    /// Sum over all parts.
    sum: Share,
    amplitude: f64,
    /// Largest acceleration normal to the track in g.
    peak: f64,
    /// Force of the second tone over that of the first: on a resonance, and far above any.
    force: [f64; 2],
    third: [f64; 2],
}

impl<'a> NamedPoint<'a> {
    fn new(name: &'static str, point: &'a Point, arguments: &Arguments) -> Result<Self, Refusal> {
        let track = arguments.drive.track()?;
        let amplitude = track.amplitude(point.k);
        let [e, e3] = [point.wave.second(), point.wave.third()].map(|tone| tone.amplitude);
        Ok(Self {
            name,
            point,
            sum: point.shares.sum(),
            amplitude: 1e3 * amplitude,
            peak: track.acceleration(amplitude) * point.wave.peak_acceleration(),
            // The dynamic stiffness of a resonator is |1 - (w/w0)^2|: 1/Q at resonance, 3 at twice
            // and 8 at three times it. That of a mass grows as w^2.
            force: [3.0 * arguments.quality * e, 4.0 * e],
            third: [8.0 * arguments.quality * e3, 9.0 * e3],
        })
    }

    /// A value of the second tone; `None` on one tone.
    fn of_tone(&self, value: f64) -> Option<f64> {
        (!self.point.wave.is_sine()).then_some(value)
    }

    fn until_lost(&self) -> Value {
        match self.sum.time_to_loss() {
            Some(periods) => periods.into(),
            None if self.sum.in_gear > 0.0 => "not lost".into(),
            None => Value::Missing,
        }
    }
}

fields! {
    fn named_point(at: NamedPoint<'a>) {
        read POINT => at.name;
        all K.digits(4) => at.point.k;
        read E.titled("e").digits(3) => at.of_tone(at.point.wave.second().amplitude);
        read TH.digits(4) => at.of_tone(at.point.wave.second().angle);
        json E => at.point.wave.second().amplitude;
        json TH => at.point.wave.second().angle;
        json E3 => at.point.wave.third().amplitude;
        json TH3 => at.point.wave.third().angle;
        all IN_GEAR.titled("in gear").digits(3) => at.point.shares.mean();
        all IN_GEAR_LEAST.titled("worst part").digits(3) => at.point.shares.min_share();
        json IN_GEAR_AFTER_CAPTURE => at.sum.share_after_capture();
        all PERIODS_TO_CAPTURE.titled("until captured").digits(3) => at.sum.time_to_capture();
        read IN_GEAR_AFTER_CAPTURE.titled("in gear after").digits(3) => at.sum.share_after_capture();
        read PERIODS_TO_LOSS.titled("until lost (periods)").digits(3) => at.until_lost();
        json PERIODS_TO_LOSS => at.sum.time_to_loss();
        all PERIODS_TO_LOSS_ERROR.titled("error").digits(2) =>
            at.sum.time_to_loss().map(|time| time / (at.sum.losses as f64).sqrt());
        all B.digits(4) => at.amplitude;
        all PEAK.digits(3) => at.peak;
        read FORCE_RATIO_ON_RESONANCE.titled("F2/F1").digits(3) => at.of_tone(at.force[0]);
        json FORCE_RATIO_ON_RESONANCE => at.force[0];
        json FORCE_RATIO_OFF_RESONANCE => at.force[1];
        json THIRD_FORCE_RATIO_ON_RESONANCE => at.third[0];
        json THIRD_FORCE_RATIO_OFF_RESONANCE => at.third[1];
    }
}

fields! {
    /// A point of the map: its wave, k, and the mean and smallest share.
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

fn named<'a>(survey: &'a Survey, arguments: &Arguments) -> Result<Vec<NamedPoint<'a>>, Refusal> {
    let two = if survey.waves.iter().any(|wave| wave.third().amplitude > 0.0) {
        "three tones"
    } else {
        "two tones"
    };
    let points = [
        ("one tone", Some(&survey.one_tone)),
        (two, survey.two_tones.as_ref()),
        ("middle of the band", survey.band_middle.as_ref()),
    ];
    let named = |(name, point)| Some(NamedPoint::new(name, point?, arguments));
    points.into_iter().filter_map(named).collect()
}

fn lot_name(arguments: &Arguments, survey: &Survey) -> String {
    let lot = arguments.restitution;
    let parts = survey.lot.restitutions.len();
    let parts = when(parts > 1, || format!(" ({parts} parts)"));
    format!("R = {}{parts}", span(lot.low(), lot.high(), 6))
}

pub(super) fn report(arguments: &Arguments, survey: &Survey) -> Result<Printout, Refusal> {
    let named = named(survey, arguments)?;
    let view = named_point();
    let lot = arguments.restitution;
    let lot_name = lot_name(arguments, survey);
    let report = view
        .printout(&named)
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
    let unlocked = survey.band_middle.is_none().then_some(
        "Without scatter no amplitude locks all of this lot with one tone: see kband bands.",
    );
    let two = named.iter().find(|named| named.name.ends_with("tones"));
    let second = two.map(|two| {
        format!(
            "The second tone takes {} of the first one's force on a resonance of quality {}, {} off it.",
            number(two.force[0], 3),
            number(arguments.quality, 4),
            number(two.force[1], 3)
        )
    });
    let three = two.filter(|two| two.point.wave.third().amplitude > 0.0);
    let third = three.map(|three| {
        let [on, off] = three.third.map(|force| number(force, 3));
        format!("The third tone takes {on} of it there, {off} off it.")
    });
    let over_k = |wave: usize| -> Json {
        let point = |(k, share)| json!({"k": k, "in_gear": share});
        survey.over_k(wave).map(point).collect()
    };
    let number_of_two =
        two.and_then(|two| survey.waves.iter().position(|wave| *wave == two.point.wave));
    let point = |name: &str| -> Json {
        let mut points = named.iter();
        let matching = points.find(|named| named.name.ends_with(name));
        matching.map_or(Json::Null, |named| view.object(named))
    };
    let json = json!({
        "restitution_low": lot.low(),
        "restitution_high": lot.high(),
        "scatter": arguments.scatter,
        "order": arguments.order,
        "seed": arguments.seed,
        "periods_watched": survey.lot.run_periods(),
        "one_tone": point("one tone"),
        "two_tones": point("tones"),
        "band_middle": point("middle of the band"),
        "over_k": {
            "one_tone": over_k(0),
            "two_tones": number_of_two.map(over_k),
        },
    });
    let count = survey.k.len();
    let points: Vec<_> = (survey.map.iter().enumerate())
        .map(|(n, shares)| (survey.waves[n / count], survey.k[n % count], *shares))
        .collect();
    let csv = map_point().table_of(&points);
    let report = report.notes(unlocked).notes(second).notes(third);
    Ok(report.json(&json)?.csv_of(csv))
}

pub(super) fn picture(arguments: &Arguments, survey: &Survey) -> Picture {
    let low = survey.k.first().copied().unwrap_or(0.0);
    let high = survey.k.last().copied().unwrap_or(1.0);
    let share = Axis::new("share of time in gear", "", 0.0, 1.0);
    let mut over = Panel::new(Axis::new("k", "", low, high), share)
        .heading("Over the amplitude, k = g cos α / (b ω²)")
        .line("one tone", 0, survey.over_k(0).collect());
    if let Some(two) = &survey.two_tones
        && let Some(number) = survey.waves.iter().position(|wave| *wave == two.wave)
    {
        let best = [&survey.one_tone, two].map(|at| (at.k, at.shares.mean()));
        over = over
            .line(&label(&two.wave), 1, survey.over_k(number).collect())
            .markers("best points, fresh runs", 2, best.to_vec());
    }
    if let Some(middle) = &survey.band_middle {
        over = over.mark(middle.k, "middle of the band");
    }
    let mut picture = Picture::new("How much of the time parts are in gear")
        .width(820.0)
        .caption(format!(
            "{}, scatter {}, order {}; from rest, {} runs of {} periods of each part",
            lot_name(arguments, survey),
            number(arguments.scatter, 4),
            arguments.order,
            arguments.runs,
            arguments.periods
        ))
        .panel(over);
    if arguments.tones.second_tone.is_none() {
        let waves = 1..survey.waves.len();
        let shares: Vec<f64> = waves.map(|wave| survey.best_over_k(wave)).collect();
        let (from, to, count) = super::angles(arguments);
        let half = 0.5 * (to - from) / f64::from(count - 1);
        let step = arguments.largest_second_tone / f64::from(super::SECOND_TONE_AMPLITUDES);
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

fn label(wave: &Wave) -> String {
    let second = wave.second();
    let [e, th] = [second.amplitude, second.angle].map(|value| number(value, 4));
    format!("e = {e}, th = {th}")
}
