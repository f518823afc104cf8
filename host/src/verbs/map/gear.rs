//! `kband gear`: amplitude and second tone at which parts of scattering restitution stay in gear.
//!
//! The method is Monte Carlo simulation on a grid of k and second tone (`survey`). Fresh runs then
//! select the best points. The output is the share of time in gear, 0..1.

mod page;
mod survey;

use std::f64::consts::TAU;

use kband::feeder::{Restitution, Track};
use kband::impact::{ContactTime, Tone, Wave};
use kband::regime::band;

use crate::arguments::{
    self, ContactArguments, DriveArguments, OutputArguments, Range, ToneArguments,
};
use crate::causes;
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use survey::Survey;
pub(in crate::verbs) use survey::{Lot, LotSettings};

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

    /// Number of runs of each part at each point.
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
/// At order 1 with two tones the best of 32 angles around the circle was 2.2 to 2.9 rad. That holds
/// for each R of 0.2, 0.3, 0.5 and e of 0.15, 0.25. For other orders and tones the whole circle is
/// searched.
fn angles(arguments: &Arguments) -> (f64, f64, u32) {
    if arguments.order == 1 && arguments.tones.third_tone.is_none() {
        (1.9, 3.0, 12)
    } else {
        (0.0, TAU * 23.0 / 24.0, 24)
    }
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.output.check_or("kband-gear.svg")?;
    let survey = survey_lot(arguments, desk)?;
    let report = page::report(arguments, &survey)?;
    output.show(&report, || page::picture(arguments, &survey))
}

fn survey_lot(arguments: &Arguments, desk: &Desk) -> Result<Survey, Refusal> {
    let order = arguments.order as u32;
    let contact = arguments.contact.time(arguments.drive.frequency)?;
    let lot = Lot::build(LotSettings {
        restitution: arguments.restitution,
        parts: arguments.parts,
        scatter: arguments.scatter,
        order,
        runs: arguments.runs,
        periods: arguments.periods as f64,
        seed: arguments.seed,
        contact,
    })?;
    let k = match (arguments.k, arguments.b) {
        (Some(range), _) => range,
        (None, Some(b)) => over_amplitude(b, &arguments.drive.track()?)?,
        (None, None) => {
            let liveliest = arguments.restitution.high().min(0.99);
            let [edge, _] = band::edges_with_contact(liveliest, order, contact)?;
            let birth = band::birth(liveliest, order)?.max(edge);
            let order = f64::from(order);
            Range::new(0.15 / order, (1.02 * birth).min(1.0 / order), 41)
        }
    };
    let planned = planned(arguments, contact);
    let k: Vec<f64> = k.values().collect();
    Survey::run(lot, &k, &waves(arguments)?, planned, desk)
}

/// Setpoint k of the controller for this lot on an unlimited drive, as in `kband bands`.
fn planned(arguments: &Arguments, contact: ContactTime) -> Option<f64> {
    let feeder = causes::unbounded(arguments.restitution, arguments.scatter, contact);
    let (plan, _) = causes::plan(&feeder, arguments.order as u8)?;
    Some(plan.k.into())
}

/// k for a range of amplitudes in mm, evenly spaced in k, as on the map.
fn over_amplitude(b: Range, track: &Track) -> Result<Range, Refusal> {
    let [low, high] = [b.high, b.low].map(|b| arguments::k_of(track, b));
    Ok(Range::new(low?, high?, b.count))
}

/// The waves to try; the sine is the first.
fn waves(arguments: &Arguments) -> Result<Vec<Wave>, Refusal> {
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
            let part = f64::from(m) / f64::from(count - 1);
            let angle = from + (to - from) * part;
            waves.push(Wave::build(Tone { amplitude, angle }, third)?);
        }
    }
    Ok(waves)
}

#[cfg(test)]
mod tests {
    use kband_control::Settings;

    use super::*;

    /// On one tone the amplitude is equal to that of `bands` and of the controller in `simulate`.
    #[test]
    fn gear_names_the_amplitude_of_the_controller() {
        #[derive(clap::Parser)]
        struct CommandLine {
            #[command(flatten)]
            arguments: Arguments,
        }
        let line = "gear --restitution 0.35..0.45 --scatter 0.04 --frequency 60 --k 0.4..0.7:7 \
                    --second-tone 0.1,2.4 --parts 2 --runs 1 --periods 40";
        let args = line.split_whitespace();
        let arguments = <CommandLine as clap::Parser>::parse_from(args).arguments;
        let desk = Desk::new(Some(1)).unwrap();
        let survey = survey_lot(&arguments, &desk).unwrap();
        let track = arguments.drive.track().unwrap();
        let amplitude = 1e3 * track.amplitude(survey.one_tone.k);
        let feeder = Settings {
            frequency: 60.0,
            resonance: 60.0,
            restitution_low: 0.35,
            restitution_high: 0.45,
            scatter: 0.04,
            ..Settings::default()
        };
        let (_, expected) = causes::plan(&feeder, 1).unwrap();
        let deviation = (amplitude / expected - 1.0).abs();
        assert!(deviation < 1e-4, "{amplitude} {expected}");
    }
}
