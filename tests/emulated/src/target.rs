//! The verdict on the emulated CPU.

use core::panic::PanicInfo;
use cortex_m_rt::{ExceptionFrame, exception};
use cortex_m_semihosting::debug::{self, EXIT_FAILURE, EXIT_SUCCESS};

/// Prints a line by semihosting.
pub fn print_line(line: core::fmt::Arguments) {
    cortex_m_semihosting::heprintln!("{}", line);
}

/// Ends the emulation with exit status 0.
pub fn pass() -> ! {
    debug::exit(EXIT_SUCCESS);
    unreachable!("the emulator stops at the exit call")
}

fn fail() -> ! {
    loop {
        debug::exit(EXIT_FAILURE);
    }
}

#[panic_handler]
fn panic(cause: &PanicInfo) -> ! {
    crate::emit!("{cause}");
    fail()
}

// SAFETY: the handler never returns, so it cannot disturb what it interrupted.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    crate::emit!("hard fault at {:#010x}", frame.pc());
    fail()
}
