//! Instruction counter by SysTick. The emulator's clock takes 1 ns for each instruction.

use cortex_m::Peripherals;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;

/// Number of instructions in each round of [`spin`].
const PER_ROUND: u64 = 4;

/// A counter of instructions.
pub struct Counter {
    /// SysTick ticks for 400 000 instructions; the rate depends on the machine.
    ticks: u64,
}

impl Counter {
    /// Starts the counter once, and calibrates it with a loop of known length.
    pub fn start() -> Self {
        let peripherals = Peripherals::take();
        let mut system = peripherals.expect("the counter is started once").SYST;
        system.set_clock_source(SystClkSource::Core);
        system.set_reload(0x00ff_ffff);
        system.clear_current();
        system.enable_counter();
        let short = ticks(|| spin(100_000));
        let long = ticks(|| spin(200_000));
        Self {
            ticks: long - short,
        }
    }

    /// Number of instructions of `work`, up to about 80 million.
    pub fn count(&self, work: impl FnOnce()) -> u64 {
        ticks(work) * (100_000 * PER_ROUND) / self.ticks
    }
}

fn ticks(work: impl FnOnce()) -> u64 {
    let before = SYST::get_current();
    work();
    u64::from(before.wrapping_sub(SYST::get_current()) & 0x00ff_ffff)
}

#[inline(never)]
fn spin(rounds: u32) {
    // SAFETY: the loop counts a register down and touches nothing else.
    unsafe {
        core::arch::asm!(
            "2:",
            "subs {0}, {0}, #1",
            "nop",
            "nop",
            "bne 2b",
            inout(reg) rounds => _,
        );
    }
}
