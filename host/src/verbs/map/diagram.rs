//! `kband diagram`: the bifurcation diagram.

mod branch;
mod regimes;

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

use branch::{Branch, Stretch, bands, follow, simulate, stream};
use clap::ValueEnum;
use kband::feeder::Track;
use kband::impact::{ContactTime, PartState};
use kband::regime::Lock;

use crate::arguments::{
    self, AmplitudeArguments, ContactArguments, OutputArguments, Range, ScatterArguments,
};
use crate::desk::{Desk, Progress, check_stop};
use crate::ending::FILLS;
use crate::picture::{Axis, Fill, Panel, Picture};
use crate::refusal::{Exit, Refusal, Result};
use crate::report::columns::{self, PHASE, REGIME, START, VELOCITY};
use crate::report::{Column, Printout, Rows, fields, number, numbers, span, when};

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

impl Show {
    /// Ordinate of a state: velocity in `b w`, or phase in rad, -pi..pi.
    fn ordinate(self, state: PartState) -> f64 {
        match self {
            Self::Velocity => state.velocity,
            // Locked parts strike shortly after phase 0, chaotic ones on both sides of it.
            _ if state.phase > PI => state.phase - TAU,
            _ => state.phase,
        }
    }
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
    /// Name in tables, and heading of the panel.
    fn names(self) -> [&'static str; 2] {
        let right = "followed to the right, each column from where the one before it ended";
        match self {
            Self::Rest => ["rest", "from rest in each column"],
            Self::Up => ["up", right],
            Self::Down => ["down", "followed to the left"],
        }
    }
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let output = arguments.output.check()?;
    if arguments.show == Show::Regimes {
        let map = regimes::Map::compute(arguments, desk)?;
        return output.show(&map.report(), || map.picture());
    }
    let draws = output.is_picture();
    let diagram = Arc::new(Diagram::compute(arguments, draws, desk)?);
    let counts = match draws {
        true => diagram.count_impacts(desk)?,
        false => Vec::new(),
    };
    output.show(&diagram.report(), || diagram.picture(counts))
}

#[derive(Clone, Copy, Debug)]
enum Over {
    K { restitution: f64 },
    Amplitude { restitution: f64, track: Track },
    Restitution { k: f64 },
}

impl Over {
    /// k and restitution of the column at `x`.
    fn at(self, x: f64) -> (f64, f64) {
        match self {
            Self::K { restitution } => (x, restitution),
            Self::Amplitude { restitution, track } => (track.k(x * 1e-3), restitution),
            Self::Restitution { k } => (k, x),
        }
    }

    fn column(self) -> Column {
        match self {
            Self::K { .. } => columns::K,
            Self::Amplitude { .. } => columns::B,
            Self::Restitution { .. } => columns::RESTITUTION,
        }
    }

    fn fixed(self) -> String {
        match self {
            Self::K { restitution } => format!("R = {}", number(restitution, 6)),
            Self::Amplitude { restitution, track } => {
                let values = [restitution, track.frequency(), track.incline().to_degrees()];
                let [r, frequency, incline] = numbers(values, 6);
                format!("R = {r}, {frequency} Hz, incline {incline}°")
            }
            Self::Restitution { k } => format!("k = {}", number(k, 6)),
        }
    }
}

/// The option that is a range, and its quantity.
fn chosen(arguments: &Arguments) -> Result<(Over, Range)> {
    let lot = arguments.restitution.unwrap_or(Range::new(0.2, 0.2, 1));
    let restitution = lot.low;
    let wide = |range: Range| range.count > 1;
    let track = arguments.amplitude.track()?;
    match (arguments.k, arguments.amplitude.b, wide(lot)) {
        (Some(k), _, false) if wide(k) => Ok((Over::K { restitution }, k)),
        (Some(k), _, true) if !wide(k) => Ok((Over::Restitution { k: k.low }, lot)),
        (_, Some(b), false) if wide(b) => Ok((Over::Amplitude { restitution, track }, b)),
        (_, Some(b), true) if !wide(b) => {
            let k = arguments::k_of(&track, b.low)?;
            Ok((Over::Restitution { k }, lot))
        }
        (None, None, false) => {
            let low = 0.8 * kband::regime::band::flip(restitution, 1)?;
            let high = 1.05 * kband::regime::band::birth(restitution, 1)?;
            Ok((Over::K { restitution }, Range::new(low, high, 1000)))
        }
        (k, b, _) => {
            let given = [("k", k), ("b", b), ("restitution", Some(lot))];
            let options = given.into_iter().filter_map(|(name, range)| match range? {
                range if wide(range) => Some(format!("--{name} {range}")),
                range => Some(format!("--{name} {}", range.low)),
            });
            let value = options.collect::<Vec<_>>().join(" ");
            let accepted = "exactly one of --k, --b and --restitution as a range LO..HI";
            let next = "for example --restitution 0.2 --k 0.3..0.5";
            Err(Refusal::value("the range", value, accepted, next))
        }
    }
}

/// Neighbouring columns of one regime: start, first and last value, number, name of the regime.
type Regimes = (&'static str, [f64; 2], usize, String);

fields! {
    fn stretches(row: Regimes, unit: &'static str) {
        all START => row.0;
        all FROM.in_unit(unit) => row.1[0];
        all TO.in_unit(unit) => row.1[1];
        all REGIME => row.3.clone();
    }
}

struct Diagram {
    over: Over,
    fixed: String,
    contact: ContactTime,
    range: Range,
    arguments: Arguments,
    values: Vec<f64>,
    branches: Vec<Branch>,
    bands: Vec<Stretch>,
}

impl Diagram {
    fn compute(arguments: &Arguments, draws: bool, desk: &Desk) -> Result<Self> {
        let contact = arguments.contact.time(arguments.amplitude.hertz())?;
        let (over, range) = chosen(arguments)?;
        let values: Vec<f64> = range.values().collect();
        let tracks: Vec<(f64, f64)> = values.iter().map(|x| over.at(*x)).collect();
        let mut starts = arguments.starts.clone();
        starts.dedup();
        Ok(Self {
            over,
            range,
            arguments: arguments.clone(),
            branches: follow(arguments, &tracks, contact, &starts, draws, desk)?,
            bands: bands(over, contact, &values),
            contact,
            fixed: over.fixed() + &arguments.contact.describe(),
            values,
        })
    }

    fn report(self: &Arc<Self>) -> Printout {
        let (name, unit) = (self.over.column().name, self.over.column().unit);
        let mut all: Vec<Regimes> = Vec::new();
        for branch in &self.branches {
            all.extend(branch.regimes().into_iter().map(|(first, last, ending)| {
                let ends = [self.values[first], self.values[last]];
                let (start, columns) = (branch.start.names()[0], last - first + 1);
                (start, ends, columns, ending.name())
            }));
        }
        let regimes = stretches(&unit).objects(&all);
        // Chaos contains many narrow windows; the text table leaves them out.
        let count = all.len();
        all.retain(|(_, _, columns, _)| 100 * columns >= self.values.len());
        let left_out = count - all.len();
        let drawn = self.branches.iter().flat_map(|branch| &branch.columns);
        let drawn: usize = drawn.map(|column| column.count).sum();
        let (range, count) = (span(self.range.low, self.range.high, 6), self.range.count);
        let heading = format!(
            "Regimes over {name} = {range} ({count} columns), {}",
            self.fixed
        );
        let mut report = stretches(&unit).printout(&all).heading(heading);
        if left_out > 0 {
            report = report.note(format!(
                "{left_out} narrower stretches are left out here; --format json has them"
            ));
        }
        let bands = self.bands.iter().map(|band| {
            let (order, [low, high]) = (band.order, numbers([band.low, band.high], 6));
            format!("the period-1 orbit of order {order} attracts from {low} to {high}")
        });
        let rows = Arc::clone(self);
        let impact_columns = [START, self.over.column(), PHASE, VELOCITY, REGIME];
        let count = format!("{drawn} impacts; --out FILE.svg draws them, FILE.csv lists them");
        report
            .notes(bands)
            .note(count)
            .csv(&impact_columns, move |out| rows.impacts(out))
            .json(serde_json::json!({
                "over": name,
                "bands": self.bands,
                "regimes": regimes,
            }))
    }

    /// Simulates a column of a branch again.
    fn simulate(&self, branch: &Branch, n: usize, draw: impl FnMut(PartState)) -> Result<()> {
        let (track, from) = (self.over.at(self.values[n]), branch.columns[n].from);
        let stream = stream(branch.start, n);
        simulate(&self.arguments, track, self.contact, stream, from, draw)?;
        Ok(())
    }

    fn impacts(&self, rows: &mut dyn Rows) -> Result<()> {
        let columns = self.branches.len() * self.values.len();
        let progress = Progress::beside_rows("impacts", columns as u64);
        for branch in &self.branches {
            let [start, _] = branch.start.names();
            for (n, (x, column)) in self.values.iter().zip(&branch.columns).enumerate() {
                check_stop()?;
                let (regime, mut written) = (column.ending.name(), Ok(()));
                self.simulate(branch, n, |state| {
                    if written.is_ok() {
                        written = rows.row(&[
                            start.into(),
                            (*x).into(),
                            state.phase.into(),
                            state.velocity.into(),
                            regime.clone().into(),
                        ]);
                    }
                })?;
                written?;
                progress.advance(1);
            }
        }
        Ok(())
    }

    fn y_axis(&self) -> Axis {
        let columns = self.branches.iter().flat_map(|branch| &branch.columns);
        let heights = columns.flat_map(|column| column.span).chain([0.0, 0.1]);
        if self.arguments.show == Show::Velocity {
            Axis::over_values("velocity ψ after impact", "b·ω", heights)
        } else if self.contact.is_instant() {
            Axis::over_values("impact phase t", "rad", heights).in_pi()
        } else {
            Axis::over_values("phase t after the contact", "rad", heights).in_pi()
        }
    }

    /// Height in pixels of the panel of a branch.
    fn panel_height(&self) -> f64 {
        if self.branches.len() == 1 {
            420.0
        } else {
            240.0
        }
    }

    /// Number of impacts in each cell of each column, of each branch.
    fn count_impacts(&self, desk: &Desk) -> Result<Vec<Vec<Vec<u32>>>> {
        let (axis, cells) = (self.y_axis(), (1.5 * self.panel_height()) as usize);
        let count = |branch: &Branch| {
            desk.try_map("picture", self.values.len(), |n| {
                let mut counts = vec![0; cells];
                let mut add = |y: f32| {
                    if let Some(cell) = axis.cell(y.into(), cells) {
                        counts[cell] += 1;
                    }
                };
                let column = &branch.columns[n];
                if column.ordinates.len() == column.count {
                    column.ordinates.iter().copied().for_each(add);
                } else {
                    let show = self.arguments.show;
                    self.simulate(branch, n, |state| add(show.ordinate(state) as f32))?;
                }
                Ok(counts)
            })
        };
        self.branches.iter().map(count).collect()
    }

    /// The picture, with the numbers of [`Diagram::count_impacts`].
    fn picture(&self, counts: Vec<Vec<Vec<u32>>>) -> Picture {
        let arguments = &self.arguments;
        let y_axis = self.y_axis();
        let Range { low, high, .. } = self.range;
        let (over, x_axis) = match self.over {
            Over::K { .. } => ("k", Axis::of_k(low, high)),
            Over::Amplitude { .. } => ("amplitude", Axis::of_b(low, high)),
            Over::Restitution { .. } => ("restitution", Axis::new("restitution R", "", low, high)),
        };
        let quantity = match arguments.show {
            Show::Velocity => "velocity",
            _ => "phase",
        };
        let (fixed, scatter) = (&self.fixed, arguments.scatter.scatter);
        let scatter = when(scatter > 0.0, || format!(", scattering by {scatter}"));
        let (impacts, columns) = (arguments.impacts, self.range.count);
        let mut picture = Picture::new(format!("Impact {quantity} over {over}")).caption(format!(
            "{fixed}{scatter}; {impacts} impacts in each of {columns} columns, after {} to settle",
            arguments.settle
        ));
        let occurs = |(fill, _): &(Fill, &str)| {
            let mut columns = self.branches.iter().flat_map(|branch| &branch.columns);
            columns.any(|column| column.ending.fill() == Some(*fill))
        };
        let names: Vec<_> = FILLS.into_iter().filter(occurs).collect();
        for ((place, branch), counts) in self.branches.iter().enumerate().zip(counts) {
            let named = |name: &'static str| if place == 0 { name } else { "" };
            let mut panel = Panel::new(x_axis.clone(), y_axis.clone())
                .heading(branch.start.names()[1])
                .height(self.panel_height());
            let strip = named("band: the period-1 orbit attracts");
            for band in &self.bands {
                panel = panel.strip(strip, band.low, band.high);
            }
            panel = panel.columns(named("impacts, few to many"), counts);
            let fills = self.values.iter().zip(&branch.columns);
            let fills = fills.filter_map(|(x, column)| Some((*x, column.ending.fill()?)));
            let names = if place == 0 { &*names } else { &[] };
            panel = panel.ribbon_of_points([low, high], fills, names);
            for order in 1..=5 {
                let [attracting, repelling] = self.period_one(order);
                panel = panel
                    .line(named("period-1 orbit, attracting"), 1, attracting)
                    .line(named("period-1 orbit, repelling"), 2, repelling);
            }
            for band in &self.bands {
                panel = panel.caption(0.5 * (band.low + band.high), format!("r = {}", band.order));
                for edge in [band.low, band.high] {
                    if low < edge && edge < high {
                        panel = panel.mark(edge, number(edge, 4));
                    }
                }
            }
            picture = picture.panel(panel);
        }
        picture
    }

    /// The period-1 branch of an order: its attracting part, and the repelling one below its flip.
    fn period_one(&self, order: u32) -> [Vec<(f64, f64)>; 2] {
        if !self.bands.iter().any(|band| band.order == order) {
            return [Vec::new(), Vec::new()];
        }
        let on = |filter: &dyn Fn(&Lock) -> bool| {
            let point = |x: f64| {
                let (k, restitution) = self.over.at(x);
                let lock = Lock::with_contact(k, restitution, order, self.contact).ok();
                let lock = lock.flatten();
                let stable = lock.filter(|lock| lock.is_first_return() && filter(lock));
                let y = stable.map_or(f64::NAN, |lock| self.arguments.show.ordinate(lock.state()));
                (x, y)
            };
            self.values.iter().map(|x| point(*x)).collect::<Vec<_>>()
        };
        let below_flip = |lock: &Lock| !lock.attracts() && lock.state().phase < FRAC_PI_2;
        [on(&Lock::attracts), on(&below_flip)]
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        arguments: Arguments,
    }

    #[test]
    fn a_second_simulation_gives_the_impacts_of_the_first() {
        let desk = Desk::new(Some(2));
        for scatter in ["0", "0.05"] {
            let range = ["", "--k", "0.3..0.5:40", "--impacts", "200"];
            let command = range.into_iter().chain(["--scatter", scatter]);
            let Command { arguments } = Command::parse_from(command);
            let count = |draws| {
                let diagram = Diagram::compute(&arguments, draws, &desk).unwrap();
                diagram.count_impacts(&desk).unwrap()
            };
            let counts = count(true);
            assert!(counts == count(false));
            let all: u32 = counts.iter().flatten().flatten().sum();
            assert!((3 * 30 * 200..=3 * 40 * 200).contains(&all), "{all}");
        }
    }
}
