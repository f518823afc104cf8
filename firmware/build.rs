//! Build script: the board of the image, its memory map and linker scripts.

use object::{Object, ObjectSegment};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// Stack of each image, bytes: its largest use plus a third. The stack of the emulated image also
/// holds the plant and its counters.
const STACKS: [(&str, u32); 2] = [("feeder", 55 << 10), ("virtual_feeder", 76 << 10)];

/// Size of the part of the flash before the slot of a chip with one slot, bytes. `kband flash`
/// erases the key in it.
const BEFORE_SLOT: usize = 24 << 10;

/// Cargo features of the boards, with the names of their memory maps.
const BOARDS: [&str; 2] = ["stm32f405rg", "stm32g474re"];

const FLASH: u64 = 0x0800_0000;

fn main() {
    println!("cargo:rustc-env=KBAND_BUILD={}", commit());
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let out = PathBuf::from(env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    let board = board();
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let memory = here.join(format!("{board}.x"));
    fs::copy(memory, out.join("board.x")).expect("the board's memory is described");
    fs::write(out.join("chip.x"), chip(board)).expect("OUT_DIR is writable");
    for folder in [&out, &here.join("scripts"), &here.join("..")] {
        println!("cargo:rustc-link-search={}", folder.display());
    }
    for argument in ["--nmagic", "-Tlink.x", "-Tlayout.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
    for (image, stack) in STACKS {
        println!("cargo:rustc-link-arg-bin={image}=--defsym=kband_stack={stack}");
    }
    build_loader(board, &out);
    println!("cargo:rustc-link-arg-bin=feeder=--defsym=kband_slot=1");
    let bounded = (board == "stm32g474re").then_some("bounded.x");
    for script in ["budget.x", "chip.x", "checked.x"]
        .into_iter()
        .chain(bounded)
    {
        println!("cargo:rustc-link-arg-bin=feeder=-T{script}");
    }
    println!("cargo:rustc-link-arg-bin=virtual_feeder=-Temulated.x");
}

/// Name of the board: the cargo feature that is on.
fn board() -> &'static str {
    let feature = |board: &&str| env::var_os(format!("CARGO_FEATURE_{}", board.to_uppercase()));
    let chosen: Vec<&str> = (BOARDS.into_iter().filter(|board| feature(board).is_some())).collect();
    match chosen[..] {
        [board] => board,
        _ => panic!(
            "{} boards are chosen; choose one: --no-default-features --features {}",
            chosen.len(),
            BOARDS.join("|")
        ),
    }
}

/// Builds the loader with this build's toolchain, in a separate folder, as `loader.bin` of `out`.
fn build_loader(board: &str, out: &Path) {
    let (bin, size) = match board {
        "stm32f405rg" => ("loader", 0),
        _ => ("receiver", BEFORE_SLOT),
    };
    let target = env::var("TARGET").expect("cargo sets TARGET");
    let folder = out.join("loader");
    let mut cargo = Command::new(env::var_os("CARGO").expect("cargo sets CARGO"));
    // The path of the compiler's wrapper is relative to the workspace.
    cargo.current_dir("..");
    cargo.args(["build", "--quiet", "--locked", "--profile", "firmware"]);
    cargo.args(["--package", "kband-loader", "--bin", bin]);
    if bin == "loader" {
        cargo.arg("--no-default-features");
    }
    cargo.args(["--target", &target]);
    cargo.arg("--target-dir").arg(&folder);
    // A checker such as Clippy as wrapper would compile nothing.
    cargo.env_remove("RUSTC_WORKSPACE_WRAPPER");
    assert!(cargo.status().is_ok_and(|status| status.success()));
    let loader = fs::read(folder.join(target).join("firmware").join(bin)).expect("it was built");
    let loader = object::File::parse(&*loader).expect("an ELF file");
    let mut bytes: Vec<u8> = Vec::new();
    for segment in loader.segments() {
        let data = segment.data().expect("a segment's bytes");
        if !data.is_empty() {
            bytes.resize((segment.address() - FLASH) as usize, 0xff);
            bytes.extend(data);
        }
    }
    bytes.resize(bytes.len().max(size), 0xff);
    fs::write(out.join("loader.bin"), bytes).expect("OUT_DIR is writable");
}

/// Section with the name of the chip, which the programmer of the image checks.
fn chip(board: &str) -> String {
    let name: String = board.bytes().map(|byte| format!("BYTE({byte}) ")).collect();
    format!("SECTIONS {{ .chip 0 (INFO) : {{ {name}}} }}\n")
}

/// Sources of an image. An uncommitted change of them marks the image.
const SOURCES: [&str; 6] = [
    ".cargo",
    "Cargo.lock",
    "Cargo.toml",
    "firmware",
    "memory.x",
    "shared",
];

/// Commit of the image, "-dirty" if its sources differ from it; "unknown" outside a repository.
fn commit() -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        output.status.success().then(|| text.trim().to_owned())
    };
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo:rerun-if-changed={log}");
    }
    for source in SOURCES {
        println!("cargo:rerun-if-changed=../{source}");
    }
    let Some(commit) = git(&["rev-parse", "--short=12", "HEAD"]) else {
        return "unknown".to_owned();
    };
    let mut status = vec!["-C", "..", "status", "--porcelain", "--"];
    status.extend(SOURCES);
    match git(&status) {
        Some(changes) if changes.is_empty() => commit,
        _ => commit + "-dirty",
    }
}
