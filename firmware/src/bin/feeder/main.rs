//! The application on an STM32F405RG board.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!(
        "this image runs on the board; build it with --profile firmware --target thumbv7em-none-eabihf"
    );
    std::process::exit(2);
}
