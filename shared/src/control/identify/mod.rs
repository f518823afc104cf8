//! Restitution from the sound of parts that hop and rest.
//!
//! | file | holds |
//! |---|---|
//! | `identifier` | the steps of one identification, and its result |
//! | `chatter` | the impacts of a part thrown from rest, by the map |
//! | `train` | the ringing of a train of impacts, and how much of a fold it explains |
//! | `fit` | which restitution explains a fold best |

mod chatter;
mod fit;
mod identifier;
mod train;

pub use identifier::{Driven, FIRST, Identification, Identified, Identifier, Step, Unidentified};
