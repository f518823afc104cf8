#![doc = include_str!("../README.md")]
//!
//! # Modules
//!
//! Each module uses only those above it in this table. The theory is in `docs/` of the repository;
//! the comments cite its sections.
//!
//! | module | holds |
//! |---|---|
//! | [`arithmetic`] | binary angles, sine and cosine, number formats |
//! | [`feeder`] | conversion between SI units and dimensionless parameters |
//! | [`impact`] | the impact map in every arithmetic, contact, orbits |
//! | [`regime`] | bands, locks, cascades, exponents, classification, capture, gear |
//! | [`transport`] | conveying speed |
#![no_std]
#![deny(unsafe_code)]

// The detection of the CPU's extensions needs `std`, at the desk.
#[cfg(any(test, all(target_arch = "x86_64", not(target_os = "none"))))]
extern crate std;

pub mod arithmetic;
pub mod feeder;
pub mod impact;
pub mod regime;
pub mod transport;
