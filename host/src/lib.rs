//! Host side of kband: the verbs of the command line, and the modules that they use.
//!
//! | module | holds |
//! |---|---|
//! | `arguments` | options shared by the verbs; numbers, ranges and restitutions as typed by a user |
//! | [`refusal`] | the one message of a refused or failed run, and exit status |
//! | [`report`] | tables as text, CSV and JSON |
//! | `file` | files that are written whole or not at all |
//! | `causes` | causes of parts out of gear, and remedies |
//! | [`board`] | a board on the link, and a scene's controller on it |
//! | [`mod@bench`] | comparison of the kernels of the impact map with baselines |
//! | [`chip`] | the board's chip: its image, and access through a debug probe |
//! | [`desk`] | work on all cores, progress, Ctrl-C |
//! | [`ending`] | final regime of an orbit on the exact map |
//! | `page` | one-file pages for the browser |
//! | `picture` | pictures in one style, as SVG, PNG and PDF |
//! | [`random`] | random numbers equal in every run |
//! | [`simulate`] | scenes: read, run, draw and evaluate |
//! | [`provenance`] | provenance of a result, in every file |
//! | `stream` | rows printed one by one |
//! | [`verbs`] | one file per verb |

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
