//! Python bindings of kband: the module `kband._kband`, below the package in `python/kband`.
//!
//! Functions here take and give arrays of one dimension; the package broadcasts and names results.
#![allow(clippy::too_many_arguments, reason = "the package names them")]

mod board;
mod design;
mod feeder;
mod map;
mod refused;
mod regimes;
mod scenes;
mod work;

use pyo3::prelude::*;

/// The functions and types of kband that are written in Rust.
#[pymodule]
mod _kband {
    #[pymodule_export]
    use super::board::{Board, fault_name, state_name};
    #[pymodule_export]
    use super::design::design;
    #[pymodule_export]
    use super::feeder::{Controller, Plant};
    #[pymodule_export]
    use super::map::{impacts, orbits};
    #[pymodule_export]
    use super::regimes::{
        band, basins, capture_plan, diagram, doublings, exponents, gear_plan, gear_shares,
        transport_speeds,
    };
    #[pymodule_export]
    use super::scenes::{Loop, simulate};

    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
