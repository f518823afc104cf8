//! `kband diagram`: the bifurcation diagram.

mod branch;
mod over;
mod page;
mod regimes;

use branch::{bands, follow};
use page::Diagram;

use std::sync::Arc;

use clap::ValueEnum;

use crate::arguments::{
    self, AmplitudeArguments, ContactArguments, OutputArguments, Range, ScatterArguments,
};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};

/// Draw the bifurcation diagram: regimes over k, amplitude or restitution.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband diagram --restitution 0.2 --out diagram.svg
  kband diagram --restitution 0.5 --k 0.56..0.7 --show velocity --out diagram.png
  kband diagram --restitution 0.2 --b 0.2..0.28 --frequency 50 --incline 3 --out diagram.svg
  kband diagram --k 0.43 --restitution 0.1..0.5 --out points.csv
  kband diagram --show regimes --k 0.1..0.8:200 --restitution 0..0.9:150 --out regimes.svg

One of --k, --b and --restitution is a range, LO..HI or LO..HI:N (default N = 1000 columns). Table \
and JSON have the regimes that each start reaches; CSV has every impact. With --show regimes --k \
and --restitution are both ranges (default 0.1..0.8:200 and 0..0.9:150). The map has the final \
regimes from rest and from next to the lock.")]
pub struct Arguments {
    /// Restitution of the part, one value or a range [default: 0.2].
    #[arg(long, value_name = "R", value_parser = arguments::range_or_value((0.0, 0.999), COLUMNS))]
    restitution: Option<Range>,

    /// k = g cos(alpha) / (b w^2), one value or a range [default: around the first band].
    #[arg(long, value_parser = arguments::range_or_value((0.001, 1000.0), COLUMNS))]
    k: Option<Range>,

    #[command(flatten)]
    amplitude: AmplitudeArguments<1000>,

    /// Quantity of the vertical axis.
    #[arg(long, value_enum, default_value_t = Show::Phase)]
    show: Show,

    /// Starts of the parts, one panel each.
    #[arg(
        long,
        value_enum,
        value_delimiter = ',',
        default_value = "rest,up,down"
    )]
    starts: Vec<ColumnStart>,

    /// Number of impacts drawn in each column.
    #[arg(long, value_name = "N", default_value = "1000", value_parser = arguments::count(1, 1_000_000))]
    impacts: usize,

    /// Number of impacts discarded first in each column.
    #[arg(long, value_name = "N", default_value = "500", value_parser = arguments::count(0, 10_000_000))]
    settle: usize,

    #[command(flatten)]
    contact: ContactArguments,

    #[command(flatten)]
    scatter: ScatterArguments,

    #[command(flatten)]
    output: OutputArguments,
}

/// Default number of columns of a range.
const COLUMNS: usize = 1000;

/// Quantity of the vertical axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Show {
    /// Phase of the drive at impact.
    Phase,
    /// Velocity after impact.
    Velocity,
    /// Restitution, over k: a map of the final regimes, from rest and from next to the lock.
    Regimes,
}

/// How parts start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ColumnStart {
    /// From rest in each column.
    Rest,
    /// From the final state of the column to the left.
    Up,
    /// From the final state of the column to the right.
    Down,
}

impl ColumnStart {
    fn name(self) -> &'static str {
        match self {
            Self::Rest => "rest",
            Self::Up => "up",
            Self::Down => "down",
        }
    }

    fn describe(self) -> &'static str {
        match self {
            Self::Rest => "from rest in each column",
            Self::Up => "followed to the right, each column from where the one before it ended",
            Self::Down => "followed to the left",
        }
    }
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.output.check()?;
    let contact = arguments.contact.time(arguments.amplitude.hertz())?;
    if arguments.show == Show::Regimes {
        let map = regimes::Map::compute(arguments, contact, desk)?;
        let report = map.report()?;
        return output.show(&report, || map.picture());
    }
    let (over, range) = over::chosen(arguments)?;
    let values: Vec<f64> = range.values().collect();
    let tracks: Vec<(f64, f64)> = values.iter().map(|x| over.at(*x)).collect();
    let mut starts = arguments.starts.clone();
    starts.dedup();
    let diagram = Arc::new(Diagram {
        over,
        range,
        velocity: arguments.show == Show::Velocity,
        branches: follow(arguments, &tracks, contact, &starts, desk)?,
        bands: bands(over, contact, &values),
        contact,
        fixed: over.fixed() + &arguments.contact.describe(),
        values,
    });
    let report = diagram.report()?;
    output.show(&report, || diagram.picture(arguments))
}
