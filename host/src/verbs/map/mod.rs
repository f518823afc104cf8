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
