//! Instructions per impact of the kernels for microcontrollers, one line per kernel and workload:
//! `instructions KERNEL WORKLOAD m4f|m0 COUNT`. To be run with the emulator's clock on instructions.
#![cfg_attr(target_os = "none", no_std, no_main)]

use core::hint::black_box;

use kband::impact::{Hybrid, Single};
#[cfg(target_os = "none")]
use kband_emulated::Counter;
use kband_emulated::kernels::{CHATTER, Machine, ORBITS, begin, fall, fly, states};
use kband_emulated::say;

kband_emulated::image!(run);

const CPU: &str = if cfg!(target_has_atomic = "32") {
    "m4f"
} else {
    "m0"
};

fn run() {
    let mut counter = Counter::start();
    measure::<Hybrid>(&mut counter, 480);
    measure::<Single>(&mut counter, 340);
}

fn measure<K: Machine>(counter: &mut Counter, _limit: u32) {
    let count = 500;
    let mut orbit = |values| {
        let (kernel, start) = begin::<K>(values);
        // The first impacts bring the orbit to where it stays.
        let settled = fly(&kernel, start, 100);
        counter.count(|| {
            black_box(fly(&kernel, settled, count));
        }) / u64::from(count)
    };
    let mut sum = 0;
    for values in ORBITS {
        let cost = orbit(values);
        say!(
            "instructions {} orbit-{}-{} {CPU} {cost}",
            K::NAME,
            values[0],
            values[1]
        );
        sum += cost;
    }
    say!(
        "instructions {} orbits {CPU} {}",
        K::NAME,
        sum / ORBITS.len() as u64
    );
    say!("instructions {} chatter {CPU} {}", K::NAME, orbit(CHATTER));
    for (name, top) in [("high", 20.0), ("low", 3.0)] {
        let (kernels, states) = states::<K>(top);
        let cost = counter.count(|| {
            black_box(fall(&kernels, &states));
        }) / states.len() as u64;
        say!("instructions {} {name} {CPU} {cost}", K::NAME);
    }
}
