//! The application on a board: STM32F405RG by default, Nucleo-G474RE with its feature.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;
// One line per board; exactly one feature is on.
#[cfg(target_os = "none")]
#[cfg_attr(feature = "stm32f405rg", path = "stm32f405rg.rs")]
#[cfg_attr(feature = "stm32g474re", path = "stm32g474re.rs")]
mod chip;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!(
        "this image runs on the board; build it with --profile firmware --target thumbv7em-none-eabihf"
    );
    std::process::exit(2);
}
