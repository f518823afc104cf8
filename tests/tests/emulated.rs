//! Self-checks of the library on the emulated CPU.

use std::time::Duration;

use kband_tests::emulator::{self, Machine, Options};
use kband_tests::images;

#[test]
fn checks_pass_on_the_emulated_cpu() {
    let image = images::build("kband-emulated", "checks", Machine::CortexM4F);
    let text = emulator::run(&image, Options::default(), Duration::from_secs(120)).passed();
    println!("{text}");
    assert!(text.contains("golden impacts"), "{text}");
}
