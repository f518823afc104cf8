//! Envelope plant: steps of a drive cycle in closed form.

mod closed_loop;
mod energy;
mod load;
mod onset;
mod plant;
mod recurrence;
mod track_motion;
mod upper;

pub use closed_loop::EnvelopeLoop;
