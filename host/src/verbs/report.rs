//! `kband report`: an interactive page (HTML) of one feeder.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use kband::feeder::{Restitution, Track, throw_number};
use kband::impact::{ContactTime, Tone, Wave};
use kband::regime::band::{self, Band};
use kband::regime::classify::Regime;
use serde_json::{Map, Value as Json, json};

use crate::desk::Desk;
use crate::ending::{self, Endings, FILLS, MAX_ORBIT_IMPACTS};
use crate::file::Destination;
use crate::page::{self, Page};
use crate::picture::Fill;
use crate::provenance;
use crate::refusal::{Exit, Result};
use crate::report::{counted, number};
use crate::simulate::{
    Outcome, STATE_FILLS, SceneText, Watch, part_group, run_watched, state_fill,
};
use crate::verbs::map::{basins, gear::Lot, transport};

/// Write one self-contained page for the browser: bands, gear, basins, speed and a run of a feeder,
/// with sliders.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband report
  kband report my.toml --out my.html

The page is one file. It needs no other file and no network, can be printed, and follows the \
browser's light or dark theme. The values behind its sliders are computed beforehand on a grid, and \
are in the page as JSON.")]
pub struct Arguments {
    /// Scene file (TOML), `-` for standard input; without one, the default scene.
    #[arg(value_name = "SCENE.toml")]
    scene: Option<PathBuf>,
    /// Page to write, .html [default: kband-report.html]. A named file is overwritten, the default
    /// only if kband wrote it.
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
}

const FIGURES: &str = include_str!("report/figures.js");
/// Figures of the page, one a line: heading of their section, name, caption.
const SECTIONS: &str = include_str!("report/sections.tsv");

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let read = SceneText::read(arguments.scene.as_deref())?;
    let scene = read.scene(&read.table)?;
    let target = match &arguments.out {
        Some(path) => Destination::output(path, "html")?,
        None => {
            Destination::default_name(Path::new("kband-report.html"), page::own, "--out FILE.html")?
        }
    };
    target.ends_in("--out", &["html", "htm"])?;
    let fidelity = scene.fidelity.unwrap_or_default();
    let outcome = run_watched(&scene, fidelity, Watch::FOR_PICTURE, desk)?;
    let feeder = Feeder::from_outcome(&outcome)?;
    let written = toml::to_string(&read.table).unwrap_or_default();
    let page = page(&feeder, &outcome, &written, desk)?;
    target.write_bytes(page.to_html().as_bytes())?;
    eprintln!("{}", target.describe_write());
    Ok(Exit::Done)
}

fn page(feeder: &Feeder, outcome: &Outcome, written: &str, desk: &Desk) -> Result<Page> {
    let data = all(feeder, outcome, desk)?;
    let heads = [
        "order",
        "b / mm",
        "setpoint / mm",
        "margin / %",
        "throw number",
        "peak / g",
    ];
    let mut spoken = super::simulate::plain_words(outcome);
    if !feeder.contact.is_instant() {
        spoken.push(
            "The figure of bands below is that of impacts in no time. The others have the contact time of \
             the scene."
                .into(),
        );
    }
    let provenance = format!("{:#}", data["provenance"]);
    let text = page::paragraphs(&spoken)
        + &page::table(&heads, &feeder.bands_in_words())
        + &page::folded("the scene", written)
        + &page::folded("how this page was made", &provenance);
    let title = format!("A feeder at {} Hz", number(feeder.track.frequency(), 6));
    let mut page = Page::new(&title, data, FIGURES).section("In plain words", &text);
    let lines = SECTIONS.lines().filter_map(|line| line.split_once('\t'));
    let lines: Vec<(&str, &str)> = lines.collect();
    for section in lines.chunk_by(|one, other| one.0 == other.0) {
        let figures = section
            .iter()
            .filter_map(|(_, figure)| figure.split_once('\t'));
        let figures: String = figures
            .map(|(name, caption)| page::figure(name, caption))
            .collect();
        page = page.section(section[0].0, &figures);
    }
    Ok(page)
}

/// Number of restitutions in the diagram of bands, 0..0.7 in steps of 0.005.
const RESTITUTIONS: usize = 141;
const RESTITUTION_STEP: f64 = 0.005;
/// Largest order in the diagram of bands.
const ORDERS: u32 = 3;
/// Resolution of the gear map: amplitudes, parts of the lot, their runs, and their drive periods.
const GEAR_AMPLITUDES: usize = 41;
const GEAR_PARTS: usize = 5;
const GEAR_RUNS: usize = 8;
const GEAR_PERIODS: f64 = 250.0;
/// The second tone of the page if the drive has none.
const SECOND_TONE: Tone = Tone::new(0.15, 2.356);
/// Number of maps of basins, of cells along a side, and velocity at the upper edge in `b w`.
const BASIN_MAPS: usize = 21;
const BASIN_SIDE: usize = 80;
const BASIN_VELOCITY: f64 = 3.0;
/// Impacts after which a start is undecided; the page has 130 000 starts.
const BASIN_IMPACTS: usize = MAX_ORBIT_IMPACTS / 20;
const THROWS: &str = "0.3..3.5:81";
const FRICTIONS: [f64; 10] = [0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0];
/// Scatters at which the gear map is computed.
const SCATTERS: [f64; 8] = [0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.15];
const MAX_DRAWN_IMPACTS: usize = 1500;

struct Feeder {
    track: Track,
    lot: Restitution,
    scatter: f64,
    friction: Option<f64>,
    order: u32,
    second: Tone,
    contact: ContactTime,
}

impl Feeder {
    fn from_outcome(outcome: &Outcome) -> Result<Self> {
        let scene = &outcome.file().scene;
        let settings = &scene.settings;
        Ok(Self {
            track: settings.track()?,
            lot: settings.lot()?,
            scatter: f64::from(scene.scatter.iter().copied().fold(0.0, f32::max)),
            friction: scene.friction.map(|[sliding, _]| f64::from(sliding)),
            order: outcome.gear_order(),
            contact: settings.contact_time(),
            second: Tone {
                amplitude: match settings.second_tone {
                    0.0 => SECOND_TONE.amplitude,
                    amplitude => amplitude.into(),
                },
                ..SECOND_TONE
            },
        })
    }

    fn millimetres(&self, k: f64) -> f64 {
        short(1e3 * self.track.amplitude(k))
    }

    fn bands_in_words(&self) -> Vec<Vec<String>> {
        let mm = |k: f64| number(self.millimetres(k), 4);
        let cells = |order: u32| {
            let Ok(band) = Band::common_with_contact(self.lot, order, self.contact) else {
                return vec![order.to_string(), "none for the whole lot".into()];
            };
            let k = band.setpoint();
            vec![
                order.to_string(),
                format!("{} to {}", mm(band.high()), mm(band.low())),
                mm(k),
                number(100.0 * band.margins(k).smallest(), 3),
                number(throw_number(k), 4),
                number(self.track.acceleration(self.track.amplitude(k)), 3),
            ]
        };
        (1..=ORDERS).map(cells).collect()
    }
}

/// Rounds to six significant digits: more than a picture shows, in a third of the characters.
fn short(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let scale = 10_f64.powi(5 - value.abs().log10().floor() as i32);
    (value * scale).round() / scale
}

fn shorts(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    values.into_iter().map(short).collect()
}

fn pairs(points: Vec<(f64, f64)>, scale: f64) -> Vec<[f64; 2]> {
    let points = points.into_iter();
    points.map(|(x, y)| [short(x), short(scale * y)]).collect()
}

/// Numbers of the page over the values of its sliders: b, `b w`, rad, speeds in mm/s.
fn all(feeder: &Feeder, outcome: &Outcome, desk: &Desk) -> Result<Json> {
    let settings = &outcome.file().scene.settings;
    Ok(json!({
        "provenance": provenance::object(Map::new()),
        "feeder": {
            "frequency_hz": short(feeder.track.frequency()),
            "incline_degrees": short(feeder.track.incline().to_degrees()),
            "gravity_m_s2": short(f64::from(settings.gravity)),
            "restitution_low": short(feeder.lot.low()),
            "restitution_high": short(feeder.lot.high()),
            "scatter": short(feeder.scatter),
            "friction": feeder.friction.map(short),
            "order": feeder.order,
        },
        "fills": Fill::ALL.map(|fill| FILLS.iter().find(|(entry, _)| *entry == fill).map(|(_, name)| *name)),
        "bands": bands()?,
        "gear": gear(feeder, desk)?,
        "basins": basin_maps(feeder, desk)?,
        "transport": speeds(feeder, desk)?,
        "run": traced(outcome),
    }))
}

/// The bands of single restitutions in k, which do not depend on the drive.
fn bands() -> Result<Json> {
    let restitution = |n: usize| (n as f64 * RESTITUTION_STEP * 1e3).round() / 1e3;
    let mut orders = Vec::new();
    for order in 1..=ORDERS {
        let (mut low, mut high) = (Vec::new(), Vec::new());
        for n in 0..RESTITUTIONS {
            // A lot's band is from the flip of its liveliest part to the birth of its deadest.
            low.push(band::flip(restitution(n), order)?);
            high.push(band::first_return_edge(restitution(n), order)?);
        }
        orders.push(json!({"order": order, "k_low": low, "k_high": high}));
    }
    Ok(json!({
        "restitution": (0..RESTITUTIONS).map(restitution).collect::<Vec<_>>(),
        "orders": orders,
    }))
}

/// Ascending values with one value inserted, and its index.
fn insert(values: &[f64], one: f64) -> (Vec<f64>, usize) {
    let mut values = values.to_vec();
    let place = values.partition_point(|value| *value < one - 1e-6);
    let other = |value: &f64| (value - one).abs() > 1e-6;
    if values.get(place).is_none_or(other) {
        values.insert(place, short(one));
    }
    (values, place)
}

fn gear(feeder: &Feeder, desk: &Desk) -> Result<Json> {
    let order = feeder.order;
    let birth = band::birth(feeder.lot.high().min(0.99), order)?;
    let [low, highest] = [0.15, 1.0].map(|k| k / f64::from(order));
    let high = (1.02 * birth).min(highest);
    let last = (GEAR_AMPLITUDES - 1) as f64;
    // From the smallest amplitude to the largest.
    let place = |n: usize| high + (low - high) * n as f64 / last;
    let k: Vec<f64> = (0..GEAR_AMPLITUDES).map(place).collect();
    let (scatters, at) = insert(&SCATTERS, feeder.scatter);
    let waves = [Wave::sine(), Wave::build(feeder.second, Tone::default())?];
    let lot = Lot {
        restitution: feeder.lot,
        parts: GEAR_PARTS,
        scatter: feeder.scatter,
        order,
        runs: GEAR_RUNS,
        periods: GEAR_PERIODS,
        seed: 1,
        contact: feeder.contact,
    };
    let count = waves.len() * scatters.len() * k.len();
    let shares = desk.try_map("gear", count, |n| {
        let (rest, place) = (n / k.len(), k[n % k.len()]);
        let scatter = scatters[rest % scatters.len()];
        Lot { scatter, ..lot }.at(&waves[rest / scatters.len()], place)
    })?;
    let curve = |curve: &[[f64; 2]]| {
        let [mean, min] = [0, 1].map(|n| shorts(curve.iter().map(|share| share[n])));
        json!({"mean": mean, "least": min})
    };
    let curves: Vec<Json> = shares.chunks(k.len()).map(curve).collect();
    let curves: Vec<&[Json]> = curves.chunks(scatters.len()).collect();
    Ok(json!({
        "amplitude_mm": k.iter().map(|&k| feeder.millimetres(k)).collect::<Vec<_>>(),
        "k": shorts(k.iter().copied()),
        "scatter": scatters,
        "scatter_of_the_lot": at,
        "second_tone": feeder.second.amplitude,
        "second_tone_angle_rad": feeder.second.angle,
        "periods": GEAR_PERIODS,
        "runs": GEAR_RUNS,
        "one_tone": curves[0],
        "two_tones": curves[1],
    }))
}

fn basin_maps(feeder: &Feeder, desk: &Desk) -> Result<Json> {
    let (restitution, order) = (feeder.lot.middle().min(0.95), feeder.order);
    let flip = band::flip(restitution, order)?;
    let birth = band::first_return_edge(restitution, order)?;
    let (from, to) = (0.9 / birth, 1.25 / flip);
    let mut maps = Vec::new();
    for n in 0..BASIN_MAPS {
        let k = 1.0 / (from + (to - from) * n as f64 / (BASIN_MAPS - 1) as f64);
        let endings = Endings::with_contact(k, restitution, BASIN_IMPACTS, feeder.contact)?;
        let ends = basins::ends(&endings, BASIN_SIDE, BASIN_VELOCITY, desk)?;
        let sign = |end: &Regime| char::from(b'0' + ending::fill(*end) as u8);
        let signs: String = ends.iter().map(sign).collect();
        let name = |end: &Regime| ending::describe_regime(*end, BASIN_IMPACTS);
        let mut shares = counted(ends.iter().map(name));
        shares.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let share = |(name, count): &(String, usize)| json!({"regime": name, "share": short(*count as f64 / ends.len() as f64)});
        let shares: Vec<Json> = shares.iter().map(share).collect();
        maps.push(json!({
            "k": short(k),
            "amplitude_mm": feeder.millimetres(k),
            "from_rest": ending::describe_regime(endings.from_rest(), BASIN_IMPACTS),
            "locks": endings.locks().map(|lock| [short(lock.state().phase), short(lock.state().velocity)]).collect::<Vec<_>>(),
            "shares": shares,
            "signs": signs,
        }));
    }
    Ok(json!({
        "restitution": short(restitution),
        "side": BASIN_SIDE,
        "velocity_top": BASIN_VELOCITY,
        "phase_top": short(TAU),
        "band_mm": [feeder.millimetres(birth), feeder.millimetres(flip)],
        "maps": maps,
    }))
}

fn speeds(feeder: &Feeder, desk: &Desk) -> Result<Json> {
    let (frictions, at) = insert(&FRICTIONS, feeder.friction.unwrap_or(0.3));
    let track = &feeder.track;
    let mut curves = Vec::new();
    for friction in &frictions {
        let rows = transport::from_rest(
            &format!(
                "--restitution {} --friction {friction} --throw {THROWS} --frequency {} --incline={} --amplitude-ratio {} \
                 --phase-lead={} --impacts 300 --settle 300 --contact {}",
                feeder.lot.middle().min(0.95),
                track.frequency(),
                track.incline().to_degrees(),
                track.amplitude_ratio(),
                track.phase_lead().to_degrees(),
                1e3 * feeder.contact.radians() / (TAU * track.frequency()),
            ),
            desk,
        )?;
        let row = |at: &transport::Row| {
            let (throw, amplitude) = (short(at.throw()), short(at.amplitude()));
            json!([throw, amplitude, at.speed().map(short), at.regime()])
        };
        let rows: Vec<Json> = rows.iter().map(row).collect();
        curves.push(json!({"friction": friction, "rows": rows}));
    }
    Ok(json!({
        "restitution": short(feeder.lot.middle().min(0.95)),
        "friction": frictions,
        "friction_of_the_scene": at,
        "given": feeder.friction.is_some(),
        "columns": ["throw", "amplitude_mm", "speed_mm_s", "regime"],
        "curves": curves,
    }))
}

fn traced(outcome: &Outcome) -> Json {
    let Some(sketch) = &outcome.record().sketch else {
        return Json::Null;
    };
    let end = sketch.time;
    let states = &sketch.states;
    let ribbon = states.iter().enumerate().map(|(n, (from, state))| {
        let until = states.get(n + 1).map_or(end, |next| next.0);
        let fill = state_fill(*state) as u8;
        json!([short(*from), short(until), fill, state.name()])
    });
    let event = |at: kband_scene::TimedEvent| json!([short(at.time), at.name()]);
    let impacts = &sketch.impacts;
    let stride = impacts.len().div_ceil(MAX_DRAWN_IMPACTS).max(1);
    let kinds = part_group(&outcome.file().scene.parts);
    let parts = kinds.iter().map(|part_group| {
        let own = impacts
            .iter()
            .filter(|(_, strike)| part_group.parts.contains(&strike.part));
        let chosen = own.step_by(stride);
        let chosen = chosen.map(|(time, strike)| [*time, strike.phase, strike.speed].map(short));
        json!({"name": part_group.name, "impacts": chosen.collect::<Vec<_>>()})
    });
    json!({
        "duration_s": short(end),
        "amplitude_mm": pairs(sketch.amplitude.drawn(), 1e3),
        "reference_mm": pairs(sketch.reference.drawn(), 1e3),
        "k": pairs(sketch.k.drawn(), 1.0),
        "in_gear_estimated": pairs(sketch.in_gear.drawn(), 1.0),
        "in_gear_true": outcome.in_gear().map(short),
        "lock_phase_rad": outcome.expected_phase().filter(|_| outcome.last().shape.is_sine()).map(short),
        "states": ribbon.collect::<Vec<_>>(),
        "state_fills": Fill::ALL.map(|fill| STATE_FILLS.iter().find(|(entry, _)| *entry == fill).map(|(_, name)| *name)),
        "events": outcome.events().map(event).collect::<Vec<_>>(),
        "parts": parts.collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shortened_numbers_keep_six_digits() {
        assert_eq!(short(0.123_456_789), 0.123_457);
        assert_eq!(short(-98_765.432_1), -98_765.4);
        assert_eq!((short(0.0), short(50.0), short(3.0)), (0.0, 50.0, 3.0));
        assert!(short(f64::NAN).is_nan());
    }

    #[test]
    fn a_value_takes_its_place_once() {
        assert_eq!(insert(&[0.1, 0.3], 0.2), (vec![0.1, 0.2, 0.3], 1));
        assert_eq!(insert(&[0.1, 0.3], f64::from(0.3_f32)), (vec![0.1, 0.3], 1));
        assert_eq!(insert(&[0.1], 0.4), (vec![0.1, 0.4], 1));
    }
}
