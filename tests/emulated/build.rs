//! Build script: links an image for the memory of its target machine.

use std::{env, fs, path::PathBuf};

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=microbit.x");
    println!("cargo::rerun-if-changed=../../memory.x");
    println!("cargo::rerun-if-changed=../../firmware/stm32f405rg.x");
    let target = env::var("TARGET").expect("cargo sets TARGET");
    let here = env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    if target.starts_with("thumbv6m") {
        println!("cargo::rustc-link-arg-bins=-T{here}/microbit.x");
    } else if target.starts_with("thumb") {
        let folder = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
        for (file, name) in [
            ("memory.x", "memory.x"),
            ("firmware/stm32f405rg.x", "board.x"),
        ] {
            fs::copy(format!("../../{file}"), folder.join(name))
                .expect("the board's memory is described");
        }
        println!("cargo::rustc-link-search={}", folder.display());
        println!("cargo::rustc-link-arg-bins=-Tlink.x");
    }
}
