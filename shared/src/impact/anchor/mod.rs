//! The kernels for a CPU with a single-precision FPU, and the search for the first impact that they
//! share, anchored on table nodes.
//!
//! The flight time at which the height `u` is evaluated is free. It is chosen such that the phase
//! falls on a node of the sine table. There sine and cosine are table constants, and the reduction
//! modulo 2 pi is a mask. All derivatives of the local expansion
//! `u(D + d) = u0 + u1 d - k d^2/2 + S (1 - cos d) + C (d - sin d)` follow from them.
//!
//! A closed form isolates the first root of `u = y - sin`, where `y` is the ballistic parabola. `u`
//! is convex on the hump, where `sin > k` (from `arcsin k` to `pi - arcsin k`), and concave
//! elsewhere. At both ends of a hump `sin = k` exactly, so the segment of the root follows from `y`
//! alone. An earlier hump may poke through the parabola. A closed test on its ends and middle
//! decides that in nearly every case, a one-dimensional minimum in the rest.
mod approach;
mod candidate;
mod flight;
mod search;
mod settle;
mod short;
mod sine_track;
mod single;
mod solve;
mod wave_single;

pub use single::SingleState;
pub use wave_single::Single;
