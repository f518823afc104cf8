//! Identification of the restitution from the impacts of parts that hop and rest.
//!
//! | file | holds |
//! |---|---|
//! | `identifier` | the steps of one identification, and its result |
//! | `chatter` | the impacts of a part thrown from rest, by the map |
//! | `train` | least-squares fit of a train of ringings to a fold |
//! | `fit` | search for the restitution that explains a fold best |

mod chatter;
mod fit;
mod identifier;
mod train;

pub use identifier::{Driven, FIRST_K, Identification, Identified, Identifier, Step, Unidentified};
