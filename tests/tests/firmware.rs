//! The firmware on the emulated CPU does the same as the desk; sizes of the images.

use std::time::Duration;

use kband_firmware::trial::{self, Trial};
use kband_plant::{ClosedLoop, Scene};
use kband_tests::chip::kind::Kind;
use kband_tests::emulator::{self, Machine, Options, Output};
use kband_tests::footprint::footprint;
use kband_tests::images;

fn virtual_feeder(word: &'static str, seconds: u64) -> Output {
    let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
    let options = Options {
        word: Some(word),
        ..Options::default()
    };
    emulator::run(&image, options, Duration::from_secs(seconds))
}

fn trace_is_the_desks(name: &'static str) {
    let trial = Trial::named(name).unwrap();
    let mut desk = ClosedLoop::build(&trial.scene()).unwrap();
    let text = virtual_feeder(name, 180).passed();
    let trace: Vec<&str> = text
        .lines()
        .filter(|line| line.starts_with(|first: char| first.is_ascii_digit()))
        .collect();
    assert_eq!(trace.len(), trial.cycles as usize, "{text}");
    for line in trace {
        assert_eq!(line, trial::TraceRow(&desk.cycle().report).to_string());
    }
    let stack = text
        .lines()
        .find(|line| line.starts_with("stack "))
        .unwrap();
    println!("{name}: {stack}");
    let words: Vec<u32> = stack
        .split(' ')
        .filter_map(|word| word.parse().ok())
        .collect();
    // With less than an eighth of the stack free the board raises a fault.
    assert!(words[0] < words[1] - words[1] / 8, "{stack}");
}

#[test]
fn a_track_of_two_tones_is_the_desks_bit_for_bit() {
    trace_is_the_desks("two-tones");
}

#[test]
fn the_default_scene_is_the_desks_bit_for_bit() {
    trace_is_the_desks("default");
}

#[test]
fn an_eventful_scene_is_the_desks_bit_for_bit() {
    trace_is_the_desks("eventful");
}

#[test]
fn parts_that_scatter_are_the_desks_bit_for_bit() {
    trace_is_the_desks("scattering");
    // The trace contains the impacts of the parts: without scatter it differs.
    let scattering = Trial::named("scattering").unwrap().scene();
    let mut constant = scattering.clone();
    constant.scatter.clear();
    constant.disturbances.truncate(2);
    let rows = |scene: &Scene| {
        let mut desk = ClosedLoop::build(scene).unwrap();
        let row = |_| trial::TraceRow(&desk.cycle().report).to_string();
        (0..250).map(row).collect::<Vec<_>>()
    };
    assert_ne!(rows(&scattering), rows(&constant));
}

#[test]
fn images_fit_their_budget() {
    let build = |bin| images::build("kband-firmware", bin, Machine::CortexM4F);
    let nucleo = images::feeder_on(Kind::Stm32g474);
    let sizes = [
        ("feeder for the Nucleo-G474RE", footprint(&nucleo)),
        ("feeder", footprint(&build("feeder"))),
        ("virtual_feeder", footprint(&build("virtual_feeder"))),
    ];
    for (name, size) in sizes {
        println!(
            "{name}: {:.1} KiB of flash, {:.1} KiB of RAM, {:.1} KiB of them stack",
            f64::from(size.flash) / 1024.0,
            f64::from(size.memory) / 1024.0,
            f64::from(size.stack) / 1024.0
        );
        assert!(size.flash > 1024 && size.stack > 1024);
        // The limits of the linker for the boards; the smaller one has 504 KiB for its image. The
        // emulated image also contains the plant of three tones.
        let [flash, ram] = match name {
            "virtual_feeder" => [640, 116],
            _ => [328, 88],
        };
        assert!(size.flash <= flash * 1024 && size.memory <= ram * 1024);
    }
}
