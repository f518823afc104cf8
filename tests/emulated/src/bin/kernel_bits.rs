//! Hashes over the bits of long orbits, one line per kernel: `hash KERNEL HASH`.
#![cfg_attr(target_os = "none", no_std, no_main)]

use kband_emulated::{emit, kernels};

kband_emulated::image!(run);

fn run() {
    for (name, hash) in kernels::hashes() {
        emit!("hash {name} {hash:08x}");
    }
}
