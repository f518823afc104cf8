//! The kernel for a CPU with a single-precision FPU on a track of two or three tones.
//!
//! At a node of the sine table the harmonics stand on nodes of the same table, twice and three times as far, turned by their
//! angle: two products each. Where the track's push `A = -S''` passes k is found once per track, without f64, so that
//! which stretch holds the first impact is decided there: on the concave ones between humps by the sign of
//! the gap at their ends, over a hump, where the gap is convex, by its ends, its tangents or its minimum.
mod flight;
mod harmonics;
mod launch;
mod search;
mod single;
mod track;

pub use single::WaveSingle;
