//! Bands on a track of two or three tones.

use kband::feeder::{Restitution, Track, throw_number};
use kband::impact::Wave;
use kband::regime::wave_band::{Bifurcation, WaveBand, WaveBands, WaveLock};
use kband::transport::locked;

use super::{
    AMPLITUDE_RATIO, Arguments, Middle, PARTS, READ, TANGENTIAL_RESTITUTION, along, read, who,
};
use crate::desk::Desk;
use crate::refusal::Refusal;
use crate::report::{Printout, Table, Value, columns, number};

/// Values of k that are tried from rest in each band.
const SAMPLES: u32 = 60;

/// Impacts after which a part from rest has to be on its lock.
const IMPACTS: usize = 600;

/// A band of one order and where in it all parts lock from rest.
struct Row {
    order: u32,
    band: Option<WaveBand>,
    /// The lowest and the highest k tried at which all do, and the share of those tried.
    from_rest: Option<([f64; 2], f64)>,
}

/// The bands.
pub(super) fn report_of(
    arguments: &Arguments,
    wave: &Wave,
    track: &Track,
    desk: &Desk,
) -> Result<Printout, Refusal> {
    let rows = desk.try_map("bands", arguments.orders, |n| {
        rows(wave, arguments.restitution, n as u32 + 1)
    })?;
    let rows: Vec<Row> = rows.into_iter().flatten().collect();
    report(arguments, wave, track, &rows)
}

fn rows(wave: &Wave, lot: Restitution, order: u32) -> Result<Vec<Row>, Refusal> {
    let mut rows = Vec::new();
    for band in WaveBands::common(wave, lot, order)?.iter() {
        rows.push(Row {
            order,
            band: Some(band),
            from_rest: from_rest(wave, lot, order, &band)?,
        });
    }
    if rows.is_empty() {
        rows.push(Row {
            order,
            band: None,
            from_rest: None,
        });
    }
    Ok(rows)
}

fn from_rest(
    wave: &Wave,
    lot: Restitution,
    order: u32,
    band: &WaveBand,
) -> Result<Option<([f64; 2], f64)>, Refusal> {
    let parts = if lot.low() == lot.high() { 1 } else { PARTS };
    let mut reached: Vec<f64> = Vec::new();
    for n in 0..SAMPLES {
        let share = (f64::from(n) + 0.5) / f64::from(SAMPLES);
        let k = band.low.k + (band.high.k - band.low.k) * share;
        let mut all = true;
        for part in 0..parts {
            let along = f64::from(part) / f64::from((parts - 1).max(1));
            let restitution = lot.low() + (lot.high() - lot.low()) * along;
            all &= WaveLock::attracting(wave, k, restitution, order)?
                .is_some_and(|lock| lock.is_reached_from_rest(IMPACTS));
            if !all {
                break;
            }
        }
        if all {
            reached.push(k);
        }
    }
    let ends = reached.first().zip(reached.last());
    Ok(ends.map(|(low, high)| ([*low, *high], reached.len() as f64 / f64::from(SAMPLES))))
}

fn name(bifurcation: Bifurcation) -> &'static str {
    match bifurcation {
        Bifurcation::SaddleNode => "birth",
        Bifurcation::Flip => "flip",
        Bifurcation::Grazing => "touch",
    }
}

fn report(
    arguments: &Arguments,
    wave: &Wave,
    track: &Track,
    rows: &[Row],
) -> Result<Printout, Refusal> {
    let more = [
        columns::ENDS,
        columns::REACHED_FROM_REST.titled("locks from rest"),
        columns::SPEEDS.titled("speed (mm/s)"),
    ];
    let mut shown = Table::new(&[&READ[..], &more].concat()).folded();
    let mut full = Table::new(&[
        columns::ORDER,
        columns::K2,
        columns::K1,
        columns::EMPTY,
        columns::K2_END,
        columns::K1_END,
        columns::SETPOINT,
        columns::MARGIN,
        columns::FROM_REST_LOW,
        columns::FROM_REST_HIGH,
        columns::FROM_REST_SHARE,
        columns::B,
        columns::B_AT_K1,
        columns::B_AT_K2,
        columns::THROW,
        columns::PEAK,
        columns::SPEED_AT_LOW_RESTITUTION,
        columns::SPEED_AT_HIGH_RESTITUTION,
        columns::MARGIN_B,
    ]);
    let along = along(track);
    let unit = 1e3 * track.velocity_unit(track.amplitude(1.0));
    let speed =
        |order, restitution| unit * locked::velocity_in_phase(order, 1.0, restitution, &along);
    let lot = arguments.restitution;
    let millimetres = |k: f64| track.amplitude(k) * 1e3;
    for row in rows {
        let Some(band) = row.band else {
            shown.push_row(read(row.order, None, None, track));
            full.push([
                row.order.into(),
                Value::Missing,
                Value::Missing,
                true.into(),
            ]);
            continue;
        };
        let setpoint = band.setpoint();
        // The same to both ends, as fractions of the amplitude.
        let margin = 100.0 * (setpoint / band.low.k - 1.0);
        let peak = track.acceleration(track.amplitude(setpoint)) * wave.peak_acceleration();
        let reached = match row.from_rest {
            None => "nowhere".to_string(),
            Some(([low, high], share)) => format!(
                "{:.0} % of {}..{}",
                100.0 * share,
                number(low, 4),
                number(high, 4)
            ),
        };
        let middle = Middle {
            k: setpoint,
            margin,
            peak,
        };
        let mut cells = read(
            row.order,
            Some([band.low.k, band.high.k]),
            Some(&middle),
            track,
        );
        let ends = [band.low, band.high].map(|end| name(end.bifurcation));
        cells.push(ends.join(", ").into());
        cells.push(reached.into());
        let [slow, fast] = [lot.high(), lot.low()].map(|r| number(speed(row.order, r), 4));
        cells.push(if lot.low() == lot.high() {
            slow.into()
        } else {
            format!("{slow}..{fast}").into()
        });
        shown.push_row(cells);
        full.push([
            row.order.into(),
            band.low.k.into(),
            band.high.k.into(),
            false.into(),
            name(band.low.bifurcation).into(),
            name(band.high.bifurcation).into(),
            setpoint.into(),
            margin.into(),
            row.from_rest.map(|([low, _], _)| low).into(),
            row.from_rest.map(|([_, high], _)| high).into(),
            row.from_rest.map(|(_, share)| share).into(),
            millimetres(setpoint).into(),
            millimetres(band.high.k).into(),
            millimetres(band.low.k).into(),
            throw_number(setpoint).into(),
            peak.into(),
            speed(row.order, lot.low()).into(),
            speed(row.order, lot.high()).into(),
            (1e-2 * margin * millimetres(setpoint)).into(),
        ]);
    }
    let (second, third) = (wave.second(), wave.third());
    let third = if third.amplitude > 0.0 {
        format!(", e3 = {}, th3 = {}", third.amplitude, third.angle)
    } else {
        String::new()
    };
    let json = full.to_json();
    Printout::new(shown)
        .heading(format!(
            "{}, e = {}, th = {} rad{third}, {} Hz, incline {} degrees; the setpoint has the largest margin in \
             amplitude",
            who(lot), second.amplitude, second.angle, arguments.drive.frequency, arguments.drive.incline
        ))
        .note(format!(
            "The speed in lock is that of one tone: it depends neither on amplitude nor on the second tone (eta \
             {AMPLITUDE_RATIO}, Rt {TANGENTIAL_RESTITUTION}; of a lot from its liveliest part to its dullest)."
        ))
        .json(&json)
        .map(|report| report.csv_of(full))
}

#[cfg(test)]
mod tests {
    use super::*;
    use kband::impact::Tone;

    #[test]
    fn rows_hold_the_references() {
        let second = Tone {
            amplitude: 0.15,
            angle: 2.356,
        };
        let wave = Wave::build(second, Tone::default()).unwrap();
        let found = rows(&wave, Restitution::single(0.2).unwrap(), 1).unwrap();
        let widest = found.first().unwrap();
        let band = widest.band.unwrap();
        // docs/theory-real-parts.md#t10.3: the band, and where every start and the one from rest
        // lock.
        assert!((band.low.k - 0.200).abs() < 6e-4 && (band.high.k - 0.452).abs() < 6e-4);
        let ([low, high], share) = widest.from_rest.unwrap();
        assert!(
            low < 0.25 && high > 0.37 && share > 0.5,
            "{low} {high} {share}"
        );
        // Parts of 0.10 to 0.30 share a band, and lock from rest at one amplitude.
        let lot = rows(&wave, Restitution::interval(0.1, 0.3).unwrap(), 1).unwrap();
        let ([low, high], _) = lot.first().unwrap().from_rest.unwrap();
        assert!(low < 0.31 && 0.31 < high, "{low} {high}");
    }
}
