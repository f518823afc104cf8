//! Identification of the restitution from the impacts of parts that hop and rest.

mod chatter;
mod fit;
mod identifier;
mod train;

pub use identifier::{Driven, FIRST_K, Identification, Identified, Identifier, Step, Unidentified};
