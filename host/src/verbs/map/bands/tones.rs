//! Bands on a track of two or three tones.

use kband::feeder::{Restitution, Track, throw_number};
use kband::impact::Wave;
use kband::regime::wave_band::{Bifurcation, WaveBand, WaveBands, WaveLock};
use kband_scene::restitutions;

use super::{
    AMPLITUDE_RATIO, Arguments, PARTS, TANGENTIAL_RESTITUTION, amplitudes, describe_lot,
    millimetres, speed,
};
use crate::desk::Desk;
use crate::refusal::Result;
use crate::report::{Printout, Value, fields, span, when};

const K_SAMPLES: u32 = 60;

const MAX_IMPACTS_TO_LOCK: usize = 600;

/// A band of one order, and its part in which all parts lock from rest.
struct Row {
    order: u32,
    band: Option<WaveBand>,
    /// Lowest and highest tried k at which all parts lock from rest, and the share of k that do.
    from_rest: Option<([f64; 2], f64)>,
}

/// One row for each band of an order, or one without a band.
fn rows(wave: &Wave, lot: Restitution, order: u32) -> Result<Vec<Row>> {
    let bands = WaveBands::common(wave, lot, order)?;
    let mut bands: Vec<Option<WaveBand>> = bands.iter().map(Some).collect();
    bands.resize(bands.len().max(1), None);
    let row = |band: Option<WaveBand>| {
        let from_rest = band.map(|band| from_rest(wave, lot, order, &band));
        Ok(Row {
            order,
            band,
            from_rest: from_rest.transpose()?.flatten(),
        })
    };
    bands.into_iter().map(row).collect()
}

fn from_rest(
    wave: &Wave,
    lot: Restitution,
    order: u32,
    band: &WaveBand,
) -> Result<Option<([f64; 2], f64)>> {
    let parts = restitutions(lot, PARTS);
    let locks = |k: f64, restitution: f64| -> Result<bool> {
        let lock = WaveLock::find_attracting(wave, k, restitution, order)?;
        Ok(lock.is_some_and(|lock| lock.is_reached_from_rest(MAX_IMPACTS_TO_LOCK)))
    };
    let mut reached: Vec<f64> = Vec::new();
    for n in 0..K_SAMPLES {
        let share = (f64::from(n) + 0.5) / f64::from(K_SAMPLES);
        let k = band.low.k + (band.high.k - band.low.k) * share;
        let mut all = true;
        for &restitution in &parts {
            all = all && locks(k, restitution)?;
        }
        reached.extend(all.then_some(k));
    }
    let ends = reached.first().zip(reached.last());
    Ok(ends.map(|(low, high)| ([*low, *high], reached.len() as f64 / f64::from(K_SAMPLES))))
}

fn name(bifurcation: Bifurcation) -> &'static str {
    match bifurcation {
        Bifurcation::SaddleNode => "birth",
        Bifurcation::Flip => "flip",
        Bifurcation::Grazing => "touch",
    }
}

impl Row {
    /// A quantity of the band; `None` without a band.
    fn map_band<T>(&self, quantity: impl Fn(&WaveBand) -> T) -> Option<T> {
        self.band.as_ref().map(quantity)
    }

    fn setpoint(&self) -> Option<f64> {
        self.map_band(WaveBand::setpoint)
    }

    /// The margin at the setpoint to both ends, in % of the amplitude.
    fn margin(&self) -> Option<f64> {
        self.map_band(|band| 100.0 * (band.setpoint() / band.low.k - 1.0))
    }

    fn reached(&self) -> String {
        match self.from_rest {
            None => "nowhere".into(),
            Some(([low, high], share)) => {
                format!("{:.0} % of {}", 100.0 * share, span(low, high, 4))
            }
        }
    }
}

fields! {
    fn tone_view(row: Row, track: Track, wave: Wave, lot: Restitution) {
        all ORDER => row.order;
        all K2 => row.map_band(|band| band.low.k);
        all K1 => row.map_band(|band| band.high.k);
        data EMPTY => row.band.is_none();
        data K2_END => row.map_band(|band| name(band.low.bifurcation));
        data K1_END => row.map_band(|band| name(band.high.bifurcation));
        read SETPOINT => row.setpoint().map_or("no common band".into(), Value::from);
        data SETPOINT => row.setpoint();
        all MARGIN.digits(3) => row.margin();
        data FROM_REST_LOW => row.from_rest.map(|([low, _], _)| low);
        data FROM_REST_HIGH => row.from_rest.map(|([_, high], _)| high);
        data FROM_REST_SHARE => row.from_rest.map(|(_, share)| share);
        all B.digits(4) => row.setpoint().map(|k| millimetres(track, k));
        data B_AT_K1 => row.map_band(|band| millimetres(track, band.high.k));
        data B_AT_K2 => row.map_band(|band| millimetres(track, band.low.k));
        read B_RANGE.titled("b at k1..k2 (mm)") => row.map_band(|band| amplitudes(track, [band.low.k, band.high.k])).unwrap_or("-".into());
        all THROW.digits(4) => row.setpoint().map(throw_number);
        all PEAK.digits(4) => row.setpoint().map(|k| {
            track.acceleration(track.amplitude(k)) * wave.peak_acceleration()
        });
        read ENDS => row.map_band(|band| [band.low, band.high].map(|end| name(end.bifurcation)).join(", "));
        read REACHED_FROM_REST.titled("locks from rest") => row.map_band(|_| row.reached());
        read SPEEDS.titled("speed (mm/s)") => row.map_band(|_| {
            span(speed(track, row.order, lot.high()), speed(track, row.order, lot.low()), 4)
        });
        data SPEED_AT_LOW_RESTITUTION => row.map_band(|_| speed(track, row.order, lot.low()));
        data SPEED_AT_HIGH_RESTITUTION => row.map_band(|_| speed(track, row.order, lot.high()));
        data MARGIN_B => row.setpoint().zip(row.margin()).map(|(k, margin)| 1e-2 * margin * millimetres(track, k));
    }
}

pub(super) fn report(
    arguments: &Arguments,
    wave: &Wave,
    track: &Track,
    desk: &Desk,
) -> Result<Printout> {
    let rows = desk.try_map("bands", arguments.orders, |n| {
        rows(wave, arguments.restitution, n as u32 + 1)
    })?;
    let rows: Vec<Row> = rows.into_iter().flatten().collect();
    let (second, third) = (wave.second(), wave.third());
    let text = || format!(", e3 = {}, th3 = {}", third.amplitude, third.angle);
    let third = when(third.amplitude > 0.0, text);
    Ok(tone_view(track, wave, &arguments.restitution)
        .printout(&rows)
        .folded()
        .heading(format!(
            "{}, e = {}, th = {} rad{third}, {} Hz, incline {} degrees; the setpoint has the largest margin in \
             amplitude",
            describe_lot(arguments.restitution), second.amplitude, second.angle, arguments.drive.frequency, arguments.drive.incline
        ))
        .note(format!(
            "The speed in lock is that of one tone: it depends neither on amplitude nor on the second tone (eta \
             {AMPLITUDE_RATIO}, Rt {TANGENTIAL_RESTITUTION}; of a lot from its liveliest part to its dullest)."
        )))
}
