//! Final regime of an orbit of the exact map, and its fill in pictures.

use kband::regime::classify::Regime;

pub(crate) use kband_scene::ending::*;

use crate::picture::Fill;

pub(crate) fn fill(regime: Regime) -> Fill {
    match regime {
        Regime::Locked { .. } => Fill::Locked,
        Regime::Doubled { .. } => Fill::Doubled,
        Regime::Periodic { .. } => Fill::Periodic,
        Regime::HopAndRest { .. } => Fill::HopAndRest,
        Regime::Rest => Fill::Rest,
        Regime::Chaotic => Fill::Chaotic,
        Regime::Undecided => Fill::Undecided,
    }
}

/// Fills of regimes with their names, in the order of the legend.
pub const FILLS: [(Fill, &str); 7] = [
    (Fill::Locked, "locked"),
    (Fill::Doubled, "doubled"),
    (Fill::Periodic, "periodic otherwise"),
    (Fill::Chaotic, "chaotic"),
    (Fill::HopAndRest, "hops and rests"),
    (Fill::Rest, "rests for ever"),
    (Fill::Undecided, "chaotic so far"),
];

/// Fills that occur among regimes, with name and number, in the order of the legend.
pub(crate) fn count_fills(regimes: &[Regime]) -> Vec<(Fill, &'static str, usize)> {
    let count = |(counted, name)| {
        let own = regimes.iter().filter(|regime| fill(**regime) == counted);
        (counted, name, own.count())
    };
    let all = FILLS.into_iter().map(count);
    all.filter(|(.., count)| *count > 0).collect()
}

/// Names of the fills that occur on a map of regimes, with their shares.
pub(crate) fn name_shares(regimes: &[Regime]) -> Vec<(Fill, String)> {
    let named = |(fill, name, count): (Fill, &str, usize)| {
        let share = 100.0 * count as f64 / regimes.len() as f64;
        (fill, format!("{name}: {share:.1} %"))
    };
    count_fills(regimes).into_iter().map(named).collect()
}
