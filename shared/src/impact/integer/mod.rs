//! The impact map in integers alone, for a CPU without an FPU (Cortex-M0+, M3).
//!
//! The search is that of the kernels with an FPU, on exact heights. The phase is an integer, so a
//! flight to a table node or to a hump's end has an exact time. Its height follows from 64-bit
//! products. There is no 64-bit division; 32-bit ones use a reciprocal table.
//!
//! Most constants choose between two ways to the same impact and were tuned for instructions. Each
//! was set to a quarter to four times its value, to 0 and to the largest that fits, over 420 000
//! launches. The launches are fast, slow, from rest, about lift-off, at k near 1, and 60 000 graze.
//! The same impacts stay wrong (13) and flagged (19 991). The error that one in a hundred exceeds
//! changes by less than a tenth. Exceptions are in docs/tuning.md.

mod approach;
mod ballistic;
mod constants;
mod map;
mod search;
mod settle;
mod short;

pub use map::Integer;
