//! The application on QEMU's `olimex-stm32-h405`, with the plant compiled in.
//!
//! The samples pause until the control of a cycle is finished. So the emulator's speed does not
//! affect the result: the trace equals the desk's, bit for bit.
//!
//! The first word on the semihosting command line selects the run:
//!
//! - The name of a trial: runs it and prints its trace.
//! - `link`: runs the default scene with the enable input off. Answers on USART2, and as a Modbus
//!   server on UART4 if the settings switch the bus on, until it is ended from outside.
//! - `run`: the same with the enable input on, at the board's speed if the desk is fast enough.
//! - `count`: counts the instructions of the sample interrupt, the control and the plans. It needs
//!   a clock that counts them.
//!
//! After `link` and `run` a file name may follow: the flash of settings and faults. It has four
//! pages of 4096 bytes, filled with 0xff where nothing was written.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod count;
#[cfg(target_os = "none")]
mod emulated;
#[cfg(target_os = "none")]
mod flash;
#[cfg(target_os = "none")]
mod serial;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!(
        "this image runs on the emulated CPU; build it with --profile firmware --target thumbv7em-none-eabihf"
    );
    std::process::exit(2);
}
