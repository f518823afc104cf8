//! `kband bands`: bands of k and amplitude (mm) in which parts lock, order by order.

mod tones;

use kband::feeder::{Restitution, Track, throw_number};
use kband::impact::{ContactTime, TangentialSettings, Tone, Wave};
use kband::regime::band::{Band, Margins, NoBand};
use kband::regime::cascade::{Cascade, Estimate};
use kband::regime::gear::GearPlan;
use kband::regime::reach::Reach;
use kband::regime::wave_band::WaveBands;
use kband::transport::locked;
use kband_scene::restitutions;

use super::{common_band, describe_lot};
use crate::arguments::{self, ContactArguments, DriveArguments, OutputArguments, ToneArguments};
use crate::causes;
use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::{Exit, Refusal, Result};
use crate::report::columns::{
    GEAR_B, GEAR_B_RANGE, GEAR_BAND_HIGH, GEAR_BAND_LOW, GEAR_K, IN_GEAR_EXPECTED,
};
use crate::report::{Printout, Value, View, fields, number};

/// Bands of k and of amplitude where parts lock, for one restitution or a whole lot of parts.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband bands --restitution 0.2 --orders 3 --frequency 50 --incline 3
  kband bands --restitution 0.18..0.22 --scatter 0.04
  kband bands --restitution 0.18..0.22 --format json
  kband bands --restitution 0.10..0.30 --second-tone 0.15,2.356 --orders 1 --out bands.svg

k2..k1 is the band that all parts share. chaos_edge is the accumulation point of the period \
doublings of the highest restitution. From k2 to reachable_edge every part locks when it starts \
from rest.

With a second tone the track moves as sin t + e sin(2 t + th), th in rad (135 degrees are 2.356). \
An order may then have several bands. With --scatter, gear k is the k that the controller chooses \
for the target gear on a drive without limits. In its gear band the predicted share of time in \
gear is within 0.02 of the best.")]
pub struct Arguments {
    /// Restitution of the part, or LO..HI of the lot.
    #[arg(long, value_name = "R|LO..HI", default_value = "0.2", value_parser = arguments::restitution)]
    restitution: Restitution,
    /// Standard deviation of restitution from impact to impact (s). It adds the gear band of each
    /// order.
    #[arg(long, value_name = "S", value_parser = arguments::within(0.0, 0.3, ""))]
    scatter: Option<f64>,
    /// Number of orders, from 1.
    #[arg(long, value_name = "N", default_value = "3", value_parser = arguments::count(1, 20))]
    orders: usize,
    #[command(flatten)]
    tones: ToneArguments,
    #[command(flatten)]
    contact: ContactArguments,
    #[command(flatten)]
    drive: DriveArguments,
    #[command(flatten)]
    output: OutputArguments,
}

/// Tangential restitution (Rt) and amplitude ratio (eta) of the default scene, for the speeds in
/// the table.
const TANGENTIAL_RESTITUTION: f64 = 0.3;
const AMPLITUDE_RATIO: f64 = 1.5;

/// Speed of locked parts in mm/s.
fn speed(track: &Track, order: u32, restitution: f64) -> f64 {
    let along = TangentialSettings {
        amplitude_ratio: AMPLITUDE_RATIO,
        ..TangentialSettings::on(track, TANGENTIAL_RESTITUTION)
    };
    let unit = 1e3 * track.velocity_unit(track.amplitude(1.0));
    unit * locked::velocity_in_phase(order, 1.0, restitution, &along)
}

/// Parts across a lot, and values of k in a band, at which the lock from rest is tested.
const PARTS: usize = 5;
const K_SAMPLES: u32 = 400;

struct Row {
    order: u32,
    band: Result<Band, NoBand>,
    first_chaos: Option<Estimate>,
    last_chaos: Option<Estimate>,
    reach: Option<Reach>,
    gear: Option<GearPlan>,
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let track = arguments.drive.track()?;
    let wave = arguments.tones.wave()?;
    let output = arguments.output.check()?;
    let contact = arguments.contact.time(arguments.drive.frequency)?;
    let report = if wave.is_sine() {
        let rows = desk.try_map("bands", arguments.orders, |n| {
            let (lot, order) = (arguments.restitution, n as u32 + 1);
            row(lot, arguments.scatter, order, contact)
        })?;
        report(arguments, &track, &rows, contact)
    } else if !contact.is_instant() {
        let value = arguments.contact.contact;
        let accepted = "0 with a second or third tone";
        let next = "leave out the tones, or ask kband gear, which has both";
        return Err(Refusal::value("--contact", value, accepted, next));
    } else {
        tones::report(arguments, &wave, &track, desk)?
    };
    let draw = || draw(arguments, &wave, &track, desk);
    let picture = output.is_picture().then(draw).transpose()?;
    output.show(&report, || picture.unwrap_or_else(|| Picture::new("")))
}

fn row(lot: Restitution, scatter: Option<f64>, order: u32, contact: ContactTime) -> Result<Row> {
    let band = common_band(lot, order, contact)?;
    // Both apply to instantaneous impacts.
    let instant = contact.is_instant();
    let chaos = |restitution| -> Result<Option<Estimate>> {
        if !instant {
            return Ok(None);
        }
        Ok(Cascade::locate(restitution, order, 7)?.k_infinity())
    };
    let parts = restitutions(lot, PARTS);
    let measure = |band: Band| Reach::measure(band.low(), band.high(), &parts, order, K_SAMPLES);
    let reach = band.ok().filter(|_| instant).map(measure).transpose()?;
    let plan = |scatter| causes::plan(&causes::unbounded(lot, scatter, contact), order as u8);
    Ok(Row {
        gear: scatter.and_then(plan).map(|(plan, _)| plan),
        order,
        band,
        first_chaos: chaos(lot.high())?,
        last_chaos: chaos(lot.low())?,
        reach,
    })
}

impl Row {
    /// k2 and k1: ends of the band, or the edges of the parts that leave none.
    fn edges(&self) -> [f64; 2] {
        match self.band {
            Ok(band) => [band.low(), band.high()],
            Err(none) => [none.flip, none.birth],
        }
    }

    /// k at the setpoint, which has the largest margin in amplitude.
    fn setpoint(&self) -> Option<f64> {
        Some(self.band.ok()?.setpoint())
    }

    fn margins(&self) -> Option<Margins> {
        Some(self.band.ok()?.margins(self.setpoint()?))
    }

    /// The smaller margin in amplitude at the setpoint, over the amplitude.
    fn margin(&self) -> Option<f64> {
        self.margins().map(|margins| margins.smallest())
    }

    fn reached(&self) -> String {
        let values = |reach: Reach| (reach.edge, reach.highest, reach.share);
        match self.reach.map(values) {
            None => "-".into(),
            Some((Some(edge), ..)) => format!("up to {edge:.4}"),
            Some((_, None, _)) => "nowhere".into(),
            Some((.., share)) => format!("{:.1} % in slivers", 100.0 * share),
        }
    }
}

fn millimetres(track: &Track, k: f64) -> f64 {
    track.amplitude(k) * 1e3
}

/// Amplitudes in mm from `k1` to `k2`.
fn amplitudes(track: &Track, [k2, k1]: [f64; 2]) -> String {
    let (low, high) = (millimetres(track, k1), millimetres(track, k2));
    format!("{low:.4}..{high:.4}")
}

fields! {
    fn band_view(row: Row, track: Track) {
        all ORDER => row.order;
        all K2 => row.edges()[0];
        all K1 => row.edges()[1];
        data EMPTY => row.band.is_err();
        read SETPOINT => row.setpoint().map_or("no common band".into(), Value::from);
        data SETPOINT => row.setpoint();
        data MARGIN_K => row.margins().map(|margins| margins.low.k.min(margins.high.k));
        all MARGIN.digits(3) => row.margin().map(|margin| 100.0 * margin);
        data MARGIN_B => row.setpoint().zip(row.margin()).map(|(k, margin)| millimetres(track, k) * margin);
        data CHAOS_EDGE => row.first_chaos.map(|chaos| chaos.value);
        data CHAOS_EDGE_ERROR => row.first_chaos.map(|chaos| chaos.error);
        data CHAOS_EDGE_LAST_PART => row.last_chaos.map(|chaos| chaos.value);
        data REACHABLE_EDGE => row.reach.and_then(|reach| reach.edge);
        data REACHABLE_HIGHEST => row.reach.and_then(|reach| reach.highest);
        data REACHABLE_SHARE => row.reach.map(|reach| reach.share);
        all B.digits(4) => row.setpoint().map(|k| millimetres(track, k));
        data B_AT_K1 => millimetres(track, row.edges()[1]);
        data B_AT_K2 => millimetres(track, row.edges()[0]);
        read B_RANGE.titled("b at k1..k2 (mm)") => row.band.map_or("-".into(), |_| amplitudes(track, row.edges()));
        all THROW.digits(4) => row.setpoint().map(throw_number);
        all PEAK.digits(4) => row.setpoint().map(|k| track.acceleration(track.amplitude(k)));
        read CHAOS_EDGE.titled("chaos edge") => row.first_chaos.map(|chaos| chaos.value);
        read REACHED_FROM_REST.titled("reached from rest") => row.reached();
        all GEAR_K.titled("gear k").digits(4) => row.gear.map(|gear| f64::from(gear.k));
        all GEAR_B.titled("gear b (mm)").digits(4) => row.gear.map(|gear| millimetres(track, f64::from(gear.k)));
        all IN_GEAR_EXPECTED.titled("in gear").digits(3) => row.gear.map(|gear| f64::from(gear.share));
        data GEAR_BAND_LOW => row.gear.map(|gear| f64::from(gear.band[0]));
        data GEAR_BAND_HIGH => row.gear.map(|gear| f64::from(gear.band[1]));
        read GEAR_B_RANGE.titled("gear band (mm)") => row.gear.map_or("-".into(), |gear| amplitudes(track, gear.band.map(f64::from)));
        data ALLOWING_HIGH_BOUND => row.band.err().map(|none| none.high_bound);
        data ALLOWING_LOW_BOUND => row.band.err().map(|none| none.low_bound);
    }
}

fn report(arguments: &Arguments, track: &Track, rows: &[Row], contact: ContactTime) -> Printout {
    let mut view = band_view(track);
    if arguments.scatter.is_none() {
        let gear = [GEAR_K, GEAR_B, GEAR_B_RANGE, GEAR_BAND_LOW, GEAR_BAND_HIGH];
        view = gear.into_iter().fold(view, View::without);
        view = view.without(IN_GEAR_EXPECTED);
    }
    let (drive, contacts) = (arguments.drive, arguments.contact.describe());
    let text = describe_lot(arguments.restitution);
    let (frequency, incline) = (drive.frequency, drive.incline);
    let report = view.printout(rows).folded().heading(format!(
        "{text}, {frequency} Hz, incline {incline} degrees{contacts}; the setpoint has the largest margin in amplitude"
    ));
    let unknown = (!contact.is_instant()).then_some(
        "Chaos edge and what is reached from rest are known for impacts in no time only.",
    );
    let empty = rows.iter().filter_map(|row| row.band.err());
    let empty = empty.map(|none| none.to_string());
    let beyond_rest = rows.iter().filter_map(|row| row.reach.zip(row.band.ok()));
    let unreached = beyond_rest
        .filter(|(reach, band)| reach.edge.is_none_or(|edge| edge < band.setpoint()))
        .map(|_| "From rest a part does not lock at these setpoints by itself: see kband capture.");
    report.notes(unknown).notes(empty).notes(unreached.take(1))
}

/// Number of restitutions at which the bands are drawn, and the largest one.
const RESTITUTION_STEPS: usize = 71;
const MAX_RESTITUTION: f64 = 0.7;

/// Bands of order 1 of one wave: restitution, low end and high end of the widest one.
type Bands = Vec<(f64, f64, f64)>;

/// Draws the bands in mm, to set a feeder, and in k, to compare feeders.
fn draw(arguments: &Arguments, wave: &Wave, track: &Track, desk: &Desk) -> Result<Picture> {
    let lot = arguments.restitution;
    let restitution = |n: usize| MAX_RESTITUTION * n as f64 / (RESTITUTION_STEPS - 1) as f64;
    let bands = |wave: &Wave| -> Result<Bands> {
        desk.try_map("bands over R", RESTITUTION_STEPS, |n| {
            let found = WaveBands::find(wave, restitution(n), 1)?;
            let ends = found.iter().map(|band| (band.low.k, band.high.k));
            let widest = ends.max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0)));
            let (low, high) = widest.unwrap_or((f64::NAN, f64::NAN));
            Ok((restitution(n), low, high))
        })
    };
    let mut drawn = vec![("one tone".to_string(), 1, bands(&Wave::sine())?)];
    if !wave.is_sine() {
        let Tone { amplitude, angle } = wave.second();
        let name = format!("e = {amplitude}, th = {angle} rad");
        drawn.push((name, 0, bands(wave)?));
    }
    let axis = || Axis::new("restitution R", "", 0.0, MAX_RESTITUTION);
    let over = |label: &str, unit: &'static str, scale: &dyn Fn(f64) -> f64| {
        let ends = |&(r, low, high): &(f64, f64, f64)| {
            let (one, other) = (scale(low), scale(high));
            (r, one.min(other), one.max(other))
        };
        let scaled = |bands: &Bands| -> Bands { bands.iter().map(ends).collect() };
        let all = drawn.iter().flat_map(|(.., bands)| scaled(bands));
        let top = all.map(|band| band.2).fold(0.0, f64::max);
        let mut panel = Panel::new(axis(), Axis::new(label, unit, 0.0, 1.05 * top));
        for (name, series, bands) in &drawn {
            panel = panel.between(name, *series, scaled(bands));
        }
        panel.mark(lot.low(), "your lot").mark(lot.high(), "")
    };
    let millimetres = |k: f64| 1e3 * track.amplitude(k);
    let mut amplitude = over("amplitude b normal to the track", "mm", &millimetres).height(330.0);
    if let (true, Ok(band)) = (wave.is_sine(), Band::common(lot, 1)) {
        let b = millimetres(band.setpoint());
        amplitude = amplitude.level(b, format!("setpoint {} mm", number(b, 3)));
    }
    let bands = over("k = g cos α / (b ω²)", "", &|k| k).height(230.0);
    let speed = |n: usize| (restitution(n), speed(track, 1, restitution(n)));
    let speed: Vec<_> = (0..RESTITUTION_STEPS).map(speed).collect();
    let speeds = speed.iter().map(|point| point.1);
    let slowest = speeds.clone().fold(0.0, f64::min);
    let highest = 1.05 * speeds.fold(1.0, f64::max);
    let name = match wave.is_sine() {
        true => "at every amplitude of the band",
        false => "of one tone and of two, at every amplitude",
    };
    let speed = Panel::new(axis(), Axis::new("speed in lock", "mm/s", slowest, highest))
        .height(190.0)
        .line(name, 0, speed);
    Ok(Picture::new("Bands of order 1 over restitution")
        .caption(format!(
            "Between these amplitudes a part locks: with more its lock doubles or touches, with less none is born. {} Hz, \
             incline {}\u{b0}; speed with eta {AMPLITUDE_RATIO}, Rt {TANGENTIAL_RESTITUTION}",
            arguments.drive.frequency, arguments.drive.incline
        ))
        .panel(amplitude)
        .panel(bands)
        .panel(speed))
}
