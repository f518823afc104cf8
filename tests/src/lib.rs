//! Shared code of the cross-crate tests: emulated machines, launches for the kernels, and the
//! oracle that judges them.

pub mod bench;
pub mod broken;
pub mod exact;
pub mod oracle;
pub mod scenes;
pub mod soak;
pub mod states;
pub mod verdict;

pub use kband_machines::{bus, chip, draw, emulator, images, rig, root, terminal};
