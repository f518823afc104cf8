//! Sets the commit of the build, and generates the table of columns.

use std::path::PathBuf;
use std::{env, fs};

#[path = "build/columns.rs"]
mod columns;
#[path = "build/commit.rs"]
mod commit;

const COLUMNS: &str = "src/report/columns.tsv";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=build");
    println!("cargo::rerun-if-changed={COLUMNS}");
    let folder = env::var_os("CARGO_MANIFEST_DIR").map_or_else(PathBuf::new, PathBuf::from);
    let table = fs::read_to_string(folder.join(COLUMNS)).expect("the table of columns is read");
    let out = env::var_os("OUT_DIR").map_or_else(PathBuf::new, PathBuf::from);
    fs::write(out.join("columns.rs"), columns::source(&table)).expect("its constants are written");
    // A debug build does not depend on the commit: it would be compiled again after every commit.
    if env::var_os("PROFILE").is_some_and(|profile| profile == "debug") {
        println!("cargo::rustc-env=KBAND_COMMIT=unknown (a build for tests)");
        return;
    }
    // A missing file would cause a new build each time.
    let watched = ".git/HEAD .git/logs/HEAD host/src shared Cargo.lock";
    let watched = watched.split(' ').map(|path| folder.join("..").join(path));
    for path in watched.filter(|path| path.exists()) {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    println!("cargo::rustc-env=KBAND_COMMIT={}", commit::commit(&folder));
}
