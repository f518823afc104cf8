//! The emulated core agrees with QEMU's (differential test).
//!
//! Random instructions from random registers leave the same registers, flags and memory in both.

use std::path::Path;
use std::time::Duration;

use kband_tests::chip::core::{COUNTER, Core, Fault, Flat};
use kband_tests::emulator::{self, Options};
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

    fn pick<T: Copy, const N: usize>(&mut self, from: [T; N]) -> T {
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

/// Encodings of instructions that leave stack pointer, link register and program counter alone.
///
/// `x` is any bit; other letters are the bits of a number of [`instruction`], again from its
/// highest bit where it stands twice.
const ENCODINGS: [&str; 81] = [
    // Shift, add, subtract, move, compare.
    "000xx xxxxx xxx xxx",
    "00011 xx xxx xxx xxx",
    "001xx xxx xxxxxxxx",
    "010000 xxxx xxx xxx",
    "01000100 d mmmm ddd",
    "01000101 d mmmm ddd",
    "01000110 d mmmm ddd",
    "10110010 xx xxx xxx",
    "101110100 x xxx xxx",
    "1011101011 xxx xxx",
    // With a number.
    "11110 x 000xx x nnnn 0xxx dddd xxxxxxxx",
    "11110 x 00100 x nnnn 0xxx dddd xxxxxxxx",
    "11110 x 01000 x nnnn 0xxx dddd xxxxxxxx",
    "11110 x 0101x x nnnn 0xxx dddd xxxxxxxx",
    "11110 x 01101 x nnnn 0xxx dddd xxxxxxxx",
    "11110 x 01110 x nnnn 0xxx dddd xxxxxxxx",
    "11110 x 0001x x 1111 0xxx dddd xxxxxxxx",
    // With a shifted register; tests and comparisons.
    "1110101 00xx x nnnn 0xxx dddd xxxx mmmm",
    "1110101 0100 x nnnn 0xxx dddd xxxx mmmm",
    "1110101 1000 x nnnn 0xxx dddd xxxx mmmm",
    "1110101 101x x nnnn 0xxx dddd xxxx mmmm",
    "1110101 1101 x nnnn 0xxx dddd xxxx mmmm",
    "1110101 1110 x nnnn 0xxx dddd xxxx mmmm",
    "1110101 001x x 1111 0xxx dddd xxxx mmmm",
    "1110101 0x00 1 nnnn 0xxx 1111 xxxx mmmm",
    "1110101 1000 1 nnnn 0xxx 1111 xxxx mmmm",
    "1110101 1101 1 nnnn 0xxx 1111 xxxx mmmm",
    "111010101100 nnnn 0xxx dddd xxx0 mmmm",
    // Plain numbers.
    "11110 x 100000 nnnn 0xxx dddd xxxxxxxx",
    "11110 x 101010 nnnn 0xxx dddd xxxxxxxx",
    "11110 x 10x100 xxxx 0xxx dddd xxxxxxxx",
    // Saturation; shifted by 0, the second would saturate both halves.
    "11110011x000 nnnn 0xxx dddd xx0 xxxxx",
    "11110011x010 nnnn 0xx1 dddd xx0 xxxxx",
    // Fields of bits.
    "11110011x100 nnnn 00xx dddd xx0 0xxxx",
    "11110011x100 nnnn 0000 dddd 000 xxxxx",
    "11110011x100 nnnn 01xx dddd xx0 00000",
    "111100110110 nnnn 00xx dddd xx0 1xxxx",
    "111100110110 nnnn 0000 dddd 000 xxxxx",
    "111100110110 1111 00xx dddd xx0 1xxxx",
    // Registers only.
    "111110100xxx nnnn 1111 dddd 0000 mmmm",
    "11111010000x nnnn 1111 dddd 10xx mmmm",
    "111110100011 nnnn 1111 dddd 10xx mmmm",
    "11111010010x nnnn 1111 dddd 10xx mmmm",
    "11111010000x 1111 1111 dddd 10xx mmmm",
    "111110100011 1111 1111 dddd 10xx mmmm",
    "11111010010x 1111 1111 dddd 10xx mmmm",
    "111110101x0x nnnn 1111 dddd 0101 mmmm",
    "111110101000 nnnn 1111 dddd 10x0 mmmm",
    "111110101001 mmmm 1111 dddd 10xx mmmm",
    "111110101011 mmmm 1111 dddd 1000 mmmm",
    // Products and quotients.
    "111110110000 nnnn aaaa dddd 000x mmmm",
    "111110110001 nnnn aaaa dddd 00xx mmmm",
    "111110110101 nnnn aaaa dddd 000x mmmm",
    "111110110000 nnnn 1111 dddd 0000 mmmm",
    "111110110001 nnnn 1111 dddd 00xx mmmm",
    "111110110101 nnnn 1111 dddd 000x mmmm",
    "111110111xx0 nnnn aaaa hhhh 0000 mmmm",
    "111110111110 nnnn aaaa hhhh 0110 mmmm",
    "1111101110x1 nnnn 1111 dddd 1111 mmmm",
    // One conditional instruction, and two of them.
    "10111111 cccc 1000 00011 xx xxx xxx xxx",
    "10111111 cccc x100 00100 xxx xxxxxxxx 00110 xxx xxxxxxxx",
    // Loads and stores about r12, which points to the scratch memory.
    "1111100010xx 1100 tttt 00000000 0xxx",
    "11111000110x 1100 tttt 00000000 0xxx",
    "1111100110x1 1100 tttt 00000000 0xxx",
    "1111100000xx 1100 tttt 1xx1 0000 0xxx",
    "11111000010x 1100 tttt 1xx1 0000 0xxx",
    "1111100100x1 1100 tttt 1xx1 0000 0xxx",
    "1111100000xx 1100 tttt 1100 0000 0xxx",
    "11111000010x 1100 tttt 1100 0000 0xxx",
    "1111100100x1 1100 tttt 1100 0000 0xxx",
    // Single precision.
    "111011100 x xx 0xxx 0xxx 1010 xxx0 0xxx",
    "111011101 x 00 0xxx 0xxx 1010 x0x0 0xxx",
    "111011101 x 11 xxxx 0xxx 1010 0000 xxxx",
    "111011101 x 11 000x 0xxx 1010 x1x0 0xxx",
    "111011101 x 11 0100 0xxx 1010 01x0 0xxx",
    "111011101 x 11 0101 0xxx 1010 0100 0000",
    "111011101 x 11 1000 0xxx 1010 x1x0 0xxx",
    "111011101 x 11 110x 0xxx 1010 11x0 0xxx",
    "11101110000x 0xxx dddd 1010 x001 0000",
    "11101100010x hhhh aaaa 1010 0001 0xxx",
    // A comparison and its flags.
    "111011101 x 11 0100 0xxx 1010 01x0 0xxx 1110 1110 1111 0001 1111 1010 0001 0000",
];

/// A random instruction.
fn instruction(random: &mut Source) -> Vec<u16> {
    let encoding = random.pick(ENCODINGS);
    let a = random.below(13);
    // A letter, its number, and the bits left of it.
    let mut numbers = [
        ('d', random.below(13), 0),
        ('n', random.below(13), 0),
        ('m', random.below(13), 0),
        ('a', a, 0),
        // Another register than `a`.
        ('h', (a + 1) % 13, 0),
        // A register that is not the base of a load or store.
        ('t', random.below(12), 0),
        // A condition.
        ('c', random.below(14), 0),
    ];
    let mut bit = |letter| match letter {
        '0' => 0,
        '1' => 1,
        'x' => random.below(2),
        letter => {
            let number = numbers.iter_mut().find(|number| number.0 == letter);
            let (_, number, left) = number.expect("a letter of a number");
            *left = (*left + 3) % 4;
            *number >> *left & 1
        }
    };
    let letters = encoding.chars().filter(|letter| *letter != ' ');
    let bits: Vec<u32> = letters.map(&mut bit).collect();
    let halves = bits.chunks_exact(16);
    halves
        .map(|half| half.iter().fold(0, |all, bit| all << 1 | *bit as u16))
        .collect()
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
    let mut inputs = [random.next() & 0xf800_0000; INPUTS];
    inputs[1..].fill_with(|| random.word());
    inputs[INPUTS - 1] = SCRATCH + 32;
    let code = instruction(random);
    Case { inputs, code }
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
        code.extend([0x2000, 0x2100, 0x43ca, 0x43c3]);
        code.extend([0xe88e, 0x000f, 0xf10e, 0x0e10].repeat(3));
        code.extend([0xe88e, 0x000f]);
        code.extend(link(data_at + (number * INPUTS * 4) as u32));
        // ldr r0, [lr], #4; msr APSR_nzcvqg, r0; vldmia lr!, {s0-s15}; ldmia lr, {r0-r12}
        code.extend([
            0xf85e, 0x0b04, 0xf380, 0x8c00, 0xecbe, 0x0a10, 0xe89e, 0x1fff,
        ]);
        code.extend(&case.code);
        code.extend(link(RESULTS + number as u32 * OUTPUTS * 4));
        // stmia lr!, {r0-r12}; vstmia lr!, {s0-s15}; mrs r0, APSR; vmrs r1, FPSCR; and r1,
        // #0xf0000000
        code.extend([0xe8ae, 0x1fff, 0xecae, 0x0a10, 0xf3ef, 0x8000]);
        code.extend([0xeef1, 0x1a10, 0xf001, 0x4170]);
        // stmia lr!, {r0, r1}
        code.extend([0xe8ae, 0x0003]);
        // Scratch: movw r8, movt r8; ldmia r8, {r0-r3}; stmia lr, {r0-r3}
        code.extend([0xf240 | (((SCRATCH + 32) >> 12) & 0xf) as u16]);
        code.extend([(((SCRATCH + 32) >> 8 & 7) << 12 | 8 << 8 | (SCRATCH + 32) & 0xff) as u16]);
        code.extend([0xf2c2, 0x0800, 0xe898, 0x000f, 0xe88e, 0x000f]);
        data.extend(case.inputs);
    }
    if let Some(expected) = expected {
        let at = data_at + 4 * data.len() as u32;
        compare(&mut code, at, expected.len() as u32);
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
    let mut core = Core::default();
    core.reset(MEMORY + 0x2_0000, FLASH + 0x41);
    core.float = true;
    loop {
        match core.step(&mut memory) {
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
    let length = bytes.len() as u32;
    // Of two halves: type and machine, sizes of the headers and number of segments.
    let header = [40 << 16 | 2, 1, FLASH + 0x41, 52, 0, 0x0500_0400];
    let sizes = [32 << 16 | 52, 40 << 16 | 1, 0];
    let segment = [1, 84, FLASH, FLASH, length, length, 5, 4];
    for word in header.iter().chain(&sizes).chain(&segment) {
        file.extend(word.to_le_bytes());
    }
    file.extend(bytes);
    file
}

/// Whether QEMU's core gives these words.
fn leaves(cases: &[Case], expected: &[u32], folder: &Path) -> bool {
    let path = folder.join("cases.elf");
    std::fs::write(&path, elf(&image(cases, Some(expected)))).unwrap();
    match emulator::run(&path, Options::default(), Duration::from_secs(20)).status {
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
            if leaves(first, &left(first), folder) {
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
        if leaves(&cases, &left(&cases), folder.path()) {
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
