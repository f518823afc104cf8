//! The microcontroller kernels have the same bits on every machine, and costs within their bounds.

use std::path::Path;
use std::time::Duration;

use kband_emulated::kernels;
use kband_tests::chip::core::{COUNTER, Fault};
use kband_tests::chip::kind::Kind;
use kband_tests::emulator::{self, Clock, Machine};
use kband_tests::images;
use kband_tests::rig::chip_of;

fn run(bin: &str, machine: Machine, clock: Clock) -> String {
    let image = images::build("kband-emulated", bin, machine);
    emulator::run(&image, machine, clock, &[], Duration::from_secs(240))
}

/// Requests of an image by semihosting (ARM IHI 0068: open, write, exit), and the reason of an exit
/// that passed.
const OPEN: u32 = 0x01;
const WRITE: u32 = 0x05;
const EXIT: u32 = 0x18;
const PASSED: u32 = 0x2_0026;

fn run_on_chip(image: &Path) -> String {
    let mut chip = chip_of(Kind::Stm32f405, image);
    chip.power_on();
    let (core, board) = (&mut chip.core, &mut chip.board);
    let mut text = Vec::new();
    loop {
        core.float = board.float;
        match core.step(board) {
            Ok(_) => continue,
            Err(Fault::Breakpoint) => {}
            Err(fault) => panic!("{fault:?} at {:#x}", core.r[COUNTER]),
        }
        let [request, parameter, ..] = core.r;
        let mut word = |n: u32| board.load(parameter + 4 * n, 4).unwrap();
        match request {
            OPEN => core.r[0] = 1,
            WRITE => {
                let [start, length] = [1, 2].map(&mut word);
                text.extend((start..start + length).map(|at| board.load(at, 1).unwrap() as u8));
                core.r[0] = 0;
            }
            EXIT => {
                assert_eq!(parameter, PASSED);
                return String::from_utf8(text).unwrap();
            }
            other => panic!("request {other:#x}"),
        }
        core.r[COUNTER] += 2;
    }
}

#[test]
fn orbits_have_the_same_bits_on_desk_and_emulated_cpus() {
    let desk = kernels::hashes().map(|(name, hash)| format!("hash {name} {hash:08x}"));
    let chip = images::build("kband-emulated", "kernel_bits", Machine::CortexM4F);
    let machines = [Machine::CortexM4F, Machine::CortexM0];
    let texts = machines.map(|machine| run("kernel_bits", machine, Clock::Free));
    for text in texts.into_iter().chain([run_on_chip(&chip)]) {
        let lines: Vec<_> = text.lines().filter(|l| l.starts_with("hash ")).collect();
        assert_eq!(lines, desk);
    }
}

#[test]
fn an_impact_takes_the_stated_instructions() {
    // The image itself checks the bounds of the kernels.
    let cost = run("kernel_cost", Machine::CortexM4F, Clock::Instructions);
    println!("{cost}");
}
