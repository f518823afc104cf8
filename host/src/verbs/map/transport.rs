//! `kband transport`: conveying speed of parts.

mod friction;
mod speed;

use kband::feeder::Track;
use kband::impact::{ContactTime, TangentialSettings};
use kband::regime::Lock;
use kband::transport::{Effort, Origin};

use crate::arguments::{
    self, ContactArguments, DriveArguments, OutputArguments, Range, ScatterArguments, ToneArguments,
};
use crate::desk::Desk;
use crate::refusal::{Exit, Result};
use crate::report::number;
use crate::verbs::read;
pub use friction::Row;

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
    #[command(flatten)]
    tones: ToneArguments,
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
    output: OutputArguments,
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let output = arguments.output.check()?;
    let feeder = Feeder::build(arguments)?;
    match arguments.friction {
        Some(_) => friction::run(feeder, &output, desk),
        None => speed::run(&feeder, &output, desk),
    }
}

/// Regimes from rest for these options, with friction, for a page with many.
pub fn from_rest(options: &str, desk: &Desk) -> Result<Vec<Row>> {
    let arguments = read(options)?;
    friction::from_rest(Feeder::build(&arguments)?, desk)
}

#[derive(Clone, Copy, Debug)]
struct Feeder<'a> {
    arguments: &'a Arguments,
    contact: ContactTime,
    track: Track,
    settings: TangentialSettings,
}

impl<'a> Feeder<'a> {
    fn build(arguments: &'a Arguments) -> Result<Self> {
        let (ratio, lead) = (arguments.amplitude_ratio, arguments.phase_lead);
        let track = Track::build(arguments.drive.settings(ratio, lead))?;
        Ok(Self {
            arguments,
            contact: arguments.contact.time(arguments.drive.frequency)?,
            track,
            settings: TangentialSettings::on(&track, arguments.tangential_restitution),
        })
    }

    fn lock(&self, k: f64, order: u32) -> Option<Lock> {
        Lock::with_contact(k, self.arguments.restitution, order, self.contact).ok()?
    }

    fn amplitude(&self, k: f64) -> f64 {
        1e3 * self.track.amplitude(k)
    }

    /// Velocity `b w` at `k`, in mm/s.
    fn velocity_unit(&self, k: f64) -> f64 {
        1e3 * self.track.velocity_unit(self.track.amplitude(k))
    }

    fn describe(&self) -> String {
        format!(
            "R = {}, Rt = {}, η = {}, γ = {}°, incline {}°, {} Hz{}",
            number(self.arguments.restitution, 6),
            number(self.settings.restitution, 6),
            number(self.settings.amplitude_ratio, 6),
            number(self.settings.phase_lead.to_degrees(), 6),
            number(self.track.incline().to_degrees(), 6),
            number(self.track.frequency(), 6),
            self.arguments.contact.describe(),
        )
    }

    /// Starts on the locks that attract at `k` and are first returns.
    fn locked(&self, k: f64) -> impl Iterator<Item = Origin> {
        let locks = ORDERS.filter_map(move |order| self.lock(k, order));
        let persists = |lock: &Lock| lock.attracts() && lock.is_first_return();
        let locks = locks.filter(persists);
        locks.map(|lock| Origin::Hop(lock.state()))
    }

    fn effort(&self) -> Effort {
        Effort {
            settle: self.arguments.settle as u64,
            impacts: self.arguments.impacts as u64,
        }
    }
}

/// Lock orders that are searched at every k.
const ORDERS: std::ops::RangeInclusive<u32> = 1..=8;
