//! The loader of the STM32G474, for the start of its flash.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod chip;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("the build of the board's image includes the loader; it does not run here");
    std::process::exit(2);
}
