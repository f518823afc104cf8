#![doc = include_str!("../README.md")]
//!
//! # Floors
//!
//! From the ground up; a module uses only those below it. The theory behind them is in `docs/` of the repository, whose
//! sections the comments cite.
//!
//! | module | holds |
//! |---|---|
//! | [`arithmetic`] | binary angles, sine and cosine, number formats |
//! | [`feeder`] | the SI world and its dimensionless parameters |
//! | [`impact`] | the impact map, certified, in every arithmetic; contact; orbits |
//! | [`regime`] | bands, cascades, exponents, classification, capture |
//! | [`transport`] | conveying speed |
//! | [`control`] | the controller: demodulation, amplitude, listening, supervision |
//! | [`plant`] | the simulated feeder that the controller is tried against |
//! | [`wire`] | the messages between board and desk |
#![no_std]
#![deny(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod arithmetic;
#[cfg(feature = "control")]
pub mod control;
pub mod feeder;
pub mod impact;
#[cfg(feature = "plant")]
pub mod plant;
pub mod regime;
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub mod transport;
#[cfg(feature = "wire")]
pub mod wire;
