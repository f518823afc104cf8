//! Reads an address without memory: a hard fault must make the run fail.
#![cfg_attr(target_os = "none", no_std, no_main)]

kband_emulated::image!(run);

fn run() {
    let nowhere = core::hint::black_box(0xf000_0000_usize) as *const u32;
    // SAFETY: none; the address is outside every memory of the machine and the bus answers with a
    // fault.
    let word = unsafe { nowhere.read_volatile() };
    kband_emulated::say!("{word:#x} was read where no memory is");
}
