//! The verbs of the impact map: bands, regimes, orbits and speeds.

pub(super) mod bands;
pub(super) mod basins;
pub(super) mod capture;
pub(super) mod cascade;
pub(super) mod diagram;
pub(super) mod exponent;
pub(super) mod gear;
pub mod impacts;
pub(super) mod margins;
pub(super) mod paper;
pub(super) mod transport;

use kband::feeder::Restitution;
use kband::impact::ContactTime;
use kband::regime::band::{Band, BandError, NoBand};

use crate::refusal::Result;
use crate::report::span;

fn describe_lot(lot: Restitution) -> String {
    format!("R = {}", span(lot.low(), lot.high(), 6))
}

/// The band that all parts of a lot share, or the reason why there is none.
fn common_band(lot: Restitution, order: u32, contact: ContactTime) -> Result<Result<Band, NoBand>> {
    match Band::common_with_contact(lot, order, contact) {
        Ok(band) => Ok(Ok(band)),
        Err(BandError::Empty(none)) => Ok(Err(none)),
        Err(BandError::OutOfRange(refused)) => Err(refused.into()),
    }
}
