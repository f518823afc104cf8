//! The kernels for a CPU with a single-precision FPU, and the search for the first impact that they
//! share, anchored on table nodes.
//!
//! The flight time at which the height `u` is evaluated is free, so it is chosen such that the
//! phase falls on a node of the sine table: sine and cosine there are table constants, the
//! reduction modulo 2 pi is a mask, and the local expansion
//! `u(D + d) = u0 + u1 d - k d^2/2 + S (1 - cos d) + C (d - sin d)` has all its derivatives for
//! free.
//!
//! Which root is the first is decided in closed form. With `y` the ballistic parabola and
//! `u = y - sin`: `u` is convex where `sin > k` (the hump, from `arcsin k` to `pi - arcsin k`) and
//! concave elsewhere, and at both ends of a hump `sin = k` exactly. So the segment that holds the
//! root follows from `y` alone, unless an earlier hump pokes through the parabola, which a closed
//! test on its ends and middle decides in nearly every case, a one-dimensional minimum in the rest.
mod approach;
mod candidate;
mod flight;
mod hybrid;
mod search;
mod settle;
mod short;
mod sine_track;
mod single;
mod solve;
mod wave_single;

pub use hybrid::Hybrid;
pub use single::{Single, SingleState};
pub use wave_single::WaveSingle;
