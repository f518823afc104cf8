//! The impact map in f64 on a track of two or three tones.
//!
//! `S = sin t + e sin(2 t + th) + e3 sin(3 t + th3)` replaces the sine, S' the cosine
//! (docs/theory-real-parts.md#t10.3). On a sine the phases at which the push passes k have a closed
//! form. Here they are computed once per track. [`Wave`](super::Wave) holds every extremum of S and
//! its derivatives. [`track`] holds the humps for one k, up to three in a turn. From there
//! [`first`] finds the first impact, and [`search`] the cases without a closed form.
//!
//! A track of one tone has its own kernel, [`Map`](super::Map), at no extra cost.

mod first;
mod launch;
mod map;
mod search;
mod short;
pub(super) mod track;

pub use map::{Hop, WaveMap};
