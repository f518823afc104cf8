//! `kband cascade`: the period doublings below a band.

use kband::regime::cascade::{Cascade, CascadeEnd, DoubledOrbit, FEIGENBAUM, MAX_DOUBLINGS};

use super::exponent::spell;
use crate::arguments::{self, NoScatter, OutputArguments, ToneArguments};
use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::{Exit, Refusal, Result};
use crate::report::{Printout, fields, number};

/// Locate the period doublings of the locked orbit, down to chaos.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband cascade --restitution 0.2 --order 1 --doublings 6
  kband cascade --restitution 0.2 --out cascade.svg
  kband cascade --restitution 0.5 --order 2 --doublings 5 --format json
  kband cascade --restitution 0.2 --second-tone 0.1,2.487
  kband cascade --restitution 0.2 --noise 0.01

JSON has flips (k of the doublings 1->2, 2->4, ...), ratios of their distances, and k_infinity.")]
pub struct Arguments {
    /// Restitution of the part, 0..1, 1 excluded.
    #[arg(long, value_name = "R", default_value = "0.2", value_parser = arguments::number)]
    restitution: f64,
    /// Order of the lock that doubles: drive cycles per impact.
    #[arg(long, value_name = "r", default_value = "1", value_parser = arguments::count(1, 100))]
    order: usize,
    /// Number of period doublings to locate.
    #[arg(long, value_name = "N", default_value = "6", value_parser = arguments::count(1, MAX_DOUBLINGS))]
    doublings: usize,
    #[command(flatten)]
    tones: ToneArguments,
    /// Scatter of restitution over its mean, 0..1. It shows which doublings remain visible.
    #[arg(long, value_name = "SIGMA", value_parser = arguments::number)]
    noise: Option<f64>,
    #[command(flatten)]
    scatter: NoScatter,
    #[command(flatten)]
    output: OutputArguments,
}

pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit> {
    let output = arguments.output.check()?;
    arguments.scatter.check(
        "with scatter no orbit repeats, so no period can double",
        "use --noise for the doublings that remain visible, or kband exponent --scatter",
    )?;
    if let Some(noise) = arguments.noise.filter(|noise| !(0.0..=1.0).contains(noise)) {
        let accepted = "0..1, the standard deviation of restitution over its mean";
        let next = "0.05 is scatter by 5 %";
        return Err(Refusal::value("--noise", noise, accepted, next));
    }
    let (restitution, order) = (arguments.restitution, arguments.order as u32);
    let wave = arguments.tones.wave()?;
    let cascade = if wave.is_sine() {
        Cascade::locate(restitution, order, arguments.doublings)?
    } else {
        Cascade::on_tones(&wave, restitution, order, arguments.doublings)?.ok_or_else(|| {
            let next = "kband bands with the same tones shows what ends them";
            Refusal::new("no band of this order ends in a flip on these tones", next)
        })?
    };
    let report = report(arguments, &cascade);
    output.show(&report, || picture(arguments, &cascade))
}

fn picture(arguments: &Arguments, cascade: &Cascade) -> Picture {
    let flips = cascade.flips();
    let last = flips.len() as f64 + 0.5;
    let numbered = || Axis::new("flip, 1 for 1 → 2 impacts a period", "", 0.5, last);
    let points: Vec<(f64, f64)> = (1..).map(f64::from).zip(flips.iter().copied()).collect();
    let k = Axis::over_values("k = g cos α / (b ω²)", "", flips.iter().copied());
    let mut places = Panel::new(numbered(), k)
        .height(230.0)
        .line("", 0, points.clone())
        .markers("flips", 0, points.clone());
    if let Some(limit) = cascade.k_infinity() {
        places = places.level(limit.value, "chaos begins");
    }
    let gaps = points
        .windows(2)
        .map(|pair| (pair[1].0, pair[0].1 - pair[1].1));
    let gaps: Vec<(f64, f64)> = gaps.collect();
    let (restitution, order) = (number(arguments.restitution, 6), arguments.order);
    let mut picture = Picture::new("Period doublings down to chaos")
        .caption(format!("R = {restitution}, lock of order {order}"))
        .panel(places);
    if let (Some(first), Some(end)) = (gaps.first().copied(), gaps.last().copied()) {
        // Feigenbaum's law through the last gap, which follows it best.
        let law = |(n, _): &(f64, f64)| (*n, end.1 * FEIGENBAUM.powf(end.0 - n));
        let law = gaps.iter().map(law).collect();
        let axis = Axis::new("gap to the flip before", "", 0.4 * end.1, 2.5 * first.1);
        picture = picture.panel(
            Panel::new(numbered(), axis.logarithmic())
                .height(230.0)
                .line("shrinking by Feigenbaum's 4.669", 1, law)
                .markers("gaps", 0, gaps),
        );
    }
    picture
}

fields! {
    /// Doubling number n, from 0.
    fn flip(n: usize, flips: [f64], ratios: [f64], visible: [Option<f64>], orbits: [Option<DoubledOrbit>]) {
        table FLIP => format!("{} -> {}", 1_u32 << n, 2_u32 << n);
        table K.digits(15) => flips[*n];
        table GAP.digits(8) => n.checked_sub(1).map(|before| flips[before] - flips[*n]);
        table RATIO.digits(8) => n.checked_sub(2).and_then(|n| ratios.get(n)).copied();
        table VISIBLE_BELOW.titled("seen below sigma").digits(3) => visible[*n];
        table MULTIPLIERS => orbits[*n].map(|orbit| spell(orbit.multipliers));
        table EXPONENT.digits(4) => orbits[*n].map(|orbit| orbit.exponents()[0]);
        table SECOND_EXPONENT.titled("second").digits(4) => orbits[*n].map(|orbit| orbit.exponents()[1]);
    }
}

fields! {
    fn doubled_orbit(orbit: DoubledOrbit) {
        json K => orbit.k;
        json IMPACTS => orbit.impacts;
        json MULTIPLIERS => spell(orbit.multipliers);
        json MULTIPLIER_MODULUS => orbit.multipliers.modulus();
        json EXPONENT => orbit.exponents()[0];
        json SECOND_EXPONENT => orbit.exponents()[1];
    }
}

fn report(arguments: &Arguments, cascade: &Cascade) -> Printout {
    let flips = cascade.flips();
    let doubled: Vec<Option<DoubledOrbit>> = cascade.doubled_orbits().collect();
    let visible: Vec<Option<f64>> = cascade.max_visible_scatters().collect();
    let ratios: Vec<f64> = cascade.ratios().collect();
    let rows: Vec<usize> = (0..flips.len()).collect();
    let limit = cascade.k_infinity();
    let orbits: Vec<_> = doubled.iter().copied().flatten().collect();
    let (r, order, k1) = (arguments.restitution, arguments.order, cascade.birth());
    let heading = format!("R = {r}, order {order}: born at k1 = {k1:.15}");
    let view = flip(flips, &ratios, &visible, &doubled);
    let report = view.printout(&rows).folded().heading(heading);
    let chaos = limit.map(|limit| {
        format!(
            "chaos begins at k_infinity = {:.12} within {:.1e}; the ratios tend to {FEIGENBAUM:.5}",
            limit.value, limit.error
        )
    });
    let count = arguments.noise.map(|noise| {
        // Beyond the last flip, each further one tolerates 6.62 times less noise.
        let is_visible = |limit: &&Option<f64>| limit.is_some_and(|limit| noise < limit);
        visible.iter().take_while(is_visible).count()
    });
    let scattered = arguments.noise.zip(count).map(|(noise, count)| {
        let (percent, all) = (number(100.0 * noise, 4), visible.len());
        format!(
            "restitution scattered by {percent} % of its mean shows {count} of these {all} doublings; each further one \
             needs 6.62 times less, and the exponent where chaos begins grows like sigma^0.3668"
        )
    });
    let complete = cascade.end() == CascadeEnd::Complete;
    let lost = (!complete).then(|| format!(
        "the flip after the last could not be followed: at R = {r} the doubled orbit loses a flight or \
         the gaps have come down to rounding"
    ));
    let report = report.note(
        "Floquet multipliers and both exponents are those of the orbit born at the flip, in the middle of its window; the exponents \
         add up to 2 ln R",
    );
    report
        .notes([chaos, scattered, lost].into_iter().flatten())
        .json(serde_json::json!({
            "restitution": r,
            "order": order,
            "k1": k1,
            "flips": flips,
            "ratios": ratios,
            "k_infinity": limit.map(|limit| limit.value),
            "k_infinity_error": limit.map(|limit| limit.error),
            "complete": complete,
            "doubled": doubled_orbit().objects(&orbits),
            "visible_below": visible,
            "noise": arguments.noise,
            "visible": count,
        }))
}
