//! Final regime of an orbit of the exact map, and its fill in pictures.

use kband::regime::classify::Regime;

pub use kband_scene::ending::*;

use crate::picture::Fill;

/// Fill of a regime in pictures.
pub fn fill(regime: Regime) -> Fill {
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

/// The fills of regimes with their names, in the order of a legend.
pub const FILLS: [(Fill, &str); 7] = [
    (Fill::Locked, "locked"),
    (Fill::Doubled, "doubled"),
    (Fill::Periodic, "periodic otherwise"),
    (Fill::Chaotic, "chaotic"),
    (Fill::HopAndRest, "hops and rests"),
    (Fill::Rest, "rests for ever"),
    (Fill::Undecided, "chaotic so far"),
];
