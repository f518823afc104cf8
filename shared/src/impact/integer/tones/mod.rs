//! The impact map in integers on a track of two or three tones.
//!
//! Where the kernels with an FPU keep a second harmonic in f32, each derivative of it has places of its own here: S in 30,
//! modulo 4, with a coarse one of 27 beside it; S' in 26, A in 27, A' and A'' in 13 of 16 bits, for they stand before the
//! third and the fourth power of a step. The stretches between edges, and why one root ends each, are those of the
//! kernels with an FPU.
mod constants;
mod flight;
mod map;
mod search;
mod short;

pub use map::WaveInteger;
