//! Shared code of the cross-crate tests: emulated machines, launches for the kernels, and their
//! oracle.

use kband_control::State;
use kband_plant::{ClosedLoop, Scene};

mod bench;
pub mod broken;
pub mod exact;
pub mod oracle;
pub mod scenes;
pub mod soak;
pub mod states;
mod verdict;

/// A whole number from the environment; `otherwise` without it. It panics at another text.
pub fn number(variable: &str, otherwise: u64) -> u64 {
    std::env::var(variable).map_or(otherwise, |text| {
        let number = text.parse();
        number.unwrap_or_else(|_| panic!("{variable} = {text}"))
    })
}

/// Amplitude (b) of the simulation at the desk in mm after some cycles. It panics at another state.
pub fn desk_amplitude(scene: &Scene, cycles: usize, state: State) -> f64 {
    let mut desk = ClosedLoop::build(scene).expect("a scene");
    let last = (0..cycles).map(|_| desk.cycle().report).last().unwrap();
    assert_eq!(last.state, state);
    f64::from(last.amplitude) * 1e3
}

pub use kband_machines::{
    bus, chip, draw, emulator, hazards, images, on_both, rig, root, terminal,
};
