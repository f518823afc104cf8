//! The impact map in integers alone, for a CPU without an FPU (Cortex-M0+, M3).
//!
//! The same search as in the kernels with an FPU, on exact heights: the phase is an integer, so a
//! flight to a table node or to the end of a hump has an exact time, and its height follows from 64-bit
//! products. No 64-bit division, and 32-bit ones only by a reciprocal from a table.

mod approach;
mod ballistic;
mod constants;
mod map;
mod search;
mod settle;
mod short;

pub use map::Integer;
