//! The emulated core agrees with QEMU's (differential test).
//!
//! Random instructions from random registers leave the same registers, flags and memory in both.

use std::path::Path;
use std::time::Duration;

use kband_tests::chip::core::{COUNTER, Code, Core, Fault, Flat};
use kband_tests::emulator::{self, Machine, Options};
use kband_tests::states::Random;

const FLASH: u32 = 0x0800_0000;
const MEMORY: u32 = 0x2000_0000;
/// Memory for the loads and stores of a case, and for the results.
const SCRATCH: u32 = MEMORY + 0x100;
const RESULTS: u32 = MEMORY + 0x400;
/// Initial words of a case: flags, s0 to s15, r0 to r12. Final words: these, FPSCR, scratch.
const INPUTS: usize = 30;
const OUTPUTS: u32 = 31 + 4;
/// Number of cases in an image: their results must fit the RAM.
const CASES: usize = 700;
/// Number of images.
const IMAGES: u64 = 12;

/// A source of instructions and words.
struct Source(Random);

impl Source {
    fn next(&mut self) -> u32 {
        (self.0.bits() >> 16) as u32
    }

    fn below(&mut self, end: u32) -> u32 {
        self.next() % end
    }

    /// A register from r0 to r12.
    fn register(&mut self) -> u32 {
        self.below(13)
    }

    fn pick<const N: usize>(&mut self, from: [u32; N]) -> u32 {
        from[self.below(N as u32) as usize]
    }

    /// A word; edge values are as frequent as others.
    fn word(&mut self) -> u32 {
        let edges = [
            0, 1, 2, 31, 32, 33, 0x7f, 0x80, 0xff, 0x7fff, 0x8000, 0xffff, 0x7fffffff, 0x80000000,
            0xffffffff, 0x3f800000, 0xbf800000, 0x7f800000, 0xff800000, 0x7fc00000, 0x7fa00001,
            0x00000001, 0x4f000000, 0xcf000000, 0x4f800000, 0x00800000, 0x3f000000, 0x40200000,
        ];
        match self.below(3) {
            0 => self.pick(edges),
            // A number in single precision near 1.
            1 => 0x3e00_0000 | self.next() & 0x81ff_ffff,
            _ => self.next(),
        }
    }
}

/// One or two halfwords, the first above.
fn narrow(code: u32) -> Vec<u16> {
    vec![code as u16]
}

fn wide(first: u32, second: u32) -> Vec<u16> {
    vec![first as u16, second as u16]
}

/// A random instruction that leaves stack pointer, link register and program counter alone.
fn instruction(random: &mut Source) -> Vec<u16> {
    let (d, n, m, a) = (
        random.register(),
        random.register(),
        random.register(),
        random.register(),
    );
    let [ld, ln, lm] = [random.below(8), random.below(8), random.below(8)];
    let set = random.below(2) << 4;
    let three = random.below(8) << 12;
    let two = random.below(4) << 6;
    match random.below(34) {
        // Shift, add, subtract, move, compare.
        0 => narrow(random.below(3) << 11 | random.below(32) << 6 | ln << 3 | ld),
        1 => narrow(0x1800 | random.below(4) << 9 | lm << 6 | ln << 3 | ld),
        2 => narrow(0x2000 | random.below(4) << 11 | ld << 8 | random.below(256)),
        3 => narrow(0x4000 | random.below(16) << 6 | ln << 3 | ld),
        4 => {
            let kind = random.below(3);
            narrow(0x4400 | kind << 8 | (d >> 3) << 7 | m << 3 | d & 7)
        }
        5 => narrow(
            random.pick([0xb200, 0xb240, 0xb280, 0xb2c0, 0xba00, 0xba40, 0xbac0]) | ln << 3 | ld,
        ),
        // With a number, with a shifted register; tests and comparisons.
        6 | 7 => {
            let kind = random.pick([0, 1, 2, 3, 4, 8, 10, 11, 13, 14]) << 5;
            let i = random.below(2) << 10;
            let n = if (0x40..=0x60).contains(&kind) && random.below(4) == 0 {
                15
            } else {
                n
            };
            wide(
                0xf000 | i | kind | set | n,
                three | d << 8 | random.below(256),
            )
        }
        8 | 9 => {
            let kind = random.pick([0, 1, 2, 3, 4, 8, 10, 11, 13, 14]) << 5;
            let n = if (0x40..=0x60).contains(&kind) && random.below(4) == 0 {
                15
            } else {
                n
            };
            wide(
                0xea00 | kind | set | n,
                three | d << 8 | two | random.below(4) << 4 | m,
            )
        }
        10 => {
            let kind = random.pick([0, 4, 8, 13]) << 5;
            wide(
                0xea10 | kind | n,
                three | 15 << 8 | two | random.below(4) << 4 | m,
            )
        }
        11 => wide(0xeac0 | n, three | d << 8 | two | random.below(2) << 5 | m),
        // Plain numbers.
        12 => {
            let kind = random.pick([0x00, 0x0a, 0x04, 0x0c]) << 4;
            wide(
                0xf200 | random.below(2) << 10 | kind | n,
                three | d << 8 | random.below(256),
            )
        }
        13 => {
            let kind = random.pick([0x10, 0x12, 0x18, 0x1a]) << 4;
            // Shifted by 0 it would saturate both halves.
            let halves = kind & 0x20 != 0 && (three | two) == 0;
            let two = if halves { 1 << 6 } else { two };
            let bits = random.below(32);
            wide(0xf200 | kind | n, three | d << 8 | two | bits)
        }
        14 => {
            let low = random.below(32);
            let width = random.below(32 - low);
            let kind = random.pick([0x14, 0x1c]) << 4;
            wide(
                0xf200 | kind | n,
                (low >> 2) << 12 | d << 8 | (low & 3) << 6 | width,
            )
        }
        15 => {
            let low = random.below(32);
            let high = low + random.below(32 - low);
            let n = if random.below(3) == 0 { 15 } else { n };
            wide(
                0xf360 | n,
                (low >> 2) << 12 | d << 8 | (low & 3) << 6 | high,
            )
        }
        // Registers only.
        16 => wide(0xfa00 | random.below(4) << 5 | set | n, 0xf000 | d << 8 | m),
        17 => {
            let n = if random.below(2) == 0 { 15 } else { n };
            wide(
                0xfa00 | random.pick([0, 1, 3, 4, 5]) << 4 | n,
                0xf080 | d << 8 | random.below(4) << 4 | m,
            )
        }
        18 | 19 => {
            let kind = random.pick([0, 1, 4, 5]);
            wide(0xfa80 | kind << 4 | n, 0xf050 | d << 8 | m)
        }
        20 => wide(0xfa80 | n, 0xf080 | d << 8 | random.below(2) << 5 | m),
        21 => wide(0xfa90 | m, 0xf080 | d << 8 | random.below(4) << 4 | m),
        22 => wide(0xfab0 | n, 0xf080 | d << 8 | n),
        // Products.
        23 | 24 => {
            let kind = random.pick([0, 1, 5]);
            let how = random.below(if kind == 1 { 4 } else { 2 });
            let none = (kind, how) != (0, 1) && random.below(2) == 0;
            let a = if none { 15 } else { a };
            wide(0xfb00 | kind << 4 | n, a << 12 | d << 8 | how << 4 | m)
        }
        25 => {
            let (kind, how) = [(0, 0), (2, 0), (4, 0), (6, 0), (6, 6)][random.below(5) as usize];
            let high = (a + 1) % 13;
            wide(0xfb80 | kind << 4 | n, a << 12 | high << 8 | how << 4 | m)
        }
        26 => wide(random.pick([0xfb90, 0xfbb0]) | n, 0xf0f0 | d << 8 | m),
        // One conditional instruction, as often as not with flags.
        27 => {
            let condition = random.below(14);
            let mask = 8;
            vec![
                (0xbf00 | condition << 4 | mask) as u16,
                (0x1800 | random.below(4) << 9 | lm << 6 | ln << 3 | ld) as u16,
            ]
        }
        // Two of them.
        28 => {
            let condition = random.below(14);
            let mask = 4 | (condition & 1 ^ random.below(2)) << 3;
            vec![
                (0xbf00 | condition << 4 | mask) as u16,
                (0x2000 | ld << 8 | random.below(256)) as u16,
                (0x3000 | ln << 8 | random.below(256)) as u16,
            ]
        }
        // Loads and stores about r12, which points to the scratch memory.
        29 => {
            let kind = random.pick([
                0xf880, 0xf890, 0xf8a0, 0xf8b0, 0xf8c0, 0xf8d0, 0xf990, 0xf9b0,
            ]);
            wide(kind | 12, random.below(12) << 12 | random.below(12))
        }
        30 => {
            let kind = random.pick([
                0xf800, 0xf810, 0xf820, 0xf830, 0xf840, 0xf850, 0xf910, 0xf930,
            ]);
            let how = random.pick([0xb00, 0xf00, 0x900, 0xc00, 0xd00]);
            wide(kind | 12, random.below(12) << 12 | how | random.below(8))
        }
        // Single precision.
        31 | 32 => single(random),
        _ => single_one(random),
    }
}

/// Fields of s-registers: upper four bits and the lowest.
fn fields(random: &mut Source) -> [u32; 2] {
    let number = random.below(16);
    [number >> 1, number & 1]
}

fn single(random: &mut Source) -> Vec<u16> {
    let [[vd, d], [vn, n], [vm, m]] = [fields(random), fields(random), fields(random)];
    let (kind, other) = [
        (0x00, 0),
        (0x00, 1),
        (0x10, 0),
        (0x10, 1),
        (0x20, 0),
        (0x20, 1),
        (0x30, 0),
        (0x30, 1),
        (0x80, 0),
    ][random.below(9) as usize];
    wide(
        0xee00 | kind | d << 6 | vn,
        vd << 12 | 0xa00 | n << 7 | other << 6 | m << 5 | vm,
    )
}

fn single_one(random: &mut Source) -> Vec<u16> {
    let [[vd, d], [vm, m]] = [fields(random), fields(random)];
    let t = random.register();
    match random.below(12) {
        0 => wide(
            0xeeb0 | d << 6 | random.below(16),
            vd << 12 | 0xa00 | random.below(16),
        ),
        1 | 2 => {
            let (kind, upper) = [(0, 0), (0, 1), (1, 0), (1, 1)][random.below(4) as usize];
            wide(
                0xeeb0 | d << 6 | kind,
                vd << 12 | 0xa40 | upper << 7 | m << 5 | vm,
            )
        }
        3 | 4 => {
            let kind = random.pick([4, 5]);
            let (m, vm) = if kind == 5 { (0, 0) } else { (m, vm) };
            wide(0xeeb0 | d << 6 | kind, vd << 12 | 0xa40 | m << 5 | vm)
        }
        5..=8 => {
            let kind = random.pick([8, 12, 13]);
            // To integers: towards zero.
            let upper = if kind == 8 { random.below(2) } else { 1 };
            wide(
                0xeeb0 | d << 6 | kind,
                vd << 12 | 0xa40 | upper << 7 | m << 5 | vm,
            )
        }
        9 => wide(0xee00 | random.below(2) << 4 | vm, t << 12 | 0xa10 | m << 7),
        10 => {
            let even = vm.min(6);
            let other = (t + 1) % 13;
            wide(
                0xec40 | random.below(2) << 4 | other,
                t << 12 | 0xa10 | even,
            )
        }
        // A comparison and its flags.
        _ => {
            let mut code = wide(0xeeb4 | d << 6, vd << 12 | 0xa40 | m << 5 | vm);
            code.extend([0xeef1, 0xfa10]);
            code
        }
    }
}

/// Instructions that load a number into the link register.
fn link(value: u32) -> [u16; 4] {
    let half = |first: u32, value: u32| {
        let (i, three, byte) = (value >> 11 & 1, value >> 8 & 7, value & 0xff);
        [
            (first | i << 10 | value >> 12) as u16,
            (three << 12 | 14 << 8 | byte) as u16,
        ]
    };
    let [a, b] = half(0xf240, value & 0xffff);
    let [c, d] = half(0xf2c0, value >> 16);
    [a, b, c, d]
}

/// A case: its initial registers and its instruction.
#[derive(Clone)]
struct Case {
    inputs: [u32; INPUTS],
    code: Vec<u16>,
}

fn case(random: &mut Source) -> Case {
    let mut inputs = [0; INPUTS];
    inputs[0] = random.next() & 0xf800_0000;
    for word in &mut inputs[1..] {
        *word = random.word();
    }
    inputs[INPUTS - 1] = SCRATCH + 32;
    Case {
        inputs,
        code: instruction(random),
    }
}

/// The image of some cases; with `expected` it compares the results, without it stops at the end.
fn image(cases: &[Case], expected: Option<&[u32]>) -> Vec<u8> {
    let data_at = FLASH + 0x4_0000;
    let mut code: Vec<u16> = Vec::new();
    // CPACR: the floating-point unit on.
    code.extend(link(0xe000_ed88));
    code.extend([
        0xf44f, 0x0070, 0xf8ce, 0x0000, 0xf3bf, 0x8f4f, 0xf3bf, 0x8f6f,
    ]);
    let mut data: Vec<u32> = Vec::new();
    for (number, case) in cases.iter().enumerate() {
        code.extend(link(SCRATCH));
        // Sets four words of scratch from r0 to r3, which hold results of the previous case.
        code.extend([
            0x2000, 0x2100, 0x43ca, 0x43c3, 0xe88e, 0x000f, 0xf10e, 0x0e10,
        ]);
        code.extend([
            0xe88e, 0x000f, 0xf10e, 0x0e10, 0xe88e, 0x000f, 0xf10e, 0x0e10, 0xe88e, 0x000f,
        ]);
        code.extend(link(data_at + (number * INPUTS * 4) as u32));
        // ldr r0, [lr], #4; msr APSR_nzcvqg, r0; vldmia lr!, {s0-s15}; ldmia lr, {r0-r12}
        code.extend([
            0xf85e, 0x0b04, 0xf380, 0x8c00, 0xecbe, 0x0a10, 0xe89e, 0x1fff,
        ]);
        code.extend(&case.code);
        code.extend(link(RESULTS + number as u32 * OUTPUTS * 4));
        // stmia lr!, {r0-r12}; vstmia lr!, {s0-s15}; mrs r0, APSR; vmrs r1, FPSCR; and r1,
        // #0xf0000000
        code.extend([
            0xe8ae, 0x1fff, 0xecae, 0x0a10, 0xf3ef, 0x8000, 0xeef1, 0x1a10,
        ]);
        code.extend([0xf001, 0x4170]);
        // stmia lr!, {r0, r1}
        code.extend([0xe8ae, 0x0003]);
        // Scratch: movw r8, movt r8; ldmia r8, {r0-r3}; stmia lr, {r0-r3}
        code.extend([0xf240 | (((SCRATCH + 32) >> 12) & 0xf) as u16]);
        code.extend([(((SCRATCH + 32) >> 8 & 7) << 12 | 8 << 8 | (SCRATCH + 32) & 0xff) as u16]);
        code.extend([0xf2c2, 0x0800, 0xe898, 0x000f, 0xe88e, 0x000f]);
        data.extend(case.inputs);
    }
    if let Some(expected) = expected {
        compare(
            &mut code,
            data_at + 4 * data.len() as u32,
            expected.len() as u32,
        );
        data.extend(expected);
    } else {
        code.push(0xbe00);
    }
    let mut bytes = vec![0; 0x4_0000];
    bytes[..8].copy_from_slice(&[0, 0, 2, 0x20, 0x41, 0, 0, 8]);
    for vector in bytes[8..0x40].chunks_exact_mut(4) {
        vector.copy_from_slice(&(FLASH + 0x41).to_le_bytes());
    }
    assert!(0x40 + 2 * code.len() <= bytes.len());
    for (place, half) in bytes[0x40..].chunks_exact_mut(2).zip(&code) {
        place.copy_from_slice(&half.to_le_bytes());
    }
    bytes.extend(data.iter().flat_map(|word| word.to_le_bytes()));
    bytes
}

/// Compares the results with `count` words at `expected`, and exits with 0 or 1.
fn compare(code: &mut Vec<u16>, expected: u32, count: u32) {
    code.extend(link(RESULTS));
    code.push(0x4670); // mov r0, lr
    code.extend(link(expected));
    code.push(0x4671); // mov r1, lr
    code.extend(link(count));
    code.push(0x4672); // mov r2, lr
    code.extend([
        0xf850, 0x3b04, // loop: ldr r3, [r0], #4
        0xf851, 0x4b04, // ldr r4, [r1], #4
        0x42a3, // cmp r3, r4
        0xd108, // bne fail
        0x3a01, // subs r2, #1
        0xd1f7, // bne loop
        0x2018, // movs r0, #0x18: the end, for the reason 0x20026: as wanted
        0xf240, 0x0126, // movw r1, #0x26
        0xf2c0, 0x0102, // movt r1, #2
        0xbeab, // bkpt 0xab
        0xe7fe, // b .
        0x2018, // fail: movs r0, #0x18: the end, for the reason 0x20023: an error
        0xf240, 0x0123, // movw r1, #0x23
        0xf2c0, 0x0102, // movt r1, #2
        0xbeab, // bkpt 0xab
        0xe7fe, // b .
    ]);
}

/// Final words of the cases on the emulated core.
fn left(cases: &[Case]) -> Vec<u32> {
    let mut memory = Flat::new(FLASH, image(cases, None));
    let (mut core, mut code) = (Core::default(), Code::default());
    core.reset(MEMORY + 0x2_0000, FLASH + 0x41);
    core.float = true;
    loop {
        match core.step(&mut code, &mut memory) {
            Ok(_) => {}
            Err(Fault::Breakpoint) => break,
            Err(fault) => panic!("{fault:?} at {:#x}", core.r[COUNTER]),
        }
    }
    let start = (RESULTS - MEMORY) as usize;
    memory.ram[start..start + cases.len() * OUTPUTS as usize * 4]
        .chunks_exact(4)
        .map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
        .collect()
}

/// An ELF file of one segment.
fn elf(bytes: &[u8]) -> Vec<u8> {
    let mut file = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
    for half in [2_u16, 40] {
        file.extend(half.to_le_bytes());
    }
    for word in [1, FLASH + 0x41, 52, 0, 0x0500_0400] {
        file.extend(word.to_le_bytes());
    }
    for half in [52_u16, 32, 1, 40, 0, 0] {
        file.extend(half.to_le_bytes());
    }
    let length = bytes.len() as u32;
    for word in [1, 84, FLASH, FLASH, length, length, 5, 4] {
        file.extend(word.to_le_bytes());
    }
    file.extend(bytes);
    file
}

/// Whether QEMU's core gives the same words.
fn agrees(cases: &[Case], folder: &Path) -> bool {
    leaves(cases, &left(cases), folder)
}

/// Whether QEMU's core gives these words.
fn leaves(cases: &[Case], expected: &[u32], folder: &Path) -> bool {
    let path = folder.join("cases.elf");
    std::fs::write(&path, elf(&image(cases, Some(expected)))).unwrap();
    let options = Options {
        machine: Machine::CortexM4F,
        ..Options::default()
    };
    match emulator::run(&path, options, Duration::from_secs(20)).status {
        Some(0) => true,
        Some(1) => false,
        status => panic!("QEMU ended with {status:?}"),
    }
}

/// The first case in which the cores differ.
fn apart<'a>(cases: &'a [Case], folder: &Path) -> &'a Case {
    match cases {
        [one] => one,
        cases => {
            let (first, second) = cases.split_at(cases.len() / 2);
            if agrees(first, folder) {
                apart(second, folder)
            } else {
                apart(first, folder)
            }
        }
    }
}

#[test]
fn one_bit_apart_is_seen() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Source(Random::new(1));
    let cases: Vec<Case> = (0..20).map(|_| case(&mut random)).collect();
    let mut expected = left(&cases);
    assert!(leaves(&cases, &expected, folder.path()));
    if let Some(last) = expected.last_mut() {
        *last ^= 1;
    }
    assert!(!leaves(&cases, &expected, folder.path()));
}

#[test]
fn the_emulated_core_does_what_qemu_does() {
    let folder = tempfile::tempdir().unwrap();
    for seed in 0..IMAGES {
        let mut random = Source(Random::new(seed));
        let cases: Vec<Case> = (0..CASES).map(|_| case(&mut random)).collect();
        if agrees(&cases, folder.path()) {
            continue;
        }
        let case = apart(&cases, folder.path());
        let code: Vec<String> = case.code.iter().map(|half| format!("{half:04x}")).collect();
        panic!(
            "{}: from {:08x?} it leaves {:08x?}, which is not what QEMU leaves",
            code.join(" "),
            case.inputs,
            left(std::slice::from_ref(case))
        );
    }
    println!("{} instructions as QEMU's", IMAGES * CASES as u64);
}
