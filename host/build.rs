//! Tells the crate which commit it is built from.

use std::env;
use std::path::{Path, PathBuf};

#[path = "build/commit.rs"]
mod commit;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=build/commit.rs");
    let folder = env::var_os("CARGO_MANIFEST_DIR").map_or_else(PathBuf::new, PathBuf::from);
    // A build for tests is made anew with every change of a source; it would be with every commit as well.
    if env::var_os("PROFILE").is_some_and(|profile| profile == "debug") {
        println!("cargo::rustc-env=KBAND_COMMIT=unknown (a build for tests)");
        return;
    }
    let root = folder.join("..");
    for path in [
        ".git/HEAD",
        ".git/logs/HEAD",
        "host/src",
        "shared",
        "Cargo.lock",
    ] {
        watch(&root.join(path));
    }
    println!("cargo::rustc-env=KBAND_COMMIT={}", commit::commit(&folder));
}

/// What is not there would be looked for again in every build.
fn watch(path: &Path) {
    if path.exists() {
        println!("cargo::rerun-if-changed={}", path.display());
    }
}
