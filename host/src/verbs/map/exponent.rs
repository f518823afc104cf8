//! `kband exponent`: Lyapunov exponents.

use kband::feeder::Track;
use kband::impact::{Kernel, Map, PartState};
use kband::regime::cascade::Estimate;
use kband::regime::chaos::ChaoticBand;
use kband::regime::classify::Regime;
use kband::regime::exponent::{
    Dynamics, Exponent, ExponentSettings, measure, measure_scattered, measure_together,
    start_near_lock,
};
use kband::regime::{Lock, Multipliers};
use kband::transport::SampleMean;

use crate::arguments::{self, AmplitudeArguments, OutputArguments, Range, ScatterArguments};
use crate::desk::Desk;
use crate::ending::{self, Endings, MAX_ORBIT_IMPACTS};
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::{Exit, Refusal, Result};
use crate::report::{Printout, columns, fields, finite, number, numbers, when};

/// Measure Lyapunov exponents with their statistical error.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband exponent --restitution 0.2 --k 0.34
  kband exponent --restitution 0.2 --k 0.32..0.48:400 --impacts 20000 --out exponent.svg
  kband exponent --restitution 0.2 --k 0.358 --band
  kband exponent --restitution 0.2 --b 0.2..0.3:200 --frequency 50 --out exponent.svg

Eight orbits share the impacts. They start next to the locked orbit; --phase and --velocity give \
one start instead. The standard error is the larger of two estimates: from their scatter and from \
their autocorrelation. An orbit that comes to rest is not chaotic: its motion is 'rest', with the \
number of impacts before.")]
pub struct Arguments {
    /// Restitution of the part, 0..1.
    #[arg(long, value_name = "R", default_value = "0.2", value_parser = arguments::within(0.0, 1.0, ""))]
    restitution: f64,
    /// k = g cos(alpha) / (b w^2), one value or a range LO..HI[:N] [default: 0.34].
    #[arg(long, value_parser = arguments::range_or_value((0.001, 1000.0), 200))]
    k: Option<Range>,
    #[command(flatten)]
    amplitude: AmplitudeArguments,
    /// Number of impacts measured at each k.
    #[arg(long, value_name = "N", default_value = "200000", value_parser = arguments::count(320, 1_000_000_000))]
    impacts: usize,
    /// Number of impacts discarded first.
    #[arg(long, value_name = "N", default_value = "2000", value_parser = arguments::count(0, 1_000_000_000))]
    settle: usize,
    /// Order of the locked orbit next to which the orbits start.
    #[arg(long, value_name = "r", default_value = "1", value_parser = arguments::count(1, 100))]
    order: usize,
    /// Phase of the start in rad, with --velocity.
    #[arg(long, value_name = "T", value_parser = arguments::number, requires = "velocity")]
    phase: Option<f64>,
    /// Velocity of the start in units of b w, with --phase.
    #[arg(long, value_name = "PSI", value_parser = arguments::within(0.0, 1000.0, "b w"), requires = "phase")]
    velocity: Option<f64>,
    #[command(flatten)]
    scatter: ScatterArguments,
    /// Also measure the chaotic band below the cascade.
    #[arg(long)]
    band: bool,
    #[command(flatten)]
    output: OutputArguments,
}

impl Arguments {
    /// Largest number of impacts for the final regime: as many as are measured.
    fn followed(&self) -> usize {
        MAX_ORBIT_IMPACTS.max(self.settle + self.impacts)
    }
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let output = arguments.output.check()?;
    let given = arguments.amplitude.or_range(arguments.k)?;
    let values = given.unwrap_or_else(|| vec![0.34]);
    let settings = ExponentSettings {
        settle: arguments.settle as u32,
        impacts: arguments.impacts as u32,
    };
    let rows = desk.try_map("exponent", values.len(), |n| {
        let map = Map::build(values[n], arguments.restitution)?;
        let start = match (arguments.phase, arguments.velocity) {
            (Some(phase), Some(velocity)) => Map::state(phase, velocity)?,
            _ => start_near_lock(&map, arguments.order as u32),
        };
        let scatter = arguments.scatter.stream(map.restitution(), n as u64)?;
        let scatters = scatter.is_some();
        // A part that scatters or is elastic has no final regime and no lock.
        let (mut ending, mut lock) = (None, None);
        if arguments.restitution < 1.0 && !scatters {
            let endings = Endings::new(values[n], arguments.restitution, arguments.followed())?;
            ending = Some(endings.classify(start));
            lock = Lock::build(values[n], arguments.restitution, arguments.order as u32)?;
        }
        let exponent = match (scatter, arguments.phase) {
            (Some(scatter), _) => measure_scattered(&map, start, settings, scatter)?,
            (None, Some(_)) => measure(&map, start, settings)?,
            (None, None) => measure_several(&map, start, settings)?,
        };
        // Both exponents add up to 2 ln R, as det J = R^2 psi/psi' and the speeds telescope.
        let second = 2.0 * arguments.restitution.ln() - exponent.per_impact.value;
        let rests = matches!(exponent.dynamics, Dynamics::Rest { .. });
        Ok(Row {
            k: values[n],
            second: (!rests && !scatters && second.is_finite()).then_some(second),
            multipliers: lock.map(|lock| lock.multipliers()),
            exponent,
            ending,
        })
    })?;
    if arguments.band && arguments.scatter.scatter > 0.0 {
        let value = arguments.scatter.scatter;
        let accepted = "0 with --band: the band is that of orbits of one restitution";
        let next = "leave one of the two out";
        return Err(Refusal::value("--scatter", value, accepted, next));
    }
    let order = arguments.order as u32;
    let measure = || ChaoticBand::measure(arguments.restitution, order, 1e-3, 20_000);
    let band = arguments.band.then(measure).transpose()?.flatten();
    let report = report(arguments, &rows, band)?;
    output.show(&report, || picture(arguments, &values, &rows, band))
}

/// Number of orbits among which the impacts are divided, unless the user gives a start.
const DEFAULT_ORBITS: usize = 8;

/// The mean exponent of several orbits from neighbouring starts; of the first alone if one rests.
/// One orbit may stay near a transient for some 100 000 impacts, which its own scatter hides.
fn measure_several(map: &Map, start: PartState, settings: ExponentSettings) -> Result<Exponent> {
    let share = ExponentSettings {
        impacts: settings.impacts / DEFAULT_ORBITS as u32,
        ..settings
    };
    if share.impacts < 320 {
        return Ok(measure(map, start, settings)?);
    }
    let near = |n: usize| PartState::new(start.phase + 1e-4 * n as f64, start.velocity);
    let starts: [PartState; DEFAULT_ORBITS] = std::array::from_fn(near);
    let Some(orbits) = measure_together(map, starts, share)? else {
        return Ok(measure(map, start, settings)?);
    };
    let mean_of = |value: fn(&Exponent) -> Estimate| {
        let values = SampleMean::from_values(orbits.iter().map(|one| value(one).value));
        let squares = orbits.iter().map(|one| value(one).error.powi(2));
        let own = squares.sum::<f64>().sqrt() / DEFAULT_ORBITS as f64;
        Estimate {
            value: values.mean().unwrap_or(f64::NAN),
            error: values.error().unwrap_or(0.0).max(own),
        }
    };
    let per_impact = mean_of(|one| one.per_impact);
    let flights = orbits.iter().map(|one| one.flight);
    Ok(Exponent {
        per_impact,
        per_cycle: mean_of(|one| one.per_cycle),
        flight: flights.sum::<f64>() / DEFAULT_ORBITS as f64,
        dynamics: Dynamics::from_exponent(per_impact),
    })
}

struct Row {
    k: f64,
    exponent: Exponent,
    /// The orbit's final regime; `None` if its restitution scatters or is 1.
    ending: Option<Regime>,
    /// The smaller exponent per impact, of an orbit that never rests.
    second: Option<f64>,
    multipliers: Option<Multipliers>,
}

/// Name of the orbit's dynamics. A positive exponent means chaos only if the orbit ends in chaos: a
/// transient has one too, until it comes to rest.
fn describe_motion(row: &Row) -> &'static str {
    match row.exponent.dynamics {
        Dynamics::Regular => "regular",
        Dynamics::Chaotic if row.ending.is_none_or(|ending| ending == Regime::Chaotic) => "chaotic",
        Dynamics::Chaotic if row.ending == Some(Regime::Undecided) => "chaotic so far",
        Dynamics::Chaotic | Dynamics::Undecided => "undecided",
        Dynamics::Rest { .. } => "rest",
    }
}

fields! {
    fn exponents(row: Row, track: Option<Track>, followed: usize) {
        all K => row.k;
        all B => track.map(|track| 1e3 * track.amplitude(row.k));
        all EXPONENT.titled("exponent").digits(5) => finite(row.exponent.per_impact.value);
        all EXPONENT_ERROR.titled("error").digits(2) => finite(row.exponent.per_impact.error);
        all SECOND_EXPONENT.titled("second").digits(5) => row.second;
        data EXPONENT_PER_CYCLE => finite(row.exponent.per_cycle.value);
        data EXPONENT_PER_CYCLE_ERROR => finite(row.exponent.per_cycle.error);
        data MEAN_FLIGHT => finite(row.exponent.flight);
        read MOTION => match row.exponent.dynamics {
            Dynamics::Rest { after } => format!("rest after {after}"),
            _ => describe_motion(row).into(),
        };
        data MOTION => describe_motion(row);
        data REST_AFTER => match row.exponent.dynamics {
            Dynamics::Rest { after } => Some(after),
            _ => None,
        };
        all REGIME => row.ending.map(|ending| ending::describe_regime(ending, *followed));
        data MULTIPLIERS => row.multipliers.map(spell);
        data MULTIPLIER_MODULUS => row.multipliers.map(Multipliers::modulus);
    }
}

fn report(arguments: &Arguments, rows: &[Row], band: Option<ChaoticBand>) -> Result<Printout> {
    let track = arguments.amplitude.b.map(|_| arguments.amplitude.track());
    let track = track.transpose()?;
    let followed = arguments.followed();
    let mut view = exponents(&track, &followed);
    if track.is_none() {
        view = view.without(columns::B);
    }
    let (r, impacts, settle) = (arguments.restitution, arguments.impacts, arguments.settle);
    let scatter = arguments.scatter.scatter;
    let scatter = when(scatter > 0.0, || format!(" scattering by {scatter}"));
    let report = view.printout(rows).heading(format!(
        "R = {r}{scatter}, {impacts} impacts after {settle} to settle; exponents per impact"
    ));
    let band = arguments.band.then(|| match band {
        Some(band) => format!(
            "chaotic band, measured: k = {:.4}..{:.4}, {:.0} % of it with a positive exponent, no rest \
             within {} impacts",
            band.low,
            band.high,
            100.0 * band.chaotic,
            band.impacts
        ),
        None => "no chaotic band: below the cascade the parts come to rest".into(),
    });
    Ok(report.notes(band))
}

pub(super) fn spell(multipliers: Multipliers) -> String {
    match multipliers {
        Multipliers::Real(larger, smaller) => numbers([larger, smaller], 6).join(", "),
        Multipliers::Pair { modulus, angle } => {
            let [modulus, angle] = numbers([modulus, angle], 6);
            format!("{modulus} exp(+-{angle} i)")
        }
    }
}

fn picture(
    arguments: &Arguments,
    values: &[f64],
    rows: &[Row],
    band: Option<ChaoticBand>,
) -> Picture {
    // The exponent of a superstable orbit is far below.
    let exponents = rows.iter().map(|row| row.exponent.per_impact.value);
    let finite = exponents.filter(|exponent| exponent.is_finite());
    let shown = finite.map(|exponent| exponent.max(-3.0)).chain([-0.5, 0.5]);
    let lowest = values.iter().copied().fold(f64::INFINITY, f64::min);
    let highest = values.iter().copied().fold(0.0, f64::max);
    let exponent = Axis::over_values("Lyapunov exponent per impact", "", shown);
    let mut panel = Panel::new(Axis::of_k(lowest, highest), exponent).height(360.0);
    if let Some(band) = band {
        panel = panel.strip("chaotic band, measured", band.low, band.high);
    }
    for (motion, name, series) in [
        ("chaotic", "chaotic", 1),
        ("chaotic so far", "chaotic so far", 3),
        ("regular", "regular", 0),
        ("undecided", "undecided", 4),
        ("rest", "transient: until it came to rest", 2),
    ] {
        let own = rows.iter().filter(|row| describe_motion(row) == motion);
        let points = own.map(|row| (row.k, row.exponent.per_impact.value));
        let points: Vec<_> = points.filter(|point| point.1.is_finite()).collect();
        if !points.is_empty() {
            panel = panel.markers(name, series, points);
        }
    }
    panel = panel.level(0.0, "neighbours part above");
    let (r, impacts) = (number(arguments.restitution, 6), arguments.impacts);
    let place = match values {
        [k] => format!("k = {}", number(*k, 6)),
        _ => format!("each of {} k", values.len()),
    };
    Picture::new("Lyapunov exponent over k")
        .caption(format!("R = {r}, {impacts} impacts at {place}"))
        .panel(panel)
}
