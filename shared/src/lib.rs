#![doc = include_str!("../README.md")]
//!
//! # Floors
//!
//! From the ground up; a module uses only those below it. The theory behind them is in `docs/` of the repository, whose
//! sections the comments cite.
//!
//! | module | holds | with the feature |
//! |---|---|---|
//! | [`arithmetic`] | binary angles, sine and cosine, number formats | |
//! | [`feeder`] | the SI world and its dimensionless parameters | |
//! | [`impact`] | the impact map, certified, in every arithmetic; contact; orbits | |
//! | | on tracks of several tones, and many orbits at a time | `analysis` |
//! | [`regime`] | bands and locks | |
//! | | cascades, exponents, classification, capture, gear | `analysis` |
//! | `transport` | conveying speed | `analysis` |
//! | `control` | the controller: demodulation, amplitude, listening, supervision | `control` |
//! | `plant` | the simulated feeder that the controller is tried against | `plant` |
//! | `wire` | the messages between board and desk | `wire` |
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
