//! The application on QEMU's `olimex-stm32-h405`, with the plant compiled in.
//!
//! The timer's interrupt stands still while the control of a cycle is owed, so that the emulator's
//! speed has no say in the result: the trace equals the desk's, bit for bit.
//!
//! The word on the semihosting command line says what to do:
//!
//! | word | does |
//! |---|---|
//! | the name of a trial | runs it and prints its trace |
//! | `link` | runs the default scene, enable withdrawn, and answers on USART2 until it is ended from outside |
//! | `run` | the same with the enable input given, at the board's speed where the desk is fast enough |
//! | `count` | counts the instructions of the sample interrupt, the control and the plan of the capture; needs a clock that counts them |
//! | `count-link` | counts those of each request of the link, and how long a flood of them keeps a sample waiting; needs the same clock |
//! | `identity` | prints what image this is |
//! | `panic`, `fault`, `overflow`, `stray` | runs into a panic, a hard fault, the end of the stack, an unexpected interrupt |
//! | `sag` | runs a while, is reset as by a sag of its supply, and runs on |
//! | `hang` | a task never returns: the watchdog has to bite |
//!
//! Its log goes to USART1, in every case.
//!
//! After `link` and `run` the name of a file may follow that is the flash of settings and faults: four pages
//! of 4096 bytes, 0xff where nothing was written yet.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod count;
#[cfg(target_os = "none")]
mod count_link;
#[cfg(target_os = "none")]
mod emulated;
#[cfg(target_os = "none")]
mod flash;
#[cfg(target_os = "none")]
mod logger;
#[cfg(target_os = "none")]
mod serial;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!(
        "this image runs on the emulated CPU; build it with --profile firmware --target thumbv7em-none-eabihf"
    );
    std::process::exit(2);
}
