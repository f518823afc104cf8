//! `kband diagram`: the bifurcation diagram.

mod branch;
mod over;
mod page;
mod regimes;

use branch::{bands, follow};
use page::Diagram;

use std::sync::Arc;

use clap::ValueEnum;
use serde::Serialize;

use crate::arguments::{self, AmplitudeArguments, Range, ScatterArguments, Shown};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};

/// The regimes over k, over the amplitude or over restitution, from rest and followed both ways.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband diagram --restitution 0.2 --out diagram.svg
  kband diagram --restitution 0.5 --k 0.56..0.7 --show velocity --out diagram.png
  kband diagram --restitution 0.2 --b 0.2..0.28 --frequency 50 --incline 3 --out diagram.svg
  kband diagram --k 0.43 --restitution 0.1..0.5 --out points.csv
  kband diagram --show regimes --k 0.1..0.8:200 --restitution 0..0.9:150 --out regimes.svg

One of --k, --b, --restitution is a range LO..HI or LO..HI:N (else N = 1000 columns). The table \
and JSON say what each start gives where; CSV has every impact. With --show regimes both --k and \
--restitution are ranges (else 0.1..0.8:200 and 0..0.9:150), of a map of where parts end, from rest and from next to the lock.")]
pub struct Arguments {
    /// Restitution of the part, one value or a range [default: 0.2].
    #[arg(long, value_name = "R", value_parser = arguments::range_or_value((0.0, 0.999), COLUMNS))]
    restitution: Option<Range>,

    /// k = g cos(alpha) / (b w^2), one value or a range [default: around the first band].
    #[arg(long, value_parser = arguments::range_or_value((0.001, 1000.0), COLUMNS))]
    k: Option<Range>,

    #[command(flatten)]
    amplitude: AmplitudeArguments<1000>,

    /// What is drawn upwards.
    #[arg(long, value_enum, default_value_t = Show::Phase)]
    show: Show,

    /// How the parts start, one panel each.
    #[arg(
        long,
        value_enum,
        value_delimiter = ',',
        default_value = "rest,up,down"
    )]
    starts: Vec<ColumnStart>,

    /// Impacts drawn in each column.
    #[arg(long, value_name = "N", default_value = "1000", value_parser = arguments::count(1, 1_000_000))]
    impacts: usize,

    /// Impacts in each column before the first that is drawn.
    #[arg(long, value_name = "N", default_value = "500", value_parser = arguments::count(0, 10_000_000))]
    settle: usize,

    #[command(flatten)]
    scatter: ScatterArguments,

    #[command(flatten)]
    shown: Shown,
}

/// Default number of columns of a range.
const COLUMNS: usize = 1000;

/// What is drawn upwards.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Show {
    /// Phase of the drive at impact.
    Phase,
    /// Velocity after impact.
    Velocity,
    /// Restitution, over k: a map of where parts end, from rest and from next to the lock.
    Regimes,
}

/// How parts start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ColumnStart {
    /// From rest, in each column anew.
    Rest,
    /// From where the column to the left ended: following upwards.
    Up,
    /// From where the column to the right ended: following downwards.
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

    fn words(self) -> &'static str {
        match self {
            Self::Rest => "from rest in each column",
            Self::Up => "followed to the right, each column from where the one before it ended",
            Self::Down => "followed to the left",
        }
    }
}

/// Draws the diagram.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.shown.output()?;
    if arguments.show == Show::Regimes {
        let map = regimes::Map::compute(arguments, desk)?;
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
        branches: follow(arguments, &tracks, &starts, desk)?,
        bands: bands(over, &values),
        values,
    });
    let report = diagram.report()?;
    output.show(&report, || diagram.picture(arguments))
}
