//! One scene with one tone and with a second one, side by side.

use kband::control::{Shape, Target, UpperTone};
use kband::feeder::STANDARD_GRAVITY;
use serde_json::{Value as Json, json};
use toml::{Table as Toml, Value as Entry};

use super::Arguments;
use crate::desk::Desk;
use crate::file::Destination;
use crate::refusal::{Exit, Refusal};
use crate::report::{Printout, Table, columns};
use crate::simulate::{Outcome, SceneFile, Watch, draw};

/// Smallest second tone that is one.
pub(super) const LEAST: f64 = 0.01;

/// Runs a scene without a second tone and with one of up to `most` of the first, and draws both
/// side by side.
pub(super) fn run(
    arguments: &Arguments,
    table: &Toml,
    most: f64,
    picture: &Destination,
    desk: &Desk,
) -> Result<Exit, Refusal> {
    let named = |most: f64| -> Result<Outcome, Refusal> {
        let mut table = table.clone();
        let drive = table
            .entry("drive")
            .or_insert_with(|| Entry::Table(Toml::new()));
        if let Entry::Table(drive) = drive {
            drive.insert("second_tone".into(), Entry::Float(most));
            // A third tone of the scene counts as one of those compared: it needs the second.
            if most < LEAST {
                drive.insert("third_tone".into(), Entry::Float(0.0));
            }
        }
        let mut file = SceneFile::from_table(table)?;
        arguments.adapt(&mut file);
        file.check()?;
        if !matches!(file.scene.target, Target::Gear { .. }) {
            return Err(Refusal::value(
                "--compare-second-tone",
                "(with another target)",
                "a scene whose [target] is gear, which chooses the second tone by itself",
                "say gear = 1 under [target] in the scene",
            ));
        }
        let fidelity = arguments.fidelity(&file)?;
        Outcome::watched(&file, fidelity, Watch::DRAWN, desk)
    };
    let (one, two) = (named(0.0)?, named(most)?);
    let drawn = |outcome: &Outcome, title: &str| {
        let share = outcome
            .in_gear()
            .map_or(String::new(), |share| format!(": in gear {share:.3}"));
        draw(outcome).map(|picture| picture.titled(format!("{title}{share}")).width(720.0))
    };
    let title = title(two.last().shape);
    if let (Some(left), Some(right)) = (drawn(&one, "One tone"), drawn(&two, &title)) {
        arguments.look.write(picture, &left.beside(right))?;
    }
    let mut rows = Table::new(&[
        columns::SECOND_TONE
            .titled("second_tone (afforded)")
            .digits(3),
        columns::IN_GEAR.digits(3),
        columns::IN_GEAR_HEARD.digits(3),
        columns::IN_GEAR_TOLD.digits(3),
        columns::IN_GEAR_EXPECTED.titled("expected").digits(3),
        columns::B.digits(4),
        columns::K.digits(4),
        columns::E.titled("e").digits(3),
        columns::TH.digits(4),
        columns::E3.titled("e3").digits(3),
        columns::TH3.digits(4),
        columns::PEAK.digits(3),
        columns::SPEED.digits(4),
    ]);
    for (most, outcome) in [(0.0, &one), (most, &two)] {
        let Shape { second, third } = outcome.last().shape;
        let phase = |tone: UpperTone| {
            (f64::from(tone.ratio) >= LEAST)
                .then(|| f64::from(tone.phase))
                .into()
        };
        rows.push([
            most.into(),
            outcome.in_gear().into(),
            outcome.record().in_gear_heard().into(),
            outcome.record().in_gear_told().into(),
            f64::from(outcome.last().expected_in_gear).into(),
            (outcome.amplitude() * 1e3).into(),
            outcome.k().into(),
            f64::from(second.ratio).into(),
            phase(second),
            f64::from(third.ratio).into(),
            phase(third),
            peak(outcome).into(),
            (outcome.speed() * 1e3).into(),
        ]);
    }
    let json = json!({ "one_tone": json_of(&one), "two_tones": json_of(&two) });
    Printout::new(rows)
        .heading("With one tone and with the tones above it, from 5 s on where it is in gear")
        .note(format!("picture          {}", picture.path().display()))
        .json(&json)?
        .print(arguments.format)?;
    Ok(Exit::Done)
}

/// What the tones of a run are.
fn title(shape: Shape) -> String {
    let tone = |name: &str, tone: UpperTone| {
        let (ratio, phase) = (tone.ratio, tone.phase.to_degrees());
        format!("{name} {ratio:.3} at {phase:.0}\u{b0}")
    };
    let sounds = |tone: UpperTone| f64::from(tone.ratio) >= LEAST;
    let second = tone("e", shape.second);
    match (sounds(shape.second), sounds(shape.third)) {
        (false, _) => "The drive affords no second tone".into(),
        (true, false) => format!("Two tones, {second}"),
        (true, true) => format!("Three tones, {second}, {}", tone("e3", shape.third)),
    }
}

/// Largest acceleration of the track in g.
fn peak(outcome: &Outcome) -> f64 {
    let settings = &outcome.file().scene.settings;
    let rate = std::f64::consts::TAU * f64::from(settings.frequency);
    let [_, peak] = outcome.last().shape.peaks();
    outcome.amplitude() * rate * rate * f64::from(peak) / STANDARD_GRAVITY
}

fn json_of(outcome: &Outcome) -> Json {
    let last = outcome.last();
    json!({
        "in_gear": outcome.in_gear(),
        "in_gear_heard": outcome.record().in_gear_heard(),
        "in_gear_told": outcome.record().in_gear_told(),
        "in_gear_expected": last.expected_in_gear,
        "b": outcome.amplitude() * 1e3,
        "k": outcome.k(),
        "e": last.shape.second.ratio,
        "th": last.shape.second.phase,
        "e3": last.shape.third.ratio,
        "th3": last.shape.third.phase,
        "peak": peak(outcome),
        "speed": outcome.speed() * 1e3,
    })
}
