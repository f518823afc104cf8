//! `kband transport`: how fast parts travel.

mod friction;
mod speed;

use kband::feeder::{STANDARD_GRAVITY, Track, TrackSettings};
use kband::impact::{ContactTime, PartState, TangentialSettings, Tone};
use kband::regime::Lock;
use kband::transport::{Effort, Origin};

use crate::arguments::{self, ContactArguments, DriveArguments, Range, ScatterArguments, Shown};
use crate::desk::Desk;
use crate::picture::{Fill, Picture};
use crate::refusal::{Exit, Refusal};
use crate::report::{Printout, number};
pub use friction::Speed;

/// Compute the conveying speed in every regime, over k or amplitude.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband transport --restitution 0.2 --out transport.svg
  kband transport --restitution 0.9 --k 0.03..0.1 --amplitude-ratio 2 --part-length 12
  kband transport --restitution 0.5 --b 0.1..0.3 --frequency 50 --incline 3 --format csv
  kband transport --restitution 0.2 --friction 0.3 --throw 0.3..3.5 --incline 3 --out friction.svg
  kband transport --restitution 0.2 --friction 0.3 --throw 1.5 --over phase-lead
  kband transport --restitution 0.2 --friction 0.3 --second-tone 0.15,2.356 --incline 3

The speed is the time mean, rests included. Each k is simulated from rest, from every attracting \
lock, and from starts spread over phase and velocity; each regime that they reach has a row. The \
impact mean is the paper's mean over impacts. closed_form is equation 20 for locked parts, and the \
corrected equation 34 (an impact mean) for other parts that hop. --friction replaces the restitution \
along the track by Coulomb friction. Its regimes are S (always in contact), H-S (hops and lies) and \
H (hops on). With --second-tone the track moves as sin t + e sin(2 t + th), also along itself.")]
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

    /// Coefficient of friction of parts on the track: one for both, or those of sliding and
    /// sticking.
    #[arg(long, value_name = "MU[,MU_S]", value_parser = arguments::friction, conflicts_with_all = ["tangential_restitution", "scatter"])]
    friction: Option<(f64, f64)>,

    /// Second tone of the track, with --friction: amplitude over that of the first tone, and angle
    /// in rad.
    #[arg(long, value_name = "E,TH", value_parser = arguments::tone, requires = "friction")]
    second_tone: Option<Tone>,

    /// Third tone, E3 sin(3 t + TH3), with --friction.
    #[arg(long, value_name = "E3,TH3", value_parser = arguments::tone, requires = "friction")]
    third_tone: Option<Tone>,

    /// Quantity of the horizontal axis, with --friction [default: the throw number].
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

    /// Length of a part in mm. It adds the number of parts in an hour, end to end.
    #[arg(long, value_name = "MM", value_parser = arguments::within(1e-3, 1e4, "mm"))]
    part_length: Option<f64>,

    /// Number of starts for each k, besides rest and the locks.
    #[arg(long, value_name = "N", default_value = "12", value_parser = arguments::count(2, 10_000))]
    starts: usize,

    /// Number of impacts measured from each start.
    #[arg(long, value_name = "N", default_value = "3000", value_parser = arguments::count(100, 100_000_000))]
    impacts: usize,

    /// Number of impacts discarded first.
    #[arg(long, value_name = "N", default_value = "1000", value_parser = arguments::count(0, 100_000_000))]
    settle: usize,

    #[command(flatten)]
    contact: ContactArguments,

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
    contact: ContactTime,
    milliseconds: ContactArguments,
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
            contact: arguments.contact.time(arguments.drive.frequency)?,
            milliseconds: arguments.contact,
            track,
            settings: TangentialSettings::on(&track, arguments.tangential_restitution),
        })
    }

    fn lock(&self, k: f64, order: u32) -> Option<Lock> {
        Lock::with_contact(k, self.restitution, order, self.contact)
            .ok()
            .flatten()
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
            "R = {}, Rt = {}, η = {}, γ = {}°, incline {}°, {} Hz{}",
            number(self.restitution, 6),
            number(self.settings.restitution, 6),
            number(self.settings.amplitude_ratio, 6),
            number(self.settings.phase_lead.to_degrees(), 6),
            number(self.track.incline().to_degrees(), 6),
            number(self.track.frequency(), 6),
            self.milliseconds.words(),
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
fn locks(k: f64, feeder: &Feeder) -> Vec<Lock> {
    ORDERS
        .filter_map(|order| feeder.lock(k, order))
        .filter(|lock| lock.attracts() && lock.is_first_return())
        .collect()
}

/// Where parts start at `k`: at rest, on each lock that attracts, and `count` starts that fill
/// phase and velocity evenly (the additive recurrence of the plastic number), up to the launch
/// velocity of the highest bounces, `2.5 R/(1-R)`, and a little more.
fn starts(k: f64, feeder: &Feeder, count: usize) -> Vec<Origin> {
    const PLASTIC: f64 = 1.324_717_957_244_746;
    let highest = 1.0 + 2.5 * feeder.restitution / (1.0 - feeder.restitution);
    let mut starts = vec![Origin::Rest];
    starts.extend(
        locks(k, feeder)
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

/// The fills at these values, each from half way to the left neighbour to half way to the right
/// one, within `low..high`.
fn half_ways(
    low: f64,
    high: f64,
    found: impl Iterator<Item = (f64, Fill)>,
) -> Vec<(f64, f64, Fill)> {
    let found: Vec<(f64, Fill)> = found.collect();
    let mut edges = vec![low];
    edges.extend(found.windows(2).map(|pair| 0.5 * (pair[0].0 + pair[1].0)));
    edges.push(high);
    let stretches = edges.windows(2).zip(&found);
    stretches
        .map(|(ends, (_, fill))| (ends[0], ends[1], *fill))
        .collect()
}

fn effort(arguments: &Arguments) -> Effort {
    Effort {
        settle: arguments.settle as u64,
        impacts: arguments.impacts as u64,
    }
}
