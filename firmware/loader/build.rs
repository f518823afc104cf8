//! Build script: memory of the loaders.

use std::{env, fs, path::PathBuf};

/// Memory for `memory.x`: flash before an update's state or the key, RAM of the program's stack.
const MEMORY: &str = "MEMORY
{
  FLASH : ORIGIN = 0x08000000, LENGTH = DEFINED(one_slot) ? 22K : 4K
  RAM   : ORIGIN = 0x20000000, LENGTH = DEFINED(one_slot) ? 32K : 8K
}
";

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let out = PathBuf::from(env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::write(out.join("board.x"), MEMORY).expect("OUT_DIR is writable");
    println!("cargo:rustc-link-search={}", out.display());
    for argument in ["--nmagic", "-Tlink.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
    println!("cargo:rustc-link-arg-bin=receiver=--defsym=one_slot=1");
}
