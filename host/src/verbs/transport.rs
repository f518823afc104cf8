//! `kband transport`: how fast parts travel.

mod friction;
mod speed;

use kband::feeder::{STANDARD_GRAVITY, Track, TrackSettings};
use kband::impact::{PartState, TangentialSettings, Tone};
use kband::regime::Lock;
use kband::transport::{Effort, Origin};

use crate::arguments::{self, DriveArguments, Range, ScatterArguments, Shown};
use crate::desk::Desk;
use crate::picture::Picture;
use crate::refusal::{Exit, Refusal};
use crate::report::{Printout, number};
pub use friction::Speed;

/// The conveying speed in every regime, over k or the amplitude.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband transport --restitution 0.2 --out transport.svg
  kband transport --restitution 0.9 --k 0.03..0.1 --amplitude-ratio 2 --part-length 12
  kband transport --restitution 0.5 --b 0.1..0.3 --frequency 50 --incline 3 --format csv
  kband transport --restitution 0.2 --friction 0.3 --throw 0.3..3.5 --incline 3 --out friction.svg
  kband transport --restitution 0.2 --friction 0.3 --throw 1.5 --over phase-lead
  kband transport --restitution 0.2 --friction 0.3 --second-tone 0.15,2.356 --incline 3

The speed is the mean over time, rests included. Each k is tried from rest, from every lock that \
attracts there and from starts spread over phase and velocity; one row for each regime they reach. \
The impact mean is the paper's mean over impacts; closed_form is equation 20 for locked parts and \
the corrected equation 34 (an impact mean) for others that hop. With --friction parts rub on the \
track as real ones do, sliding included: S (always in contact), H-S (hops and lies), H (hops on); \
with --second-tone the track moves as sin t + e sin(2 t + th), along itself likewise.")]
pub struct Arguments {
    /// Restitution of the part, 0..1, 1 excluded.
    #[arg(long, value_name = "R", default_value = "0.2", value_parser = arguments::within(0.0, 0.999, ""))]
    restitution: f64,

    /// k = g cos(alpha) / (b w^2), one value or a range [default: from high bounces to beyond the
    /// first band].
    #[arg(long, value_parser = arguments::range_or_value((0.001, 1000.0), 121), conflicts_with = "b")]
    k: Option<Range>,

    /// Amplitude of the track normal to itself in mm, one value or a range.
    #[arg(long, value_name = "MM", value_parser = arguments::range_or_value((1e-6, 1e3), 121))]
    b: Option<Range>,

    /// Throw number (1/k), one value or a range, with --friction [default: 0.3..3.5].
    #[arg(long, value_name = "G", value_parser = arguments::range_or_value((1e-3, 1e3), 129), conflicts_with_all = ["k", "b"], requires = "friction")]
    throw: Option<Range>,

    /// Friction of parts on the track: one coefficient, or that of sliding and that of sticking.
    #[arg(long, value_name = "MU[,MU_S]", value_parser = arguments::friction, conflicts_with_all = ["tangential_restitution", "scatter"])]
    friction: Option<(f64, f64)>,

    /// Second tone of the drive, with --friction: E of the first one's amplitude at the angle TH in
    /// rad.
    #[arg(long, value_name = "E,TH", value_parser = arguments::tone, requires = "friction")]
    second_tone: Option<Tone>,

    /// Third tone, E3 sin(3 t + TH3), with --friction.
    #[arg(long, value_name = "E3,TH3", value_parser = arguments::tone, requires = "friction")]
    third_tone: Option<Tone>,

    /// What the speed is shown over, with --friction [default: the throw number].
    #[arg(long, value_enum, requires = "friction")]
    over: Option<friction::Over>,

    /// The values of incline, friction or phase lead for --over.
    #[arg(long, value_name = "LO..HI[:N]", value_parser = arguments::range_or_value((-180.0, 180.0), 81), allow_hyphen_values = true, requires = "over")]
    values: Option<Range>,

    /// Restitution along the track, 0..1, 1 excluded; the paper's model, without friction.
    #[arg(long, value_name = "RT", default_value = "0.3", value_parser = arguments::within(0.0, 0.999, ""))]
    tangential_restitution: f64,

    /// Amplitude parallel to the track over amplitude normal to it (eta).
    #[arg(long, value_name = "ETA", default_value = "1.5", value_parser = arguments::within(0.0, 100.0, ""))]
    amplitude_ratio: f64,

    /// Phase lead of the parallel motion (gamma) in degrees.
    #[arg(long, value_name = "DEG", default_value = "0",
          value_parser = arguments::within(-180.0, 180.0, "degrees"))]
    phase_lead: f64,

    #[command(flatten)]
    drive: DriveArguments,

    /// Length of a part in mm: also prints how many pass in an hour, one behind the other.
    #[arg(long, value_name = "MM", value_parser = arguments::within(1e-3, 1e4, "mm"))]
    part_length: Option<f64>,

    /// Starts for each k, besides rest and the locks.
    #[arg(long, value_name = "N", default_value = "12", value_parser = arguments::count(2, 10_000))]
    starts: usize,

    /// Impacts measured from each start.
    #[arg(long, value_name = "N", default_value = "3000", value_parser = arguments::count(100, 100_000_000))]
    impacts: usize,

    /// Impacts before the first that is measured.
    #[arg(long, value_name = "N", default_value = "1000", value_parser = arguments::count(0, 100_000_000))]
    settle: usize,

    #[command(flatten)]
    scatter: ScatterArguments,

    #[command(flatten)]
    shown: Shown,
}

/// Computes and prints the speeds.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.shown.output()?;
    let (report, picture) = computed(arguments, desk)?;
    output.show(&report, picture)
}

/// The picture that these options draw, for a page that holds several.
pub fn picture(options: &str, desk: &Desk) -> Result<Picture, Refusal> {
    let (_, picture) = computed(&read(options)?, desk)?;
    Ok(picture())
}

/// The speeds from rest of these options, with friction, for a page that shows many.
pub fn speeds(options: &str, desk: &Desk) -> Result<Vec<Speed>, Refusal> {
    let arguments = read(options)?;
    friction::speeds(&Feeder::build(&arguments)?, &arguments, desk)
}

fn read(options: &str) -> Result<Arguments, Refusal> {
    #[derive(clap::Parser)]
    struct CommandLine {
        #[command(flatten)]
        arguments: Arguments,
    }
    let words = std::iter::once("transport").chain(options.split_whitespace());
    let line = <CommandLine as clap::Parser>::try_parse_from(words)
        .map_err(|error| Refusal::new(error.to_string(), "see kband transport --help"))?;
    Ok(line.arguments)
}

/// A report, and its picture once it is wanted.
type Computed = (Printout, Box<dyn FnOnce() -> Picture>);

fn computed(arguments: &Arguments, desk: &Desk) -> Result<Computed, Refusal> {
    let feeder = Feeder::build(arguments)?;
    if arguments.friction.is_some() {
        return friction::computed(feeder, arguments, desk);
    }
    speed::computed(feeder, arguments, desk)
}

/// What is the same for every k.
#[derive(Clone, Copy, Debug)]
struct Feeder {
    restitution: f64,
    track: Track,
    settings: TangentialSettings,
}

impl Feeder {
    fn build(arguments: &Arguments) -> Result<Self, Refusal> {
        let track = Track::build(TrackSettings {
            frequency: arguments.drive.frequency,
            incline: arguments.drive.incline,
            amplitude_ratio: arguments.amplitude_ratio,
            phase_lead: arguments.phase_lead,
            gravity: STANDARD_GRAVITY,
        })?;
        Ok(Self {
            restitution: arguments.restitution,
            track,
            settings: TangentialSettings::on(&track, arguments.tangential_restitution),
        })
    }

    /// Amplitude in mm at `k`.
    fn amplitude(&self, k: f64) -> f64 {
        1e3 * self.track.amplitude(k)
    }

    /// mm/s for one `b w` at `k`.
    fn velocity_unit(&self, k: f64) -> f64 {
        1e3 * self.track.velocity_unit(self.track.amplitude(k))
    }

    fn words(&self) -> String {
        format!(
            "R = {}, Rt = {}, η = {}, γ = {}°, incline {}°, {} Hz",
            number(self.restitution, 6),
            number(self.settings.restitution, 6),
            number(self.settings.amplitude_ratio, 6),
            number(self.settings.phase_lead.to_degrees(), 6),
            number(self.track.incline().to_degrees(), 6),
            number(self.track.frequency(), 6),
        )
    }

    /// k at an amplitude in mm, within the range of the map.
    fn k_of(&self, amplitude: f64) -> Result<f64, Refusal> {
        arguments::k_of(&self.track, amplitude)
    }
}

/// Lock orders that are looked for at every k.
const ORDERS: std::ops::RangeInclusive<u32> = 1..=8;

/// The locks that attract at `k` and are flown.
fn locks(k: f64, restitution: f64) -> Vec<Lock> {
    ORDERS
        .filter_map(|order| Lock::build(k, restitution, order).ok().flatten())
        .filter(|lock| lock.attracts() && lock.is_first_return())
        .collect()
}

/// Where parts start at `k`: at rest, on each lock that attracts, and `count` starts that fill
/// phase and velocity evenly (the additive recurrence of the plastic number), up to the launch
/// velocity of the highest bounces, `2.5 R/(1-R)`, and a little more.
fn starts(k: f64, restitution: f64, count: usize) -> Vec<Origin> {
    const PLASTIC: f64 = 1.324_717_957_244_746;
    let highest = 1.0 + 2.5 * restitution / (1.0 - restitution);
    let mut starts = vec![Origin::Rest];
    starts.extend(
        locks(k, restitution)
            .iter()
            .map(|lock| Origin::Hop(lock.state())),
    );
    starts.extend((0..count).map(|n| {
        let n = n as f64 + 1.0;
        Origin::Hop(PartState {
            phase: (0.5 + n / PLASTIC).fract() * std::f64::consts::TAU,
            velocity: (0.5 + n / (PLASTIC * PLASTIC)).fract() * highest,
        })
    }));
    starts
}

fn effort(arguments: &Arguments) -> Effort {
    Effort {
        settle: arguments.settle as u64,
        impacts: arguments.impacts as u64,
    }
}
