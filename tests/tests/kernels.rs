//! The microcontroller kernels: the same bits everywhere, at the promised cost.

use std::time::Duration;

use kband_emulated::kernels;
use kband_tests::emulator::{self, Clock, Machine, Options};
use kband_tests::images;

fn run(bin: &str, machine: Machine, clock: Clock) -> String {
    let image = images::build("kband-emulated", bin, machine);
    let options = Options {
        machine,
        clock,
        ..Options::default()
    };
    emulator::run(&image, options, Duration::from_secs(240)).passed()
}

#[test]
fn orbits_have_the_same_bits_on_desk_and_emulated_cpus() {
    let desk: Vec<_> = kernels::hashes()
        .map(|(name, hash)| format!("hash {name} {hash:08x}"))
        .collect();
    for machine in [Machine::CortexM4F, Machine::CortexM0] {
        let text = run("kernel_bits", machine, Clock::Free);
        let lines: Vec<_> = text.lines().filter(|l| l.starts_with("hash ")).collect();
        assert_eq!(lines, desk, "{machine:?}");
    }
}

#[test]
fn an_impact_takes_the_stated_instructions() {
    // The image asserts the bounds of the kernels.
    let cost = run("kernel_cost", Machine::CortexM4F, Clock::Instructions);
    println!("{cost}");
}
