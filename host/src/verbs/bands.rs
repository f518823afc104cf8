//! `kband bands`: where parts lock, order by order.

mod picture;
mod tones;

use kband::feeder::{Restitution, Track, throw_number};
use kband::impact::{TangentialSettings, Tone, Wave};
use kband::regime::band::{Band, BandError};
use kband::regime::cascade::{Cascade, Estimate};
use kband::regime::reach::Reach;

use crate::arguments::{self, Drawn, DriveArguments, Printed};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use crate::report::{Column, Printout, Table, Value, columns};

/// Bands of k and of amplitude where parts lock, for one restitution or a whole lot of parts.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband bands --restitution 0.2 --orders 3 --frequency 50 --incline 3
  kband bands --restitution 0.18..0.22 --format json
  kband bands --restitution 0.10..0.30 --second-tone 0.15,2.356 --orders 1 --out bands.svg

k2..k1 is the band that all parts share. chaos_edge is where the doublings of the liveliest part \
pile up; reachable_edge is how far up from k2 every part really locks when it starts from rest.

With a second tone the track moves as sin t + e sin(2 t + th), th in rad (135 degrees are 2.356); an order may then \
have several bands.")]
pub struct Arguments {
    /// Restitution of the part, or LO..HI of the lot.
    #[arg(long, value_name = "R|LO..HI", default_value = "0.2", value_parser = arguments::restitution)]
    restitution: Restitution,

    /// Orders to show, 1 to N.
    #[arg(long, value_name = "N", default_value = "3", value_parser = arguments::count(1, 20))]
    orders: usize,

    /// Second tone of the drive, E of the first one's amplitude at the angle TH in rad.
    #[arg(long, value_name = "E,TH", value_parser = arguments::tone)]
    second_tone: Option<Tone>,

    /// Third tone, E3 sin(3 t + TH3).
    #[arg(long, value_name = "E3,TH3", value_parser = arguments::tone)]
    third_tone: Option<Tone>,

    #[command(flatten)]
    drive: DriveArguments,

    #[command(flatten)]
    printed: Printed,

    #[command(flatten)]
    drawn: Drawn,
}

/// Restitution along the track (symbol Rt), and amplitude along it over that normal to it (symbol
/// eta), of the built-in scene: with these speeds are told.
const TANGENTIAL_RESTITUTION: f64 = 0.3;
const AMPLITUDE_RATIO: f64 = 1.5;

/// What parts meet along the track.
fn along(track: &Track) -> TangentialSettings {
    TangentialSettings {
        amplitude_ratio: AMPLITUDE_RATIO,
        ..TangentialSettings::on(track, TANGENTIAL_RESTITUTION)
    }
}

/// Values of k that are tried from rest in each band.
const SAMPLES: u32 = 400;

/// Parts of a lot that are tried from rest at each.
const PARTS: u32 = 5;

/// What is known of one order.
struct Row {
    order: u32,
    k2: f64,
    k1: f64,
    band: Option<Band>,
    allowing: Option<(f64, f64)>,
    first_chaos: Option<Estimate>,
    last_chaos: Option<Estimate>,
    reach: Option<Reach>,
}

/// Prints the bands.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let track = arguments.drive.track()?;
    let wave = Wave::build(
        arguments.second_tone.unwrap_or_default(),
        arguments.third_tone.unwrap_or_default(),
    )?;
    let output = arguments.drawn.output()?;
    let report = if wave.is_sine() {
        let rows = desk.try_map("bands", arguments.orders, |n| {
            row(arguments.restitution, n as u32 + 1)
        })?;
        report(arguments, &track, &rows)?
    } else {
        tones::report_of(arguments, &wave, &track, desk)?
    };
    report.print(arguments.printed.format)?;
    let drawing = if output.draws() {
        picture::compute(&wave, &track, desk)?
    } else {
        picture::Drawing::default()
    };
    output.write(&report, || {
        picture::draw(arguments, &wave, &track, &drawing)
    })?;
    Ok(Exit::Done)
}

fn row(lot: Restitution, order: u32) -> Result<Row, Refusal> {
    let (band, k2, k1, allowing) = match Band::common(lot, order) {
        Ok(band) => (Some(band), band.low(), band.high(), None),
        Err(BandError::Empty(none)) => (
            None,
            none.flip,
            none.birth,
            Some((none.high_bound, none.low_bound)),
        ),
        Err(BandError::OutOfRange(refusal)) => return Err(refusal.into()),
    };
    let chaos = |restitution| -> Result<Option<Estimate>, Refusal> {
        Ok(Cascade::locate(restitution, order, 7)?.k_infinity())
    };
    let last_chaos = chaos(lot.low())?;
    let first_chaos = if lot.low() == lot.high() {
        last_chaos
    } else {
        chaos(lot.high())?
    };
    let parts: Vec<f64> = if lot.low() == lot.high() {
        vec![lot.low()]
    } else {
        (0..PARTS)
            .map(|n| lot.low() + (lot.high() - lot.low()) * f64::from(n) / f64::from(PARTS - 1))
            .collect()
    };
    let reach = match band {
        Some(band) => Some(Reach::measure(
            band.low(),
            band.high(),
            &parts,
            order,
            SAMPLES,
        )?),
        None => None,
    };
    Ok(Row {
        order,
        k2,
        k1,
        band,
        allowing,
        first_chaos,
        last_chaos,
        reach,
    })
}

/// What a band is, to read, on any track.
const READ: [Column; 9] = [
    columns::ORDER,
    columns::K2,
    columns::K1,
    columns::SETPOINT,
    columns::MARGIN.digits(3),
    columns::B.digits(4),
    columns::B_RANGE.titled("b at k1..k2 (mm)"),
    columns::THROW.digits(4),
    columns::PEAK.digits(4),
];

/// The setpoint of a band: its k, its margin in per cent of b, and the track's largest acceleration
/// there in g.
struct Middle {
    k: f64,
    margin: f64,
    peak: f64,
}

/// The cells under [`READ`] of a band from k2 to k1.
fn read(order: u32, ends: Option<[f64; 2]>, middle: Option<&Middle>, track: &Track) -> Vec<Value> {
    let millimetres = |k: f64| track.amplitude(k) * 1e3;
    let range = ends.zip(middle).map(|([k2, k1], _)| {
        Value::from(format!("{:.4}..{:.4}", millimetres(k1), millimetres(k2)))
    });
    vec![
        order.into(),
        ends.map(|[k2, _]| k2).into(),
        ends.map(|[_, k1]| k1).into(),
        middle.map_or(Value::from("no common band"), |middle| middle.k.into()),
        middle.map(|middle| middle.margin).into(),
        middle.map(|middle| millimetres(middle.k)).into(),
        range.unwrap_or_else(|| "-".into()),
        middle.map(|middle| throw_number(middle.k)).into(),
        middle.map(|middle| middle.peak).into(),
    ]
}

/// The parts, in a heading.
fn who(lot: Restitution) -> String {
    if lot.low() == lot.high() {
        format!("R = {}", lot.low())
    } else {
        format!("R = {}..{}", lot.low(), lot.high())
    }
}

fn report(arguments: &Arguments, track: &Track, rows: &[Row]) -> Result<Printout, Refusal> {
    let more = [
        columns::CHAOS_EDGE.titled("chaos edge"),
        columns::REACHED_FROM_REST.titled("reached from rest"),
    ];
    let mut shown = Table::new(&[&READ[..], &more].concat()).folded();
    let mut full = Table::new(&[
        columns::ORDER,
        columns::K2,
        columns::K1,
        columns::EMPTY,
        columns::SETPOINT,
        columns::MARGIN_K,
        columns::MARGIN,
        columns::MARGIN_B,
        columns::CHAOS_EDGE,
        columns::CHAOS_EDGE_ERROR,
        columns::CHAOS_EDGE_LAST_PART,
        columns::REACHABLE_EDGE,
        columns::REACHABLE_HIGHEST,
        columns::REACHABLE_SHARE,
        columns::B,
        columns::B_AT_K1,
        columns::B_AT_K2,
        columns::THROW,
        columns::PEAK,
        columns::ALLOWING_HIGH_BOUND,
        columns::ALLOWING_LOW_BOUND,
    ]);
    let millimetres = |k: f64| track.amplitude(k) * 1e3;
    for row in rows {
        let setpoint = row.band.map(|band| band.setpoint());
        let margins = row.band.map(|band| band.margins(band.setpoint()));
        let b = setpoint.map(millimetres);
        let throw = setpoint.map(throw_number);
        let peak = setpoint.map(|k| track.acceleration(track.amplitude(k)));
        let reached = match row.reach {
            None => "-".to_string(),
            Some(Reach {
                edge: Some(edge), ..
            }) => format!("up to {edge:.4}"),
            Some(Reach { highest: None, .. }) => "nowhere".to_string(),
            Some(Reach { share, .. }) => format!("{:.1} % in slivers", 100.0 * share),
        };
        let middle = setpoint.zip(margins).zip(peak);
        let middle = middle.map(|((k, margins), peak)| Middle {
            k,
            margin: 100.0 * margins.smallest(),
            peak,
        });
        let mut cells = read(row.order, Some([row.k2, row.k1]), middle.as_ref(), track);
        cells.push(row.first_chaos.map(|chaos| chaos.value).into());
        cells.push(reached.into());
        shown.push_row(cells);
        full.push([
            row.order.into(),
            row.k2.into(),
            row.k1.into(),
            row.band.is_none().into(),
            setpoint.into(),
            margins
                .map(|margins| margins.low.k.min(margins.high.k))
                .into(),
            margins.map(|margins| 100.0 * margins.smallest()).into(),
            b.zip(margins)
                .map(|(b, margins)| b * margins.smallest())
                .into(),
            row.first_chaos.map(|chaos| chaos.value).into(),
            row.first_chaos.map(|chaos| chaos.error).into(),
            row.last_chaos.map(|chaos| chaos.value).into(),
            row.reach.and_then(|reach| reach.edge).into(),
            row.reach.and_then(|reach| reach.highest).into(),
            row.reach.map(|reach| reach.share).into(),
            b.into(),
            millimetres(row.k1).into(),
            millimetres(row.k2).into(),
            throw.into(),
            peak.into(),
            row.allowing.map(|(high, _)| high).into(),
            row.allowing.map(|(_, low)| low).into(),
        ]);
    }
    let lot = arguments.restitution;
    let mut report = Printout::new(shown).heading(format!(
        "{}, {} Hz, incline {} degrees; the setpoint has the largest margin in amplitude",
        who(lot),
        arguments.drive.frequency,
        arguments.drive.incline
    ));
    for row in rows {
        if let Err(BandError::Empty(none)) = Band::common(lot, row.order) {
            report = report.note(none.to_string());
        }
    }
    if rows.iter().any(|row| {
        row.reach.is_some_and(|reach| {
            row.band
                .is_some_and(|band| reach.edge.is_none_or(|edge| edge < band.setpoint()))
        })
    }) {
        report = report.note(
            "From rest a part does not lock at these setpoints by itself: see kband capture.",
        );
    }
    let json = full.to_json();
    report.csv_of(full).json(&json)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_hold_the_references() {
        let single = Restitution::single(0.2).unwrap();
        let first = row(single, 1).unwrap();
        // docs/theory-bands.md#t5.2, docs/theory-capture.md#t7.2
        assert!((first.k2 - 0.393_052).abs() < 1e-6 && (first.k1 - 0.477_465).abs() < 1e-6);
        let chaos = first.first_chaos.unwrap();
        assert!((chaos.value - 0.358_723_3).abs() < 1e-7 && chaos.error < 1e-8);
        let edge = first.reach.unwrap().edge.unwrap();
        assert!((0.4105..0.4122).contains(&edge));
        assert!(row(single, 2).unwrap().reach.unwrap().edge.is_none());
    }

    #[test]
    fn an_empty_band_has_its_bounds() {
        let found = row(Restitution::interval(0.1, 0.3).unwrap(), 1).unwrap();
        assert!(found.band.is_none() && found.reach.is_none());
        let (high, low) = found.allowing.unwrap();
        assert!(0.1 < high && high < 0.3 && 0.1 < low && low < 0.3);
    }
}
