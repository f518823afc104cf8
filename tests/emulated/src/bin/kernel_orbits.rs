//! Orbits for counting instructions by class. Each orbit runs twice: first
//! the transient, then as many impacts again.
#![cfg_attr(target_os = "none", no_std, no_main)]

use core::hint::black_box;

use kband_emulated::kernels::{IMPACTS, Machine, ORBITS, begin, fly};

kband_emulated::image!(run);

fn run() {
    orbits::<kband::impact::Single>();
}

fn orbits<K: Machine>() {
    for values in ORBITS {
        let (kernel, start) = begin::<K>(black_box(values));
        let settled = fly(&kernel, start, IMPACTS);
        black_box(fly(&kernel, settled, IMPACTS));
    }
}
