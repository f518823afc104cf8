//! The impact map in integers alone, for a CPU without an FPU (Cortex-M0+, M3).
//!
//! The same search as in the kernels with an FPU, on exact heights: the phase is an integer, so a
//! flight to a table node or to the end of a hump has an exact time, and its height follows from 64-bit
//! products. No 64-bit division, and 32-bit ones only by a reciprocal from a table.
//!
//! Most constants choose between two ways to the same impact and were tuned for instructions. Tried one by one at a quarter to
//! four times their value, and at 0 and the largest that has room, over 420 000 launches (fast, slow, from rest, about
//! lift-off, at k near 1, 60 000 of them grazing), they leave the same impacts wrong (13) and flagged (19 991), and the error that
//! one in a hundred exceeds within a tenth. Where that is not so it is said at the constant.

mod approach;
mod ballistic;
mod constants;
mod map;
mod search;
mod settle;
mod short;

pub use map::Integer;
