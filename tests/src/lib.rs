//! Shared code of the cross-crate tests: emulated machines, launches for the kernels, and their
//! oracle.

pub mod bench;
pub mod broken;
pub mod exact;
pub mod oracle;
pub mod scenes;
pub mod soak;
pub mod states;
pub mod verdict;

pub use kband_machines::{
    bus, chip, draw, emulator, hazards, images, on_both, rig, root, terminal,
};
