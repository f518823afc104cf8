//! The linker refuses an image that does not fit and names the memory.
//!
//! It is tested with the linker scripts of the board's image.

use kband_tests::emulator::Machine;
use kband_tests::images;

/// Flash and RAM of the board in KiB.
const BOARD: [u32; 2] = [1024, 128];

/// A program with the vectors that the scripts need, and with `constants` and `variables` in KiB.
fn program(constants: u32, variables: u32) -> String {
    format!(
        r#"#![no_std]
        #![no_main]
        const CONSTANTS: usize = {constants} * 1024;
        const VARIABLES: usize = {variables} * 1024;
        static CONSTANT: [u8; CONSTANTS] = [1; CONSTANTS];
        static mut VARIABLE: [u8; VARIABLES] = [0; VARIABLES];
        macro_rules! handlers {{ ($($name:ident)+) => {{ $(
            #[allow(non_snake_case)]
            #[unsafe(no_mangle)]
            extern "C" fn $name() -> ! {{ loop {{}} }}
        )+ }} }}
        handlers! {{ DefaultHandler_ HardFault_ HardFaultTrampoline DefaultPreInit }}
        #[allow(non_snake_case)]
        #[unsafe(no_mangle)]
        extern "C" fn Reset() -> ! {{
            for n in 0.. {{
                unsafe {{
                    let constant = (&raw const CONSTANT).cast::<u8>().add(n).read_volatile();
                    (&raw mut VARIABLE).cast::<u8>().add(n).write_volatile(constant);
                }}
            }}
            loop {{}}
        }}
        #[unsafe(link_section = ".vector_table.reset_vector")]
        #[unsafe(no_mangle)]
        static __RESET_VECTOR: extern "C" fn() -> ! = Reset;
        #[unsafe(link_section = ".vector_table.exceptions")]
        #[unsafe(no_mangle)]
        static __EXCEPTIONS: [usize; 14] = [0; 14];
        #[unsafe(link_section = ".vector_table.interrupts")]
        #[unsafe(no_mangle)]
        static __INTERRUPTS: [usize; 82] = [0; 82];
        #[panic_handler]
        fn panic(_: &core::panic::PanicInfo) -> ! {{ loop {{}} }}
        "#
    )
}

/// The linker's message for a program in a memory with `flash` and `ram` in KiB; `None` if it fits.
fn refusal([constants, variables]: [u32; 2], [flash, ram]: [u32; 2]) -> Option<String> {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("program.rs");
    std::fs::write(&source, program(constants, variables)).unwrap();
    let memory = format!(
        "MEMORY {{ FLASH : ORIGIN = 0x08000000, LENGTH = {flash}K\n RAM : ORIGIN = 0x20000000, LENGTH = {ram}K }}"
    );
    std::fs::write(folder.path().join("board.x"), memory).unwrap();
    std::fs::write(folder.path().join("device.x"), "").unwrap();
    let machine = Machine::CortexM4F;
    let folders = [
        folder.path().to_path_buf(),
        images::script_folder("budget.x", machine),
        images::script_folder("link.x", machine),
    ];
    let output = images::link(
        &source,
        machine,
        &folders,
        &[
            "--nmagic",
            "--defsym=kband_stack=56320",
            "-Tlink.x",
            "-Tlayout.x",
            "-Tbudget.x",
        ],
    );
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        output.status.success() || said.contains("rust-lld"),
        "{said}"
    );
    (!output.status.success()).then_some(said)
}

#[test]
fn an_image_beyond_flash_or_ram_is_refused_by_the_linker() {
    // The scripts are built with the image.
    let _ = images::build("kband-firmware", "feeder", Machine::CortexM4F);
    // The image's budget: 328 KiB of flash, and 88 KiB of RAM with a stack of 55 KiB.
    assert_eq!(refusal([326, 23], BOARD), None);
    let flash = refusal([328, 23], BOARD).expect("too much flash");
    assert!(flash.contains("exceeds 328 KiB of flash"), "{flash}");
    let ram = refusal([326, 35], BOARD).expect("too much RAM");
    assert!(
        ram.contains("stack and static data exceed 88 KiB of RAM"),
        "{ram}"
    );
    // The chip's memory, where it is smaller than the budget.
    let flash = refusal([120, 1], [100, 128]).expect("too much for the chip");
    assert!(flash.contains("will not fit in region 'FLASH'"), "{flash}");
    let ram = refusal([1, 1], [1024, 40]).expect("no room beside the stack");
    assert!(ram.contains("will not fit in region 'RAM'"), "{ram}");
}
