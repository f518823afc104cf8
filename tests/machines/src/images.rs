//! Builds the images on demand for a target, in a separate target folder.
//!
//! Cargo, which runs the tests, may hold the lock of its own folder.

use std::collections::BTreeMap;
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::{Mutex, PoisonError};

use object::elf::{FileHeader32, PT_LOAD};
use object::read::elf::{FileHeader as _, ProgramHeader as _};
use object::{Object, ObjectSymbol};

use crate::chip::kind::Kind;
use crate::emulator::Machine;
use crate::root;

// Name that tests/setup.sh gives to Debian's toolchain if rustup cannot install the targets.
const LINKED: &str = "kband-thumb";

/// Images by package, binary, machine, and features that replace the default ones.
static BUILT: Mutex<BTreeMap<String, PathBuf>> = Mutex::new(BTreeMap::new());

/// Builds the binary `bin` of `package` for a machine, if it is not up to date.
pub fn build(package: &str, bin: &str, machine: Machine) -> PathBuf {
    build_with(package, bin, machine, None)
}

/// Builds the image of the board with this chip.
pub fn feeder_on(kind: Kind) -> PathBuf {
    let features = kind.facts().feature;
    build_with("kband-firmware", "feeder", Machine::CortexM4F, features)
}

/// Builds the binary `bin` of `package`, with these features instead of the default ones.
pub fn build_with(package: &str, bin: &str, machine: Machine, features: Option<&str>) -> PathBuf {
    let mut built = BUILT.lock().unwrap_or_else(PoisonError::into_inner);
    let image = built.entry(format!("{package} {bin} {machine:?} {features:?}"));
    let image = image.or_insert_with(|| cache_image(package, bin, machine, features));
    image.clone()
}

/// Builds an image and copies it to a separate path. Cargo writes all feature sets to one file,
/// which other tests may be running.
fn cache_image(package: &str, bin: &str, machine: Machine, features: Option<&str>) -> PathBuf {
    let folder = target_folder().join("emulated/kept");
    let features_name = features.unwrap_or("default");
    let cached = folder.join(machine.target()).join(features_name);
    std::fs::create_dir_all(&cached).expect("a folder for the images");
    // The lock covers build and copy, so no other test builds in between.
    let lock = File::create(folder.join("lock")).expect("a file to lock");
    lock.lock().expect("the lock");
    let image = compile(package, bin, machine, features);
    let (new, cached) = (cached.join(format!("{bin}.new")), cached.join(bin));
    // Atomic: the previous copy may be running.
    let copied = std::fs::copy(image, &new).and_then(|_| std::fs::rename(&new, &cached));
    copied.expect("a copy of the image");
    cached
}

pub fn symbol(image: &Path, name: &str) -> u32 {
    find(image, name, |full, _| full == name).start
}

/// Content of an image's flash: segments in order of their addresses.
pub fn segments(image: &Path) -> Vec<(u32, Vec<u8>)> {
    let bytes = std::fs::read(image).expect("the image is read");
    let header = FileHeader32::<object::Endianness>::parse(&*bytes).expect("an ELF file");
    let endian = header.endian().expect("an order of bytes");
    let headers = header.program_headers(endian, &*bytes).expect("segments");
    let loaded = (headers.iter()).filter(|segment| segment.p_type(endian) == PT_LOAD);
    let segments = loaded.map(|segment| {
        let data = segment.data(endian, &*bytes).expect("a segment's bytes");
        (segment.p_paddr(endian), data.to_vec())
    });
    let mut segments: Vec<_> = segments.filter(|(_, data)| !data.is_empty()).collect();
    segments.sort_by_key(|(at, _)| *at);
    segments
}

/// Addresses of a static of an image's program, by its name without modules.
pub fn place(image: &Path, name: &str) -> Range<u32> {
    // A mangled name contains the length of each part before the part.
    let part = format!("{}{name}", name.len());
    find(image, name, |full, size| full.contains(&part) && size > 0)
}

/// Addresses of the first symbol that is selected by its full name and its size.
fn find(image: &Path, name: &str, is_selected: impl Fn(&str, u64) -> bool) -> Range<u32> {
    let bytes = std::fs::read(image).expect("the image is read");
    let file = object::File::parse(&*bytes).expect("an ELF file");
    let mut symbols = file.symbols();
    let found = symbols.find(|symbol| {
        let name = symbol.name();
        name.is_ok_and(|name| is_selected(name, symbol.size()))
    });
    let found = found.unwrap_or_else(|| panic!("no {name} in {}", image.display()));
    found.address() as u32..(found.address() + found.size()) as u32
}

fn toolchain(target: &str) -> Option<String> {
    if compiles_for(&[], target) {
        return None;
    }
    let linked = format!("+{LINKED}");
    let compiles = compiles_for(&[&linked], target);
    assert!(compiles, "no Rust target {target} here; run tests/setup.sh");
    Some(linked)
}

fn compile(package: &str, bin: &str, machine: Machine, features: Option<&str>) -> PathBuf {
    let target = machine.target();
    let folder = target_folder().join("emulated");
    let output = limited("900", "cargo", |cargo| {
        cargo.args(toolchain(target));
        cargo.args(["build", "--quiet", "--locked"]);
        cargo.args(["--config", "firmware/image.toml", "--profile", "firmware"]);
        cargo.args(["--package", package, "--bin", bin, "--target", target]);
        if let Some(features) = features {
            cargo.args(["--no-default-features", "--features", features]);
        }
        cargo.arg("--target-dir").arg(&folder);
        // Flags for the desk's CPU are invalid for this target.
        for flags in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_BUILD_TARGET"] {
            cargo.env_remove(flags);
        }
    });
    let stderr = String::from_utf8_lossy(&output.stderr);
    let built = output.status.success();
    assert!(built, "image {bin} does not build for {target}:\n{stderr}");
    folder.join(target).join("firmware").join(bin)
}

fn compiles_for(toolchain: &[&str], target: &str) -> bool {
    let output = limited("60", "rustc", |rustc| {
        rustc.args(toolchain).args(["--print", "target-libdir"]);
        rustc.args(["--target", target]);
    });
    let library = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    let mut files = (Path::new(&library).read_dir().into_iter())
        .flatten()
        .flatten();
    output.status.success()
        && files.any(|file| file.file_name().to_string_lossy().starts_with("libcore-"))
}

pub fn target_folder() -> PathBuf {
    root().join(std::env::var_os("CARGO_TARGET_DIR").map_or("target".into(), PathBuf::from))
}

/// Runs a command of the toolchain in the workspace's root, with empty input and a time limit.
fn limited(seconds: &str, program: &str, arguments: impl FnOnce(&mut Command)) -> Output {
    let mut command = Command::new("timeout");
    command.args(["--kill-after=5", seconds, program]);
    command.current_dir(root()).stdin(Stdio::null());
    arguments(&mut command);
    let output = command.output();
    output.expect("the commands timeout, cargo and rustc are on the path")
}
