//! The impact map in f64 on a track of two or three tones, `S = sin t + e sin(2 t + th) + e3 sin(3 t + th3)`.
//!
//! Everything of the map holds with S for the sine and S' for the cosine (docs/theory-real-parts.md#t10.3). What a sine gives in closed form,
//! where the track's acceleration passes k, is found once per track: [`Wave`](super::Wave) knows every extremum of S and
//! its derivatives, [`track`] the humps for one k, of which a turn may hold up to three. From there
//! [`first`] finds the first impact, and [`search`] what closed forms leave open.
//!
//! A track of one tone has its own kernel, [`Map`](super::Map), which pays nothing for this one.

mod first;
mod launch;
mod map;
mod search;
mod short;
pub(super) mod track;

pub use map::WaveMap;
