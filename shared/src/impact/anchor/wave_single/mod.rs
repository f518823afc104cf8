//! The kernel for a CPU with a single-precision FPU on a track of two or three tones.
//!
//! The harmonics at a node of the sine table are nodes of the same table, at two and three times
//! the angle. Each needs two products for its phase angle. The phases at which the track's push
//! `A = -S''` passes k are computed once per track, without f64. They decide which interval holds
//! the first impact. Between humps the gap is concave, and its sign at the interval's end decides.
//! Over a hump the gap is convex, and its ends, tangents or minimum decide.
mod harmonics;
mod launch;
mod search;
mod single;
mod track;

pub use single::Single;
