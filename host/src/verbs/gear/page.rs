//! Gear as table, JSON and picture.

use kband::impact::Wave;
use kband::regime::gear::Share;
use serde_json::{Value as Json, json};

use super::Arguments;
use super::survey::{Point, Survey};
use crate::picture::{Axis, Grid, Panel, Picture, Unit};
use crate::refusal::Refusal;
use crate::report::{Printout, Table, Value, columns, number};

/// Requirements of a point on the drive.
struct Price {
    /// Amplitude in mm.
    amplitude: f64,
    /// Largest acceleration normal to the track in g.
    peak: f64,
    /// Force of the second tone over that of the first: on a resonance, and far above any.
    force: [f64; 2],
    /// The same for the third tone.
    third: [f64; 2],
}

fn price(arguments: &Arguments, point: &Point) -> Result<Price, Refusal> {
    let track = arguments.drive.track()?;
    let amplitude = track.amplitude(point.k);
    let [e, e3] = [point.wave.second(), point.wave.third()].map(|tone| tone.amplitude);
    Ok(Price {
        amplitude: 1e3 * amplitude,
        peak: track.acceleration(amplitude) * point.wave.peak_acceleration(),
        // The dynamic stiffness of a resonator is |1 - (w/w0)^2|: 1/Q at resonance, 3 at twice and
        // 8 at three times it. That of a mass grows as w^2.
        force: [3.0 * arguments.quality * e, 4.0 * e],
        third: [8.0 * arguments.quality * e3, 9.0 * e3],
    })
}

fn named(survey: &Survey) -> impl Iterator<Item = (&'static str, &Point)> {
    [
        ("one tone", Some(&survey.one_tone)),
        (
            if survey.waves.iter().any(|wave| wave.third().amplitude > 0.0) {
                "three tones"
            } else {
                "two tones"
            },
            survey.two_tones.as_ref(),
        ),
        ("middle of the band", survey.band_middle.as_ref()),
    ]
    .into_iter()
    .filter_map(|(name, point)| point.map(|point| (name, point)))
}

fn point_json(arguments: &Arguments, point: &Point) -> Result<Json, Refusal> {
    let price = price(arguments, point)?;
    let sum = point.shares.sum();
    Ok(json!({
        "k": point.k,
        "e": point.wave.second().amplitude,
        "th": point.wave.second().angle,
        "e3": point.wave.third().amplitude,
        "th3": point.wave.third().angle,
        "in_gear": point.shares.mean(),
        "in_gear_least": point.shares.least(),
        "in_gear_after_capture": sum.share_after_capture(),
        "periods_to_capture": sum.time_to_capture(),
        "periods_to_loss": sum.time_to_loss(),
        "periods_to_loss_error": loss_error(&sum),
        "b": price.amplitude,
        "peak": price.peak,
        "force_ratio_on_resonance": price.force[0],
        "force_ratio_off_resonance": price.force[1],
        "third_force_ratio_on_resonance": price.third[0],
        "third_force_ratio_off_resonance": price.third[1],
    }))
}

/// The parts in words.
fn who(survey: &Survey) -> String {
    match survey.lot.restitutions.as_slice() {
        [] => String::new(),
        [one] => format!("R = {}", number(*one, 6)),
        [low, .., high] => format!(
            "R = {}..{} ({} parts)",
            number(*low, 6),
            number(*high, 6),
            survey.lot.restitutions.len()
        ),
    }
}

fn until_lost(sum: &Share) -> Value {
    match sum.time_to_loss() {
        Some(periods) => periods.into(),
        None if sum.in_gear > 0.0 => "not lost".into(),
        None => Value::Missing,
    }
}

/// Standard error of the time to a loss.
fn loss_error(sum: &Share) -> Option<f64> {
    Some(sum.time_to_loss()? / (sum.losses as f64).sqrt())
}

pub(super) fn report(arguments: &Arguments, survey: &Survey) -> Result<Printout, Refusal> {
    let mut table = Table::new(&[
        columns::POINT,
        columns::K.digits(4),
        columns::E.titled("e").digits(3),
        columns::TH.digits(4),
        columns::IN_GEAR.titled("in gear").digits(3),
        columns::IN_GEAR_LEAST.titled("worst part").digits(3),
        columns::PERIODS_TO_CAPTURE
            .titled("until captured")
            .digits(3),
        columns::IN_GEAR_AFTER_CAPTURE
            .titled("in gear after")
            .digits(3),
        columns::PERIODS_TO_LOSS
            .titled("until lost (periods)")
            .digits(3),
        columns::PERIODS_TO_LOSS_ERROR.titled("error").digits(2),
        columns::B.digits(4),
        columns::PEAK.digits(3),
        columns::FORCE_RATIO_ON_RESONANCE.titled("F2/F1").digits(3),
    ])
    .folded();
    for (name, point) in named(survey) {
        let price = price(arguments, point)?;
        let second = point.wave.second();
        let alone = point.wave.is_sine();
        let sum = point.shares.sum();
        let of_tone = |value: f64| if alone { Value::Missing } else { value.into() };
        table.push([
            name.into(),
            point.k.into(),
            of_tone(second.amplitude),
            of_tone(second.angle),
            point.shares.mean().into(),
            point.shares.least().into(),
            sum.time_to_capture().into(),
            sum.share_after_capture().into(),
            until_lost(&sum),
            loss_error(&sum).into(),
            price.amplitude.into(),
            price.peak.into(),
            of_tone(price.force[0]),
        ]);
    }
    let lot = arguments.restitution;
    let who = who(survey);
    let mut report = Printout::new(table)
        .heading(format!(
            "Share of time in gear of order {}, {who}, scatter {}, from rest, {} Hz{}",
            arguments.order,
            number(arguments.scatter, 6),
            number(arguments.drive.frequency, 6),
            arguments.contact.words()
        ))
        .note(format!(
            "Each part was watched for {} periods at each of these points.",
            number(survey.lot.watched(), 6)
        ));
    if survey.band_middle.is_none() {
        report = report.note(
            "Without scatter no amplitude locks all of this lot with one tone: see kband bands.",
        );
    }
    if let Some(two) = &survey.two_tones {
        let price = price(arguments, two)?;
        report = report.note(format!(
            "The second tone takes {} of the first one's force on a resonance of quality {}, {} off it.",
            number(price.force[0], 3),
            number(arguments.quality, 4),
            number(price.force[1], 3)
        ));
        if two.wave.third().amplitude > 0.0 {
            report = report.note(format!(
                "The third tone takes {} of it there, {} off it.",
                number(price.third[0], 3),
                number(price.third[1], 3)
            ));
        }
    }
    let best = named(survey)
        .map(|(_, point)| &point.shares)
        .max_by(|a, b| a.mean().total_cmp(&b.mean()));
    if let Some(shares) = best
        && shares.least() < 0.5
        && survey.lot.restitutions.len() > 1
    {
        report = report.note(match served(survey, shares) {
            Some((low, high)) => format!(
                "This lot is too wide for one amplitude: at the best point parts of R = {}..{} are in gear \
                 nine tenths of the time or more.",
                number(low, 4),
                number(high, 4)
            ),
            None => "No part of this lot is in gear nine tenths of the time; less scatter, or a second \
                     tone (--largest-second-tone), would help."
                .into(),
        });
    }
    let over_k = |wave: usize| -> Vec<Json> {
        survey
            .over_k(wave)
            .map(|(k, share)| json!({"k": k, "in_gear": share}))
            .collect()
    };
    let two = survey.two_tones.as_ref();
    let number_of_two =
        two.and_then(|point| survey.waves.iter().position(|wave| *wave == point.wave));
    let optional = |point: Option<&Point>| -> Result<Json, Refusal> {
        point.map_or(Ok(Json::Null), |point| point_json(arguments, point))
    };
    let json = json!({
        "restitution_low": lot.low(),
        "restitution_high": lot.high(),
        "scatter": arguments.scatter,
        "order": arguments.order,
        "seed": arguments.seed,
        "periods_watched": survey.lot.watched(),
        "one_tone": point_json(arguments, &survey.one_tone)?,
        "two_tones": optional(two)?,
        "band_middle": optional(survey.band_middle.as_ref())?,
        "over_k": {
            "one_tone": over_k(0),
            "two_tones": number_of_two.map(over_k),
        },
    });
    let rows = rows(survey);
    let columns = [
        columns::E.titled("e"),
        columns::TH,
        columns::E3,
        columns::TH3,
        columns::K,
        columns::IN_GEAR,
        columns::IN_GEAR_LEAST,
    ];
    Ok(report.json(&json)?.csv(&columns, move |out| {
        rows.iter()
            .try_for_each(|row| out.row(&row.map(Value::from)))
    }))
}

/// The parts in a row, by restitution, that are in gear nine tenths of the time.
fn served(survey: &Survey, shares: &super::survey::Shares) -> Option<(f64, f64)> {
    let mut best: Option<(usize, usize)> = None;
    let mut begin = None;
    for (n, share) in shares.0.iter().enumerate() {
        if share.share() < 0.9 {
            begin = None;
            continue;
        }
        let from = *begin.get_or_insert(n);
        if best.is_none_or(|(low, high)| high - low < n - from) {
            best = Some((from, n));
        }
    }
    best.map(|(low, high)| (survey.lot.restitutions[low], survey.lot.restitutions[high]))
}

/// The whole map, row by row.
fn rows(survey: &Survey) -> Vec<[f64; 7]> {
    let count = survey.k.len();
    (0..survey.map.len())
        .map(|n| {
            let wave = &survey.waves[n / count];
            let [share, least] = survey.map[n];
            let (second, third) = (wave.second(), wave.third());
            [
                second.amplitude,
                second.angle,
                third.amplitude,
                third.angle,
                survey.k[n % count],
                share,
                least,
            ]
        })
        .collect()
}

pub(super) fn picture(arguments: &Arguments, survey: &Survey) -> Picture {
    let (low, high) = (
        survey.k.first().copied().unwrap_or(0.0),
        survey.k.last().copied().unwrap_or(1.0),
    );
    let mut over = Panel::new(
        Axis::new("k", Unit::NONE, low, high),
        Axis::new("share of time in gear", Unit::NONE, 0.0, 1.0),
    )
    .heading("Over the amplitude, k = g cos α / (b ω²)")
    .line("one tone", 0, survey.over_k(0).collect());
    if let Some(two) = &survey.two_tones
        && let Some(number) = survey.waves.iter().position(|wave| *wave == two.wave)
    {
        over = over
            .line(&words(&two.wave), 1, survey.over_k(number).collect())
            .markers(
                "best points, fresh runs",
                2,
                vec![
                    (survey.one_tone.k, survey.one_tone.shares.mean()),
                    (two.k, two.shares.mean()),
                ],
            );
    }
    if let Some(middle) = &survey.band_middle {
        over = over.mark(middle.k, "middle of the band");
    }
    let mut picture = Picture::new("How much of the time parts are in gear")
        .width(820.0)
        .caption(format!(
            "{}, scatter {}, order {}; from rest, {} runs of {} periods of each part",
            who(survey),
            number(arguments.scatter, 4),
            arguments.order,
            arguments.runs,
            arguments.periods
        ))
        .panel(over);
    if arguments.second_tone.is_none() {
        let shares = (1..survey.waves.len())
            .map(|wave| survey.best_over_k(wave))
            .collect();
        let (from, to, count) = super::angles(arguments);
        let half = 0.5 * (to - from) / f64::from(count - 1);
        let step = arguments.largest_second_tone / f64::from(super::SECOND_TONE_AMPLITUDES);
        picture = picture.panel(
            Panel::new(
                Axis::new(
                    "angle th of the second tone",
                    Unit::RADIANS,
                    from - half,
                    to + half,
                ),
                Axis::new(
                    "amplitude e of the second tone",
                    Unit::NONE,
                    0.5 * step,
                    arguments.largest_second_tone + 0.5 * step,
                ),
            )
            .heading("Over the second tone, each at its best k")
            .heat(
                Grid::new(count as usize, shares),
                Axis::new("in gear", Unit::NONE, 0.0, 1.0),
            ),
        );
    }
    picture
}

fn words(wave: &Wave) -> String {
    let second = wave.second();
    format!(
        "e = {}, th = {}",
        number(second.amplitude, 4),
        number(second.angle, 4)
    )
}
