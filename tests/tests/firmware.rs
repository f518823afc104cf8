//! The firmware on the emulated CPU agrees with the desk; sizes of the images.

use std::path::Path;
use std::time::Duration;

use kband_firmware::trial::{self, Trial};
use kband_plant::ClosedLoop;
use kband_tests::chip::kind::Kind;
use kband_tests::emulator::{self, Clock, Machine};
use kband_tests::images;
use object::{Object, ObjectSection, ObjectSymbol, SectionFlags, elf};

/// Sizes in bytes of an image, from its ELF file. Flash: code, constants and initial values of
/// variables. RAM: variables and the stack. Last, the stack.
fn footprint(image: &Path) -> [u32; 3] {
    let bytes = std::fs::read(image).unwrap();
    let file = object::File::parse(&*bytes).unwrap();
    let (mut flash, mut memory, mut stack) = (0, 0, 0);
    for section in file.sections() {
        let SectionFlags::Elf { sh_flags, .. } = section.flags() else {
            panic!("no section of an ELF file");
        };
        if sh_flags.0 & elf::SHF_ALLOC.0 == 0 {
            continue;
        }
        let length = section.size() as u32;
        let stored = section.file_range().is_some();
        if sh_flags.0 & elf::SHF_WRITE.0 != 0 || !stored {
            memory += length;
        }
        if section.name() == Ok(".stack") {
            stack = length;
        } else if stored {
            flash += length;
        }
    }
    [flash, memory, stack]
}

/// Parts of the image by words in the names of their functions and constants; the first counts.
const PARTS: [(&str, &[&str]); 6] = [
    ("controller and messages", &["kband_control"]),
    ("application, link, storage", &["kband_firmware", "feeder"]),
    ("fieldbus", &["kband_bus"]),
    (
        "loader and signature",
        &["kband_loader", "salty", "fe25519", "LOADER"],
    ),
    ("impact map, bands, plans", &["5kband", "kband.."]),
    (
        "libm and arithmetic of the compiler",
        &["libm", "compiler_builtins"],
    ),
];

/// KiB of flash of each part, and of what no part names (embassy, core, unnamed constants).
fn parts(image: &Path) -> Vec<(&'static str, f64)> {
    let bytes = std::fs::read(image).unwrap();
    let file = object::File::parse(&*bytes).unwrap();
    let mut sizes = [0; PARTS.len()];
    for symbol in file.symbols() {
        let name = symbol.name().unwrap_or_default();
        let is_of = |(_, words): &(_, &[&str])| words.iter().any(|word| name.contains(word));
        if (0x0800_0000..0x0900_0000).contains(&symbol.address())
            && let Some(part) = PARTS.iter().position(is_of)
        {
            sizes[part] += symbol.size() as u32;
        }
    }
    let [flash, ..] = footprint(image);
    let names = PARTS.iter().map(|(name, _)| *name).chain(["other"]);
    let rest = flash - sizes.iter().sum::<u32>();
    let sizes = sizes.into_iter().chain([rest]);
    names
        .zip(sizes.map(|size| f64::from(size) / 1024.0))
        .collect()
}

fn virtual_feeder(word: &'static str, clock: Clock, seconds: u64) -> String {
    let machine = Machine::CortexM4F;
    let image = images::build("kband-firmware", "virtual_feeder", machine);
    let limit = Duration::from_secs(seconds);
    emulator::run(&image, machine, clock, &[word], limit)
}

fn trace_is_the_desks(name: &'static str) {
    let trial = Trial::named(name).unwrap();
    let mut desk = ClosedLoop::build(&(trial.scene)()).unwrap();
    let text = virtual_feeder(name, Clock::Steady, 180);
    let numbered = |line: &&str| line.starts_with(|first: char| first.is_ascii_digit());
    let trace: Vec<&str> = text.lines().filter(numbered).collect();
    assert_eq!(trace.len(), trial.cycles as usize, "{text}");
    for line in trace {
        assert_eq!(line, trial::TraceRow(&desk.cycle().report).to_string());
    }
    let mut lines = text.lines();
    let stack = lines.find(|line| line.starts_with("stack ")).unwrap();
    println!("{name}: {stack}");
    let words = stack.split(' ').filter_map(|word| word.parse().ok());
    let words: Vec<u32> = words.collect();
    // With less than an eighth of the stack free the board raises a fault.
    assert!(words[0] < words[1] - words[1] / 8, "{stack}");
}

/// Largest number of instructions of a planning slice: half of a cycle at 50 Hz and 168 MHz.
const SLICE: u32 = 1_680_000;
/// Largest number of instructions of a plan: half a second at 168 MHz.
const PLAN: u32 = 84_000_000;

#[test]
fn samples_control_and_plans_take_their_share_of_the_core() {
    let text = virtual_feeder("count", Clock::Instructions, 60);
    let numbers = |name: &str| -> Vec<u32> {
        let line = text.lines().find_map(|line| line.strip_prefix(name));
        let line = line.unwrap_or_else(|| panic!("{name} {text}"));
        println!("{name}{line}");
        let numbers = line.split([' ', ',']).filter_map(|word| word.parse().ok());
        numbers.collect()
    };
    // Measured values plus 3 % for another compiler; the largest are exact to six instructions.
    for (name, limits) in [
        ("sample interrupt:", [197, 624]),
        ("sample interrupt of two tones:", [221, 642]),
        ("sample interrupt of three tones:", [245, 660]),
        ("sample interrupt with a current sensor:", [263, 684]),
        // An eighth of a cycle at 50 Hz and 168 MHz leaves most of the cycle to the plan and the
        // link.
        ("control:", [420_000, 420_000]),
    ] {
        let counted = numbers(name);
        assert!(counted[0] > 20 && counted[0] <= limits[0], "{text}");
        assert!(counted[1] <= limits[1], "{text}");
    }
    for name in [
        "capture plan:",
        "gear of the lot of the trial:",
        "gear of lively parts:",
        "gear of lively parts on two tones:",
        "gear of lively parts on three tones:",
    ] {
        let counted = numbers(name);
        assert!(counted[0] > 100_000 && counted[0] <= PLAN, "{text}");
        assert!(counted[2] <= SLICE, "{text}");
    }
}

#[test]
fn traces_of_scenes_are_the_desks_bit_for_bit() {
    for name in ["default", "two-tones", "eventful", "scattering"] {
        trace_is_the_desks(name);
    }
}

#[test]
fn images_fit_their_budget() {
    let build = |bin| images::build("kband-firmware", bin, Machine::CortexM4F);
    let nucleo = images::feeder_on(Kind::Stm32g474);
    // Limits in KiB of flash and RAM. The Nucleo's include the 24 KiB of its loader. The emulated
    // image also contains the plant of three tones.
    for (name, image, max_sizes) in [
        ("feeder for the Nucleo-G474RE", nucleo, [288 + 24, 88]),
        ("feeder", build("feeder"), [288, 88]),
        ("virtual_feeder", build("virtual_feeder"), [640, 117]),
    ] {
        let sizes = footprint(&image);
        let [flash, ram, stack] = sizes.map(|bytes| f64::from(bytes) / 1024.0);
        println!("{name}: {flash:.1} KiB of flash, {ram:.1} KiB of RAM");
        println!("of them {stack:.1} KiB stack");
        assert!(flash > 1.0 && stack > 1.0);
        let [max_flash, max_ram] = max_sizes.map(|size| size * 1024);
        assert!(sizes[0] <= max_flash && sizes[1] <= max_ram, "{name}");
    }
}

/// Each part of the board's image is within the budget of its row in docs/numerics.md, and within
/// 1 KiB of the size there.
#[test]
fn each_part_of_the_image_is_within_its_budget() {
    let page = include_str!("../../docs/numerics.md");
    let parts = parts(&images::build(
        "kband-firmware",
        "feeder",
        Machine::CortexM4F,
    ));
    for (name, size) in &parts {
        println!("{name}: {size:.1} KiB of flash");
    }
    for (name, size) in parts {
        let row = page
            .lines()
            .find_map(|line| line.strip_prefix(&format!("| {name} | ")));
        let row = row.unwrap_or_else(|| panic!("no row of {name}"));
        let cells = row.trim_end_matches(" |").split(" | ");
        let numbers: Vec<f64> = cells.map(|cell| cell.parse().unwrap()).collect();
        let holds = size <= numbers[1] && (size - numbers[0]).abs() < 1.0;
        assert!(holds, "{name}: {size:.1} KiB, stated {numbers:?}");
    }
}
