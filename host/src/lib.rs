//! Host side of kband: the verbs of the command line, and the modules that they use.

pub(crate) mod arguments;
pub(crate) mod bench;
pub mod board;
pub(crate) mod causes;
pub mod chip;
pub mod desk;
pub mod ending;
pub(crate) mod file;
pub(crate) mod page;
pub(crate) mod picture;
pub mod provenance;
pub mod random;
pub mod refusal;
pub(crate) mod report;
pub mod simulate;
pub(crate) mod stream;
pub mod verbs;

pub use report::columns;
