//! Identification of the restitution from the impacts of parts that hop and rest.

mod bounce_train;
mod fit;
mod identifier;
mod ringing;

pub use identifier::{Driven, FIRST_K, Identification, Identified, Identifier, Step, Unidentified};
