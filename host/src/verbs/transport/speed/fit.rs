//! The sensitivity of a regime over its rows.

use kband::regime::classify::Regime;

use super::{Over, Row, hops_on, kin};
use crate::ending::{self, FILLS};

/// The sensitivity of a regime over its rows: the slope of ln V against ln b.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    pub(super) regime: Regime,
    pub(super) rows: usize,
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) slope: f64,
    pub(super) error: f64,
}

pub(super) fn fits(over: &Over, rows: &[Row]) -> Vec<Fit> {
    let mut regimes: Vec<Regime> = Vec::new();
    for row in rows {
        if !regimes.iter().any(|known| kin(*known, row.regime)) {
            regimes.push(row.regime);
        }
    }
    regimes.sort_by_key(|regime| match regime {
        Regime::Locked { order } => *order,
        _ => u32::MAX,
    });
    regimes
        .into_iter()
        .filter_map(|regime| fit(regime, over, rows))
        .collect()
}

/// Meaning of a fit.
pub(super) fn kind(regime: Regime) -> String {
    let fill = ending::fill(regime);
    match regime {
        Regime::Locked { .. } => ending::name(regime),
        _ if hops_on(regime) => "hops on irregularly".into(),
        _ => FILLS
            .iter()
            .find(|known| known.0 == fill)
            .map_or_else(String::new, |known| known.1.into()),
    }
}

/// Whether a regime at one k is the same orbit, or the same chaos, as at the k beside it.
pub(super) fn continues(one: Regime, other: Regime) -> bool {
    match (one, other) {
        (Regime::Doubled { order: a, .. }, Regime::Doubled { order: b, .. }) => a == b,
        (
            Regime::Periodic {
                impacts: p,
                cycles: r,
            },
            Regime::Periodic {
                impacts: q,
                cycles: s,
            },
        ) => u64::from(r) * u64::from(q) == u64::from(s) * u64::from(p),
        _ => kin(one, other),
    }
}

/// One slope for all stretches of neighbouring k in which the regime goes on; each stretch has a
/// level of its own, as locks and what grows out of them have.
pub(super) fn fit(regime: Regime, over: &Over, rows: &[Row]) -> Option<Fit> {
    let mut stretches: Vec<(usize, Vec<&Row>)> = Vec::new();
    for (n, k) in over.k.iter().enumerate() {
        for row in rows
            .iter()
            .filter(|row| row.k == *k && kin(row.regime, regime) && row.mean() > 0.0)
        {
            let open = stretches.iter_mut().find(|(last, stretch)| {
                last + 1 == n
                    && stretch
                        .last()
                        .is_some_and(|before| continues(before.regime, row.regime))
            });
            match open {
                Some((last, stretch)) => {
                    *last = n;
                    stretch.push(row);
                }
                None => stretches.push((n, vec![row])),
            }
        }
    }
    stretches.retain(|(_, stretch)| stretch.len() > 1);
    let (mut squares, mut products, mut heights) = (0.0, 0.0, 0.0);
    for (_, stretch) in &stretches {
        let count = stretch.len() as f64;
        let points = || {
            stretch
                .iter()
                .map(|row| (-row.k.ln(), (row.mean() / row.k).ln()))
        };
        let (x, y) = points().fold((0.0, 0.0), |sum, point| {
            (sum.0 + point.0 / count, sum.1 + point.1 / count)
        });
        for point in points() {
            let (dx, dy) = (point.0 - x, point.1 - y);
            squares += dx * dx;
            products += dx * dy;
            heights += dy * dy;
        }
    }
    let used: usize = stretches.iter().map(|(_, stretch)| stretch.len()).sum();
    let free = used
        .checked_sub(stretches.len() + 1)
        .filter(|free| *free > 0)?;
    let slope = products / squares;
    let k = stretches
        .iter()
        .flat_map(|(_, stretch)| stretch)
        .map(|row| row.k);
    Some(Fit {
        regime,
        rows: used,
        low: k.clone().fold(f64::INFINITY, f64::min),
        high: k.fold(0.0, f64::max),
        slope,
        error: ((heights - slope * products).max(0.0) / free as f64 / squares).sqrt(),
    })
}
