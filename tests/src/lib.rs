//! What the cross-crate tests share: the machines that programs run on, launches that try a kernel and the
//! oracle that judges it.

pub mod bench;
pub mod broken;
pub mod certificate;
pub mod day;
pub mod desk;
pub mod exact;
pub mod footprint;
pub mod oracle;
pub mod proof;
pub mod soak;
pub mod states;
pub mod tones;
pub mod verdict;

pub use kband_machines::{
    chip, count, draw, emulator, hazards, images, probe, rig, root, terminal,
};
