//! kband at the desk: the verbs of the command line and the ground they stand on.
//!
//! | module | holds |
//! |---|---|
//! | `arguments` | options shared by the verbs; numbers, ranges and restitutions as typed by a user |
//! | [`refusal`] | the one message of a refused or failed run, and exit status |
//! | [`report`] | tables: for reading, as CSV, as JSON |
//! | `file` | files that are written whole or not at all |
//! | `causes` | what keeps parts out of gear, and the remedies |
//! | [`board`] | a board on the link, and a scene's controller on it |
//! | [`mod@bench`] | the kernels of the impact map side by side, and the baselines |
//! | [`chip`] | the board's chip: its image, and the way to it through a debug probe |
//! | [`desk`] | work on all cores, progress, Ctrl-C |
//! | [`ending`] | where an orbit of the exact map ends |
//! | `page` | pages for the browser, of one file each |
//! | `picture` | pictures of one house style, SVG and PNG |
//! | `random` | random numbers that are the same in every run |
//! | [`simulate`] | scenes: read, run, drawn and judged |
//! | [`provenance`] | what a result came from, in every file |
//! | `stream` | rows printed as they come |
//! | [`verbs`] | one file per verb |

pub(crate) mod arguments;
pub mod bench;
pub mod board;
pub(crate) mod causes;
pub mod chip;
pub mod desk;
pub mod ending;
pub(crate) mod file;
pub(crate) mod page;
pub(crate) mod picture;
pub mod provenance;
mod random;
pub mod refusal;
pub mod report;
pub mod simulate;
pub(crate) mod stream;
pub mod verbs;
