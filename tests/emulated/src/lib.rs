//! Common part of the images for the emulated CPU: entry, output, verdict.
//!
//! An image is one function. It passes by returning and fails by a panic or a hard fault. The
//! verdict is the emulator's exit status. At the desk the same function runs as an ordinary
//! program.
//!
//! ```ignore
//! #![cfg_attr(target_os = "none", no_std, no_main)]
//!
//! kband_emulated::image!(run);
//!
//! fn run() {
//!     kband_emulated::emit!("two and two: {}", 2 + 2);
//!     assert_eq!(2 + 2, 4);
//! }
//! ```
#![cfg_attr(target_os = "none", no_std)]

pub mod kernels;

#[cfg(target_os = "none")]
mod counter;
#[cfg(target_os = "none")]
mod target;

#[cfg(target_os = "none")]
pub use counter::Counter;

#[cfg(target_os = "none")]
#[doc(hidden)]
pub use {
    cortex_m_rt,
    target::{pass, print_line},
};

/// Makes a function without arguments the image's entry.
#[macro_export]
macro_rules! image {
    ($run:path) => {
        #[cfg(target_os = "none")]
        use $crate::cortex_m_rt;

        #[cfg(target_os = "none")]
        #[cortex_m_rt::entry]
        fn entry() -> ! {
            $run();
            $crate::pass()
        }

        #[cfg(not(target_os = "none"))]
        fn main() {
            $run();
        }
    };
}

/// Prints a line: by semihosting on the emulated CPU, on standard error at the desk.
#[macro_export]
macro_rules! emit {
    ($($argument:tt)*) => {
        $crate::print_line(format_args!($($argument)*))
    };
}

#[cfg(not(target_os = "none"))]
#[doc(hidden)]
pub fn print_line(line: core::fmt::Arguments) {
    eprintln!("{line}");
}
